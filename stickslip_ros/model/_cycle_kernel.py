# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled cycles, and whether they persist.

The arrays of points are ρ, F*_s∞, ξ˙_d, τ*, γ*, of one length each; all points are of one law of ``_friction_law``.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined, kernel
from stickslip_ros.model._slip_kernel import (
    ARRESTED,
    TOO_ROUGH,
    UNDECIDED,
    keeps_lag,
    prepare,
    shorten,
    slip,
    stick,
)

SLIP_DURATION, SLIP_DISTANCE, DWELL, BREAKAWAY_LEVEL, ARREST_LEVEL = range(5)
CYCLE_COLUMNS = ARREST_LEVEL + 1
PERSISTS, DIES, NO_ANSWER = 1, 0, -1  # verdicts of `persists`
FULL_ACCURACY, COARSE = 1.0, 0.15  # patience of a verdict, 1: factor on the limits below

_SHARPEST = 3000.0  # √(speed) or Stribeck friction, dimensionless: beyond it steps are too many
LARGEST_DAMPING_RATIO = 20.0  # damping ratio, 1: verdicts and searches go no further
VERDICT_TOLERANCE = 1e-6  # tolerance of a slip's integration, of the level: that of verdicts
_MOST_CYCLES = 1000  # cycles followed until there is no verdict, 1
_LONGEST = 3000.0 * 2.0 * np.pi  # duration of slips in a row, 1/ω: with a long lag levels may wander for ever
_MOST_TURNS = 400  # turns of the level, 1: one that has gone up and down so often goes on
_FIXED = 1e-11  # change of the level, of the level: a smaller one is none
_ORBIT = 8  # levels that may take turns, 1
# Differences, of a level: an earlier level comes back within one, the last one is farther away than the other.
_RETURNS, _APART = 1e-8, 1e-4
_CONTRACTS = 0.8  # ratio of successive changes of the level, 1: up to it their limit is tried
_ATTRACTS = 0.95  # slope of the map at a fixed point, 1: with less the point attracts
_AT_REST = 1e-7  # change of the level by a cycle, of the level: with less the level is a fixed point
_SECANT_STEPS = 8  # steps of the secant rule, 1
_BISECTIONS = 8  # bisections for the fixed point between two levels, 1
_MOST_NARROWINGS = 40  # bisections between two levels, 1
_MOST_PLAIN = 500  # cycles without a look ahead, 1


@helper()
def cycle(level, point, above, follow, prepared, tolerance, record):
    """One cycle from breakaway at ``level``, or from sliding, with steps as short as the tolerance asks for.

    Returns how the slip ends, slip duration, slip distance, dwell, level at arrest, level at the next breakaway
    and the rows recorded.
    """
    damping_ratio, stribeck, velocity, lag, rise_time, law = point
    while True:
        ends, duration, end, shape, distance, rows = slip(
            level, velocity, damping_ratio, lag, law, above, follow, prepared, tolerance, record
        )
        if ends != TOO_ROUGH or not tolerance < np.inf:
            break
        # Steps as short as they may be are taken as they are.
        tolerance = tolerance if shorten(prepared) else np.inf
    if ends != ARRESTED:
        return ends, duration, np.nan, np.nan, np.nan, np.nan, rows
    dwell, following = stick(end, shape, level, velocity, damping_ratio, stribeck, rise_time)
    return ends, duration, distance, dwell, level * shape, following, rows


@helper()
def feasible(damping_ratio, stribeck, velocity, lag):
    """Whether a slip takes a bearable number of steps, and its lag's are not too many to be kept."""
    few = max(np.sqrt(velocity), stribeck) < _SHARPEST and damping_ratio <= LARGEST_DAMPING_RATIO
    return few and keeps_lag(damping_ratio, stribeck, velocity, lag)


