# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: what becomes of a joint in the end, from every start, and from which damping on it is something better.

The starts, all with full static friction: a stuck joint that breaks away; sliding at twice the commanded speed, near a
swing that all but stops; at three times, beyond any; and close to it, where small disturbances grow. The arrays of
points are ρ, F*_s∞, ξ˙_d, τ*, γ*, as in ``_cycle_kernel``.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined, kernel
from stickslip_ros.model import _friction_law
from stickslip_ros.model._cycle_kernel import (
    COARSE,
    DIES,
    FULL_ACCURACY,
    NO_ANSWER,
    PERSISTS,
    VERDICT_TOLERANCE,
    cycle,
    feasible,
    last_level,
    persists,
)
from stickslip_ros.model._slip_kernel import ARRESTED, SETTLED, SWUNG, prepare
from stickslip_ros.model._stability_kernel import stable_ratio

PERSISTENCE, COARSE_PERSISTENCE, CRITICAL_RATIO, OUTCOME, STEADY_RATIO = range(5)  # questions
STEADY, SWINGS, UNDECIDED, STICKS = range(4)  # the better the less
STARTS = 2  # columns, 1: stuck, and the worst of those that slide
_ABOVE = (1.0, 2.0)  # speeds above the commanded one from which sliding begins, of the commanded speed
_A_LITTLE = 0.15  # the same where the linear oscillation grows: the way to a stop may hide it

_LEAST_RATIO = 1e-6  # damping ratio, 1: a smaller one is none
_LEAST_STEADY = 0.01  # damping ratio, 1: with less a joint swings for tens of periods
_STEP = 0.75  # ratio of successive damping ratios in the search for a steady one, 1
# Ratio of damping ratios at which a coarse boundary is confirmed, 1; and how often at most.
_CONFIRMED, _MOST_CONFIRMED = 0.98, 10
_MOST_RETURNS = 10  # stops of a growing swing after which a joint counts as sticking, 1

_stribeck_slope = inlined()(_friction_law.stribeck_slope)


@inlined()
def _outcome_of(ends):
    return STEADY if ends == SETTLED else SWINGS if ends == SWUNG else UNDECIDED


@inlined()
def _with_ratio(ratio, point):
    _, stribeck, velocity, lag, rise_time, law = point
    return ratio, stribeck, velocity, lag, rise_time, law


@helper()
def _outcome(point, above, prepared, nothing):
    """What becomes of a joint that breaks away with full static friction, or slides ``above`` the commanded speed."""
    level = point[1]
    if above > 0.0:
        ends, _, _, _, _, following, _ = cycle(level, point, above, True, prepared, VERDICT_TOLERANCE, nothing)
        if ends != ARRESTED:
            return _outcome_of(ends)
        level = following
    for _ in range(_MOST_RETURNS):
        first = level
        verdict, level, jumped, above = persists(first, point, FULL_ACCURACY, prepared, nothing)
        if verdict != DIES:
            return STICKS if verdict == PERSISTS else UNDECIDED
        if jumped:
            level = last_level(first, level, above, point, prepared, nothing)
        ends, _, _, _, _, following, _ = cycle(level, point, 0.0, True, prepared, VERDICT_TOLERANCE, nothing)
        if ends != ARRESTED:
            return _outcome_of(ends)
        # Swings that grow came to a stop after all.
        level = following
    return STICKS


@helper()
def _from_above(point, prepared, nothing):
    """What becomes of a joint that slides: the first outcome that is not steady, as none is better than that."""
    for above in _ABOVE:
        outcome = _outcome(point, above, prepared, nothing)
        if outcome != STEADY:
            return outcome
    damping_ratio, stribeck, velocity, lag, _, law = point
    # On the way to a stop, which takes from the friction, a joint may miss that it does not slide steadily before.
    if damping_ratio > stable_ratio(-_stribeck_slope(law, stribeck, velocity), lag):
        return STEADY
    return _outcome(point, _A_LITTLE, prepared, nothing)


@helper()
def _sticks(point, patience, nothing):
    if not feasible(point[0], point[1], point[2], point[3]):
        return NO_ANSWER
    return persists(point[1], point, patience, prepare(point[0], point[1], point[2], point[3], 1.0), nothing)[0]


