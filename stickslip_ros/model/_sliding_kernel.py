# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: what becomes of a joint that slides on without a stop: it settles at its speed, or swings about it.

Its largest departure from the commanded speed is noted in windows of a few periods. A joint settles once windows stay
within a tenth of the speed and shrink, if small disturbances decay. It swings on if windows stay alike, or if it has
not settled after 600 natural periods. Where the lag is short, windows near a swing approach it geometrically, and the
limit is seen early; with a long one they beat, and only blocks of many windows are compared.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model._stability_kernel import stable_ratio

GOES_ON, SETTLES, SWINGS_ON, NO_ARREST, NOBODY_KNOWS = range(5)
WINDOW_END = 0  # index of the time at which the window ends; the others follow
_LENGTH, _LARGEST, _BEFORE, _CHANGE, _LIMIT, _QUIET, _SAME, _WINDOWS, _BLOCK, _BLOCK_BEFORE, _STABLE = range(1, 12)

_WINDOW = 4.0 * 2.0 * np.pi  # shortest window, 1/ω: four periods
_LAGS = 3.0  # shortest window, lags
SHORT_LAG = 2.0  # lag, of 1/ω: with a shorter one a joint forgets in less than a swing
STEADY_SWING = 0.1  # departure, of the commanded speed: so much is steady
_SHRINKING = 2  # windows in a row, 1: with so many steady ones that shrink, the joint settles
_CONVERGES = 0.85  # ratio of successive changes, 1: up to it their limit is tried
_SAME_LIMIT = 0.1  # difference of the limits of two windows, of what is left to the limit: within it they are the same
_NEAR_LIMIT = 0.1  # what is left to the limit, of a swing: farther away a swing that decays looks the same
_ROUNDING = 1e-3  # difference of the limits of two windows, of a swing: what rounding makes
_SURE_SWING = (0.12, 0.97)  # swings, of the commanded speed: more than is steady, less than a stop
_WINDOWS_A_BLOCK = 25  # windows of a block, 1
_LASTS = 0.97  # largest departure, of that of the block before: with more the swing lasts
_MOST_BLOCKS = 6  # blocks that are watched, 1


@inlined()
def new_watch(lag):
    """State of the judgement of a joint that slides on, before the first window."""
    watched = np.zeros(12)
    watched[_LENGTH] = max(_WINDOW, _LAGS * lag)
    watched[WINDOW_END] = watched[_LENGTH]
    watched[_BEFORE] = watched[_CHANGE] = watched[_LIMIT] = watched[_BLOCK_BEFORE] = np.nan
    watched[_STABLE] = np.nan
    return watched


@inlined()
def note_departure(watched, departure):
    """Note a departure from the commanded speed."""
    watched[_LARGEST] = max(watched[_LARGEST], departure)


@helper()
def judge_window(watched, time, velocity, slope, damping_ratio, lag, follow):
    """At the end of a window: whether the joint settles, swings on, or goes on to be watched.

    Without ``follow`` all that is asked is whether it stops: NO_ARREST where its departures do not grow.

    Parameters
    ----------
    slope : by which Stribeck friction falls with speed at the commanded one.
    """
    size = watched[_LARGEST] / velocity
    change = size - watched[_BEFORE]
    ratio = change / watched[_CHANGE]
    limit = size + change * ratio / (1.0 - ratio) if 0.0 < ratio < _CONVERGES else np.nan
    same = abs(limit - watched[_LIMIT]) <= _SAME_LIMIT * abs(limit - size) + _ROUNDING * size
    small = size < STEADY_SWING and change <= 0.0
    watched[_QUIET] = watched[_QUIET] + 1.0 if small else 0.0
    watched[_WINDOWS] += 1.0
    watched[_BLOCK] = max(watched[_BLOCK], size)
    watched[WINDOW_END] = time + watched[_LENGTH]
    watched[_LARGEST], watched[_BEFORE], watched[_CHANGE], watched[_LIMIT] = 0.0, size, change, limit
    if watched[_QUIET] >= _SHRINKING:
        if np.isnan(watched[_STABLE]):
            watched[_STABLE] = 1.0 if damping_ratio > stable_ratio(slope, lag) else 0.0
        if watched[_STABLE] == 1.0:
            return SETTLES
    same &= abs(limit - size) < _NEAR_LIMIT * size
    if lag <= SHORT_LAG and same and _SURE_SWING[0] < limit < _SURE_SWING[1]:
        return SWINGS_ON
    if watched[_WINDOWS] % _WINDOWS_A_BLOCK == 0.0:
        if not follow and watched[_BLOCK] <= watched[_BLOCK_BEFORE]:
            return NO_ARREST
        lasts = _LASTS <= watched[_BLOCK] / watched[_BLOCK_BEFORE] <= 1.0 / _LASTS
        if lasts and watched[_BLOCK] >= STEADY_SWING:
            return SWINGS_ON
        if lasts and watched[_STABLE] == 0.0:
            return SETTLES
        if watched[_WINDOWS] >= _MOST_BLOCKS * _WINDOWS_A_BLOCK:
            # What still swings by then, and does not grow, nobody would wait for.
            swings = STEADY_SWING <= watched[_BLOCK] <= watched[_BLOCK_BEFORE] / _LASTS
            return SWINGS_ON if swings else NOBODY_KNOWS
        watched[_BLOCK_BEFORE], watched[_BLOCK] = watched[_BLOCK], 0.0
    return GOES_ON