@kernel(nogil=True)
def cycles(
    damping_ratios, stribecks, velocities, lags, rise_times, law, levels, refinement, tolerance, summaries, record, rows
):
    """Fill ``summaries`` (points, cycles, CYCLE_COLUMNS), NaN from where the cycle has died out.

    Where there is room in ``rows``, ``record`` takes the slips of one point, ``rows[n]`` rows up to the end of slip n,
    and a slip that does not end has a summary too, with its duration alone. Returns the number of slips of the last
    point, that one included.
    """
    recorded = rows.shape[0]
    total = slips = 0
    for i in range(damping_ratios.shape[0]):
        for n in range(summaries.shape[1]):
            for column in range(CYCLE_COLUMNS):
                summaries[i, n, column] = np.nan
        slips = 0
        point = (damping_ratios[i], stribecks[i], velocities[i], lags[i], rise_times[i], law)
        if recorded == 0 and not feasible(point[0], point[1], point[2], point[3]):
            continue
        prepared = prepare(point[0], point[1], point[2], point[3], refinement)
        level = levels[i]
        for n in range(summaries.shape[1]):
            ends, duration, distance, dwell, arrested, following, count = cycle(
                level, point, 0.0, False, prepared, tolerance, record[total:]
            )
            total += count
            slips = n + 1
            if recorded > 0:
                rows[n] = total
            if ends != ARRESTED and recorded == 0:
                break
            summaries[i, n, SLIP_DURATION] = duration
            summaries[i, n, SLIP_DISTANCE] = distance
            summaries[i, n, DWELL] = dwell
            summaries[i, n, BREAKAWAY_LEVEL] = level
            summaries[i, n, ARREST_LEVEL] = arrested
            if ends != ARRESTED:
                break
            level = following
    return slips


@inlined()
def _gain(level, point, prepared, nothing):
    """By how much the next breakaway level exceeds this one; NaN if the slip does not end in an arrest."""
    return cycle(level, point, 0.0, False, prepared, VERDICT_TOLERANCE, nothing)[5] - level


@helper()
def persists(level, point, patience, prepared, nothing):
    """Whether breakaway levels, begun with this one, come to rest, or go up and down for ever.

    With a long lag levels may wander for long before they die; ``patience``, up to 1, shortens how long is waited.

    With it the last level, whether it was looked ahead to, not met cycle by cycle, and if so by the last look a level
    above it that still ends in an arrest, or NaN.

    Levels near a fixed point of the map converge geometrically. Two looks ahead replace most of the cycles:
    where they contract, the limit of the geometric series is found, and taken if it attracts; where they hardly
    do, a fixed point is about to be born or has just gone, and the map's closest approach to the diagonal is
    searched below the present level. If it is passed, the levels go on at the far side.
    """
    oldest = older = newest = np.nan
    oldest_gain = older_gain = newest_gain = np.nan
    plain, turns, time, jumped, above = 3, 0, 0.0, False, np.nan
    earlier = np.full(_ORBIT, np.nan)
    for count in range(int(patience * _MOST_CYCLES)):
        if time > patience * _LONGEST:
            break
        oldest, oldest_gain, older, older_gain = older, older_gain, newest, newest_gain
        ends, duration, _, _, _, following, _ = cycle(level, point, 0.0, False, prepared, VERDICT_TOLERANCE, nothing)
        if ends != ARRESTED:
            return (NO_ANSWER if ends == UNDECIDED else DIES), level, jumped, above
        time += duration
        above = np.nan
        newest, newest_gain = level, following - level
        if abs(newest_gain) <= _FIXED * newest:
            return PERSISTS, level, jumped, np.nan
        level = following
        if abs(newest_gain) > _APART * level:
            for other in range(_ORBIT):
                if abs(level - earlier[other]) <= _RETURNS * level:
                    return PERSISTS, level, jumped, np.nan
        earlier[count % _ORBIT] = level
        plain -= 1
        if plain > 0:
            continue
        ratio = newest_gain / older_gain
        turns += ratio < 0.0
        if turns > patience * _MOST_TURNS:
            return PERSISTS, level, jumped, np.nan
        if abs(ratio) < _CONTRACTS:
            if _converges(newest, newest_gain, ratio, point, prepared, nothing):
                return PERSISTS, level, jumped, np.nan
            plain = 2
        elif ratio > 0.0 and newest_gain < 0.0:
            closest, gain = _closest_approach(
                oldest, oldest_gain, older, older_gain, newest, newest_gain, point, prepared, nothing
            )
            if gain >= 0.0:
                return PERSISTS, level, jumped, np.nan
            plain = 4
            if 2.0 * closest > newest:
                level, jumped, above = 2.0 * closest - newest, True, closest
    return PERSISTS, level, jumped, np.nan


