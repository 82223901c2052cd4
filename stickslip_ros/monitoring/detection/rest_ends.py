# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The ends of a rest, from the crossings around it: how far it reaches, when it began, when it ended."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.detection import _crossing_kernel as kernel

_LEFT = (0.3, 0.6)  # speeds, of the fastest beside the rest: between them a slip creeps no more, and does not turn yet
_FEW_COUNTS = 3  # counts, 1: so few may be those of a slip, which scatter about the power law
_CERTAIN = 0.5  # time by which a creep is too early, of the time that the slip takes to get fast
_WINDOW_SPEED = 0.4  # speed, of the fastest: up to it motion is extrapolated to the rest
_WINDOW_CROSSINGS = 6  # crossings that are extrapolated, 1: at most
_ENOUGH_CROSSINGS = 3  # crossings, 1: the speed of the first spans the rest itself
_NEAREST_CROSSINGS = 5  # crossings nearest to the rest that are always extrapolated, 1
_WINDOW_SHARE = 0.3  # way from the rest, of the way of the slow motion: up to it crossings are extrapolated
_NEARNESS = 0.5  # weight of a crossing, of that of the one nearer to the rest: the power laws hold at the rest itself
# Exactly at the rest the powers of the way are 1/2 and 1/3. Over the crossings that an encoder gives, the
# deceleration shrinks towards the arrest (1/3 if it vanished), and the spring relaxes after the breakaway.
_ARREST_POWER = 0.45
_BREAKAWAY_POWER = 0.36


def rest_gaps(
    crossings: NDArray[np.float64], longest: int, band: float, limit: float, farthest: float
) -> tuple[int, int]:
    """First and last gap of the rest around the longest gap: joints creep at rest, and encoders flicker.

    The rest goes on as long as the mean speed from its present end stays below the limit [rad/s], and
    it stays within ``farthest`` of the longest gap [rad].
    """
    times, positions = crossings[:, kernel.TIME], crossings[:, kernel.POSITION]
    first = last = longest
    grown = True
    while grown:
        grown = False
        ways = np.maximum(np.abs(positions[last + 2 :] - positions[last + 1]), band)
        near = np.logical_and.accumulate(np.abs(positions[last + 2 :] - positions[longest]) <= farthest)
        slow = np.flatnonzero(near & (ways <= limit * (times[last + 2 :] - times[last + 1])))
        if len(slow):
            last += int(slow[-1]) + 1
            grown = True
        ways = np.maximum(np.abs(positions[:first] - positions[first]), band)
        near = np.logical_and.accumulate(np.abs(positions[:first][::-1] - positions[longest]) <= farthest)[::-1]
        slow = np.flatnonzero(near & (ways <= limit * (times[first] - times[:first])))
        if len(slow):
            first = int(slow[0])
            grown = True
    return first, last


def slow_times(crossings: NDArray[np.float64], longest: int, fastest: float) -> tuple[float, float]:
    """How long the motion about its longest gap was slower than a tenth, and than a half, of the fastest motion [s].

    Of a speed that dips to nothing as a cosine does the first is 0.41 of the second. Of one that passes through zero,
    or dips less far, it is less, and of one that stops it is more.
    """
    speeds, times = np.abs(crossings[:, kernel.SPEED]), crossings[:, kernel.TIME]
    lasted = []
    for level in (kernel.SLOW * fastest, 0.5 * fastest):
        before = np.flatnonzero(speeds[: longest + 1] >= level)
        after = np.flatnonzero(speeds[longest + 1 :] >= level)
        begin = int(before[-1]) if len(before) else 0
        end = longest + (int(after[0]) if len(after) else len(times) - 1 - longest)
        lasted.append(float(times[max(end, longest + 1)] - times[begin]))
    return lasted[0], lasted[1]


def end_of_creep(
    crossings: NDArray[np.float64], first: int, last: int, fastest: float, direction: int
) -> tuple[int, float, NDArray[np.float64]]:
    """The last crossing before the joint leaves the creep, where it leaves it [rad], and crossings of the slip.

    These are taken where the slip has become fast, which is the same part of every one of identical slips. A joint that
    leaves a place came through it before it left: what was crossed earlier than these can have begun there is creep.
    The place lies between the last such crossing and the next one. NaN where the crossings do not tell.
    """
    speeds = np.abs(crossings[last + 1 :, kernel.SPEED])
    # The speed of the first spans the rest itself.
    quick = np.flatnonzero(speeds > _LEFT[0] * min(fastest, float(np.max(speeds, initial=0.0))))
    begin = last + 1 + (int(quick[0]) if len(quick) else 0)
    begin = max(last + 1, min(begin, len(crossings) - _ENOUGH_CROSSINGS))
    fast = np.flatnonzero(speeds[begin - last - 1 :] > _LEFT[1] * fastest)
    fast = fast[fast >= _ENOUGH_CROSSINGS]
    slip = crossings[begin : begin + int(fast[0]) if len(fast) else len(crossings)]
    if len(slip) < _ENOUGH_CROSSINGS:
        return last, math.nan, slip
    slip = slip[np.unique(np.linspace(0, len(slip) - 1, min(len(slip), _WINDOW_CROSSINGS)).astype(int))]
    times, positions = crossings[first:begin, kernel.TIME], crossings[first:begin, kernel.POSITION]
    begins, errors = _extrapolate(
        slip[:, kernel.TIME], direction * (slip[None, :, kernel.POSITION] - positions[:, None]), _BREAKAWAY_POWER, 1.0
    )
    crept = np.flatnonzero(np.isfinite(errors) & (times < begins))
    if len(crept) <= _FEW_COUNTS:
        # Single counts of a slip scatter about the power law; one that is creep comes far too early.
        crept = crept[times[crept] < begins[crept] - _CERTAIN * float(np.ptp(slip[:, kernel.TIME]))]
    if not len(crept):
        return last, math.nan, slip
    at = int(crept[-1])
    place = float(positions[at])
    if at + 1 < len(times) and np.isfinite(errors[at + 1]):
        early, late = begins[at] - times[at], times[at + 1] - begins[at + 1]
        place += float(early / (early + late) * (positions[at + 1] - place))
    else:
        place += 0.5 * float(crossings[first + at + 1, kernel.POSITION] - place)
    return first + at, place, slip