@inlined()
def _critical(point, guess, largest, tolerance, nothing):
    undamped = _sticks(_with_ratio(0.0, point), FULL_ACCURACY, nothing)
    if undamped != PERSISTS:
        return 0.0 if undamped == DIES else np.nan
    low, high = 0.0, min(guess, largest)
    while True:
        verdict = _sticks(_with_ratio(high, point), COARSE, nothing)
        if verdict == NO_ANSWER or (verdict == PERSISTS and high >= largest):
            return np.nan
        if verdict == DIES:
            break
        low, high = high, min(2.0 * high, largest)
    while high - low > tolerance * high and high > _LEAST_RATIO:
        middle = 0.5 * (low + high)
        verdict = _sticks(_with_ratio(middle, point), COARSE, nothing)
        if verdict == NO_ANSWER:
            return np.nan
        if verdict == PERSISTS:
            low = middle
        else:
            high = middle
    # Just below the boundary the haste may have been too great.
    for _ in range(_MOST_CONFIRMED):
        below = _CONFIRMED * low
        if below <= _LEAST_RATIO or _sticks(_with_ratio(below, point), FULL_ACCURACY, nothing) != DIES:
            break
        low, high = _CONFIRMED * below, below
    return 0.5 * (low + high)


@helper()
def _is_steady(ratio, point, nothing):
    """Whether it is from every start."""
    point = _with_ratio(ratio, point)
    if not feasible(point[0], point[1], point[2], point[3]):
        return False
    prepared = prepare(point[0], point[1], point[2], point[3], 1.0)
    return _from_above(point, prepared, nothing) == STEADY and _outcome(point, 0.0, prepared, nothing) == STEADY


@inlined()
def _steady_ratio(point, guess, largest, tolerance, nothing):
    high = min(max(guess, _LEAST_STEADY), largest)
    while not _is_steady(high, point, nothing):
        if high >= largest:
            return np.nan
        high = min(2.0 * high, largest)
    low = _STEP * high
    while _is_steady(low, point, nothing):
        high, low = low, _STEP * low
        if high < _LEAST_STEADY:
            return 0.0
    while high - low > tolerance * high:
        middle = 0.5 * (low + high)
        if _is_steady(middle, point, nothing):
            high = middle
        else:
            low = middle
    return high


@kernel(nogil=True)
def answer(question, damping_ratios, stribecks, velocities, lags, rise_times, law, guesses, largest, tolerance, found):
    """Fill ``found`` (points, 2), or its first column. One kernel for all questions is compiled in the time of one.

    PERSISTENCE : PERSISTS, DIES or NO_ANSWER of a joint that is stuck to begin with.
    COARSE_PERSISTENCE : the same by fewer cycles.
    CRITICAL_RATIO : damping ratio at which the cycle just dies out, bisected to a relative tolerance. 0 where it dies
        undamped, NaN where even ``largest`` does not end it or the integration is refused; ``guesses`` > 0 say where
        to look first.
    OUTCOME : what becomes of each point from each of the STARTS.
    STEADY_RATIO : damping ratio from which on sliding is steady from every start. ``guesses`` > 0 are enough; from
        there the search goes down by factors, and bisects. 0 where next to nothing is needed, NaN as above.
    """
    nothing = np.empty((0, 4))
    for i in range(stribecks.shape[0]):
        point = (damping_ratios[i], stribecks[i], velocities[i], lags[i], rise_times[i], law)
        if question <= COARSE_PERSISTENCE:
            found[i, 0] = _sticks(point, FULL_ACCURACY if question == PERSISTENCE else COARSE, nothing)
        elif question == CRITICAL_RATIO:
            found[i, 0] = _critical(point, guesses[i], largest, tolerance, nothing)
        elif question == STEADY_RATIO:
            found[i, 0] = _steady_ratio(point, guesses[i], largest, tolerance, nothing)
        elif not feasible(point[0], point[1], point[2], point[3]):
            found[i] = UNDECIDED
        else:
            prepared = prepare(point[0], point[1], point[2], point[3], 1.0)
            found[i, 0] = _outcome(point, 0.0, prepared, nothing)
            found[i, 1] = _from_above(point, prepared, nothing)