@helper()
def last_level(first, level, above, point, prepared, nothing):
    """Level of the slip that is not ended by an arrest, by which a joint swings, where a look ahead led to ``level``.

    By plain cycles from the first level, if they are not too many; if they are, a level that is less than a cycle below
    those that still end in an arrest.
    """
    plain = first
    for _ in range(_MOST_PLAIN):
        ends, _, _, _, _, after, _ = cycle(plain, point, 0.0, False, prepared, VERDICT_TOLERANCE, nothing)
        if ends != ARRESTED:
            return plain
        plain = after
    if np.isnan(above):
        return level
    following = cycle(above, point, 0.0, False, prepared, VERDICT_TOLERANCE, nothing)[5]
    for _ in range(_MOST_NARROWINGS):
        if not level < following < above:
            break
        middle = 0.5 * (level + above)
        ends, _, _, _, _, after, _ = cycle(middle, point, 0.0, False, prepared, VERDICT_TOLERANCE, nothing)
        if ends == ARRESTED:
            above, following = middle, after
        else:
            level = middle
    return following if following < above else level


@inlined()
def _converges(level, gain, ratio, point, prepared, nothing):
    """Whether levels that change by this ratio lead to a fixed point that attracts: found by the secant rule."""
    before, gain_before = level, gain
    level += gain / (1.0 - ratio)
    for _ in range(_SECANT_STEPS):
        if not level > 0.0 or level == before:
            return False
        gain = _gain(level, point, prepared, nothing)
        if np.isnan(gain):
            return False
        slope = 1.0 + (gain_before - gain) / (before - level)
        if not abs(slope) < _ATTRACTS:
            return False
        if abs(gain) <= _AT_REST * level:
            return True
        following = level + gain / (1.0 - slope)
        if not abs(following - level) < abs(level - before):
            return False
        before, gain_before, level = level, gain, following
    return False


@inlined()
def _closest_approach(oldest, oldest_gain, older, older_gain, newest, newest_gain, point, prepared, nothing):
    """Level below the newest at which the gain is largest, by successive parabolas, and the gain there.

    Stops at the first level whose gain is not negative; NaN if there is no such level.
    """
    a, gain_a, b, gain_b, c, gain_c = oldest, oldest_gain, older, older_gain, newest, newest_gain
    for _ in range(8):
        slope = (gain_c - gain_b) / (c - b)
        curvature = (slope - (gain_b - gain_a) / (b - a)) / (c - a)
        top = 0.5 * (b + c) - 0.5 * slope / curvature if curvature < 0.0 else np.nan
        if not 0.0 < top < newest:
            return np.nan, np.nan
        gain = _gain(top, point, prepared, nothing)
        if np.isnan(gain):
            return np.nan, np.nan
        if gain >= 0.0:
            caught = _catches(top, gain, newest, newest_gain, point, prepared, nothing)
            return (top, gain) if caught else (np.nan, np.nan)
        if abs(top - c) <= 1e-3 * (newest - top):
            return top, gain
        a, gain_a, b, gain_b, c, gain_c = b, gain_b, c, gain_c, top, gain
    return np.nan, np.nan


@inlined()
def _catches(low, low_gain, high, high_gain, point, prepared, nothing):
    """Whether levels that fall from ``high``, where the gain is negative, come to rest above ``low``, where it is not.

    They do if the fixed point between attracts; it does not where a slip's end only grazes zero velocity.
    """
    start = high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        gain = _gain(middle, point, prepared, nothing)
        if np.isnan(gain):
            return False
        if gain >= 0.0:
            low, low_gain = middle, gain
        else:
            high, high_gain = middle, gain
    slope = 1.0 + (high_gain - low_gain) / (high - low)
    return abs(slope) < 1.0 and high < start