def fastest(crossings: NDArray[np.float64]) -> float:
    """Fastest motion at these crossings, without the few outliers that noise and jittered stamps make [rad/s]."""
    speeds = np.abs(crossings[:, kernel.SPEED])
    # np.quantile, which takes ten times as long for so few.
    rank = kernel.FAST_SHARE * (len(speeds) - 1)
    below = int(rank)
    ordered = np.partition(speeds, sorted({below, min(below + 1, len(speeds) - 1)}))
    share, low, high = rank - below, float(ordered[below]), float(ordered[min(below + 1, len(speeds) - 1)])
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1.0 - share)


def braking_crossings(crossings: NDArray[np.float64], fastest: float) -> NDArray[np.float64]:
    """The crossings next to the rest, while the motion is still slow; evenly thinned."""
    fast = np.flatnonzero(np.abs(crossings[:, kernel.SPEED]) > _WINDOW_SPEED * fastest)
    # Not before the third crossing: the speed of the first spans the rest itself.
    fast = fast[fast >= _ENOUGH_CROSSINGS]
    end = int(fast[0]) if len(fast) else len(crossings)
    # Nor beyond a turn: a lightly damped joint bounces back before it rests.
    steps = np.diff(crossings[:end, kernel.POSITION])
    turned = np.flatnonzero(steps * steps[0] < 0) if len(steps) else steps
    end = int(turned[0]) + 1 if len(turned) else end
    way = np.abs(crossings[:end, kernel.POSITION] - crossings[0, kernel.POSITION])
    end = max(min(end, _NEAREST_CROSSINGS), int(np.searchsorted(way, _WINDOW_SHARE * way[-1])) if end else 0)
    chosen = np.unique(np.linspace(0, max(end - 1, 0), min(end, _WINDOW_CROSSINGS)).astype(int))
    window: NDArray[np.float64] = crossings[chosen]
    return window


def rest_ends(
    left: NDArray[np.float64],
    right: NDArray[np.float64],
    places: NDArray[np.float64],
    flat_begin: float,
    flat_end: float,
    direction_before: int,
    direction_after: int,
) -> tuple[float, float, bool]:
    """Arrest, breakaway and whether both are extrapolated.

    Each row of ``places`` is where the joint may have come to rest and where it may have left; the row
    that fits the motion on both sides best is taken. If none does and the stop is short, the joint did
    not rest, and the arrest returned is after the breakaway.
    """
    arrest, breakaway = None, None
    residual = np.zeros(len(places))
    if len(left) >= _ENOUGH_CROSSINGS:
        way = direction_before * (places[:, :1] - left[None, :, kernel.POSITION])
        arrest, error = _extrapolate(left[:, kernel.TIME], way, _ARREST_POWER, -1.0)
        residual = residual + np.where(arrest < flat_end, error, np.inf)
    if len(right) >= _ENOUGH_CROSSINGS:
        way = direction_after * (right[None, :, kernel.POSITION] - places[:, 1:])
        breakaway, error = _extrapolate(right[:, kernel.TIME], way, _BREAKAWAY_POWER, 1.0)
        residual = residual + np.where(breakaway > flat_begin, error, np.inf)
    best = int(np.argmin(residual))
    if not np.isfinite(residual[best]):
        span = sum(float(np.ptp(side[:, kernel.TIME])) for side in (left, right) if len(side))
        return (flat_begin, flat_end, False) if flat_end - flat_begin > span else (flat_end, flat_begin, True)
    arrest_time = flat_begin if arrest is None else max(float(arrest[best]), flat_begin)
    breakaway_time = flat_end if breakaway is None else min(float(breakaway[best]), float(right[0, kernel.TIME]))
    return arrest_time, breakaway_time, arrest is not None and breakaway is not None


def _extrapolate(
    times: NDArray[np.float64], ways: NDArray[np.float64], power: float, sign: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where t = t_0 ± c way^power meets zero way, for each row of ways, and the squared residuals [s], [s²]."""
    z = np.maximum(ways, 0.0) ** power
    t = times - times[0]
    # The power laws hold at the rest itself; the farther, the less.
    weights = _NEARNESS ** np.arange(len(t))
    weights /= weights.sum()
    z_mean, t_mean = z @ weights, float(t @ weights)
    z_centred, t_centred = z - z_mean[:, None], t - t_mean
    slope = (z_centred * weights) @ t_centred / np.maximum((z_centred**2) @ weights, TINY)
    error = ((t_centred[None, :] - slope[:, None] * z_centred) ** 2) @ weights
    error = np.where(sign * slope > 0, error, np.inf)
    return times[0] + t_mean - slope * z_mean, error
