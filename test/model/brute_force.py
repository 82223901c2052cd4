# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A referee for the exact verdict: Eqs (14), (5), (6) integrated by brute force for thousands of natural periods.

It shares no code with ``stickslip_ros.model`` and knows no shortcut: classical Runge-Kutta steps that divide the lag,
lagged velocities from a ring of past steps (cubic Hermite between them), arrests located within a step, and no guess
about what a cycle will become. What a joint does in the end is read off what it did.

With w the position relative to steady motion, measured from where a joint at rest breaks away, v = x˙/x˙_s and L the
level F*_s,b of the slip, Eq. (14) is w˙ = v − ξ˙_d, v˙ = −w − 2ρ v + L (1 − Ψ). A joint at rest with w has the force
L − w on its static friction, so that breakaway is at w = 0 for the level of that moment. Coulomb friction is taken to
hold the joint at rest against any force backwards, as Eq. (14) does.

Time is in natural periods, 2π, and counts while the joint moves: a rest costs one equation, however long it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.compilation import helper, kernel

POINT = ("damping_ratio", "stribeck", "velocity", "lag", "rise_time")
STICKS, SWINGS, STEADY, UNDECIDED = 0, 1, 2, 3
OUTCOMES = ("sticks", "swings", "steady", "undecided")
FROM_REST = 0.0  # as a start factor: the joint breaks away now, with full static friction
PERIODS = 600
MOST_PERIODS = 4800
WINDOW = 20  # periods over which a swing is measured
LARGEST_STEADY_SWING = 0.1  # of the commanded speed
_NOISE = 1e-9  # of the commanded speed: a swing that is rounding
_CHANGE = 0.02  # relative change of a swing, from three quarters of the time to its end, that is still a change
_LOCATED = 60  # bisections of a step


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What one joint did, by periods of motion.

    Attributes
    ----------
    arrests : number of arrests in each period.
    swing : largest |x˙ − x˙_d|/x˙_d in each period.
    levels : F*_s,b of each breakaway, the first included (not if the joint began sliding).
    breakaways : time of each of them, in periods of motion.
    last_arrest : time of the last arrest, in periods of motion; NaN without any.
    """

    arrests: np.ndarray
    swing: np.ndarray
    levels: np.ndarray
    breakaways: np.ndarray
    last_arrest: float

    def arrests_in_last(self, periods: int) -> int:
        """Number of arrests in the last so many periods."""
        return int(self.arrests[-periods:].sum())

    def last_swing(self, periods: int = WINDOW) -> float:
        """Largest |x˙ − x˙_d|/x˙_d in the last so many periods."""
        return float(self.swing[-periods:].max())

    def outcome(self, periods: int | None = None) -> int:
        """What the first so many periods would be called: STICKS, SWINGS, STEADY or UNDECIDED."""
        count = len(self.swing) if periods is None else periods
        return int(_outcome(self.arrests, self.swing, count))


def longest_step(point: np.ndarray) -> float:
    """Step, in units of 1/ω, at which Ψ and the motion are resolved; columns of the point as POINT."""
    damping_ratio, stribeck, velocity = map(float, point[:3])
    return float(_longest_step(damping_ratio, stribeck, velocity))


def motion(point, factor: float = FROM_REST, periods: int = PERIODS, refinement: float = 1.0) -> Motion:
    """Simulate one joint.

    Parameters
    ----------
    point : ρ, F*_s∞, ξ˙_d, τ*, γ* (POINT).
    factor : FROM_REST, or the speed as a multiple of the commanded one at which the joint slides to begin with: it has
        slid so for one lag, its level is F*_s∞, and the position is that at which the forces balance.
    periods : natural periods of motion.
    refinement : by how much the steps are divided.
    """
    arrests, swing = np.zeros(periods, dtype=np.int64), np.zeros(periods)
    levels, times = np.empty(periods * 8), np.empty(periods * 8)
    count, last = _simulate(*map(float, point), float(factor), float(refinement), arrests, swing, levels, times)
    return Motion(
        arrests=arrests, swing=swing, levels=levels[:count], breakaways=times[:count],
        last_arrest=last / (2 * math.pi) if last >= 0 else math.nan,
    )  # fmt: skip


def outcomes(
    points,
    factor: float = FROM_REST,
    periods: int = PERIODS,
    most: int = MOST_PERIODS,
    refinement: float = 1.0,
    sticking: int = MOST_PERIODS,
) -> np.ndarray:
    """What becomes of each joint: STICKS, SWINGS, STEADY or UNDECIDED; ``points`` has a row of POINT for each.

    A joint that is undecided after so many periods is followed for twice as many, up to ``most``; one that sticks for
    ``sticking``, as a cycle may take thousands of periods to die out where one that lasts is near.
    """
    rows = np.ascontiguousarray(np.atleast_2d(points), dtype=float)
    found = np.empty(len(rows), dtype=np.int64)
    _all_outcomes(rows, float(factor), periods, most, sticking, float(refinement), found)
    return found


def point_of(
    *,
    inertia: float,
    stiffness: float,
    damping: float,
    velocity: float,
    stribeck: float,
    stribeck_velocity: float,
    lag: float,
    rise_time: float,
    viscous: float,
) -> np.ndarray:
    """POINT of a joint in SI units, Eqs (9)-(16)."""
    frequency = math.sqrt(stiffness / inertia)
    return np.array(
        [
            (damping + viscous) / (2 * inertia * frequency),
            stribeck / (inertia * frequency * stribeck_velocity),
            velocity / stribeck_velocity,
            frequency * lag,
            frequency * rise_time,
        ]
    )


@helper()
def _longest_step(damping_ratio, stribeck, velocity):
    return 0.3 / (4.0 + 0.5 * (stribeck + velocity) + 2.0 * damping_ratio)


@helper()
def _hermite(share, step, speed, acceleration, speed_after, acceleration_after):
    """Velocity within a step, from those and the accelerations at its ends; the coefficients are of the share."""
    first, rise = step * acceleration, speed_after - speed
    third = step * (acceleration + acceleration_after) - 2.0 * rise
    second = rise - first - third
    return speed + share * (first + share * (second + share * third))


@helper()
def _acceleration(place, speed, damping_ratio, level, lagged):
    return -place - 2.0 * damping_ratio * speed + level * lagged * lagged / (1.0 + lagged * lagged)


@helper()
def _step(step, place, speed, damping_ratio, level, velocity, has_lag, at_begin, at_middle, at_end):
    """One classical Runge-Kutta step; the lagged velocities at its begin, middle and end (not used without lag)."""
    place_1 = speed - velocity
    speed_1 = _acceleration(place, speed, damping_ratio, level, at_begin if has_lag else speed)
    at = speed + 0.5 * step * speed_1
    place_2 = at - velocity
    speed_2 = _acceleration(place + 0.5 * step * place_1, at, damping_ratio, level, at_middle if has_lag else at)
    at = speed + 0.5 * step * speed_2
    place_3 = at - velocity
    speed_3 = _acceleration(place + 0.5 * step * place_2, at, damping_ratio, level, at_middle if has_lag else at)
    at = speed + step * speed_3
    place_4 = at - velocity
    speed_4 = _acceleration(place + step * place_3, at, damping_ratio, level, at_end if has_lag else at)
    return (
        place + step / 6.0 * (place_1 + 2.0 * place_2 + 2.0 * place_3 + place_4),
        speed + step / 6.0 * (speed_1 + 2.0 * speed_2 + 2.0 * speed_3 + speed_4),
    )


@helper()
def _first_zero(step, speed, acceleration, speed_after, acceleration_after):
    """Share of the step at which the velocity becomes zero, a dip within it included; -1 if it does not."""
    high = -1.0
    if speed_after <= 0.0:
        high = 1.0
    elif acceleration < 0.0 < acceleration_after:
        low, top = 0.0, 1.0
        for _ in range(_LOCATED):  # the bottom of the dip, where the polynomial's slope is zero
            middle = 0.5 * (low + top)
            first, rise = step * acceleration, speed_after - speed
            third = step * (acceleration + acceleration_after) - 2.0 * rise
            second = rise - first - third
            if first + middle * (2.0 * second + 3.0 * middle * third) < 0.0:
                low = middle
            else:
                top = middle
        if _hermite(low, step, speed, acceleration, speed_after, acceleration_after) <= 0.0:
            high = low
    if high < 0.0:
        return -1.0
    low = 0.0
    for _ in range(_LOCATED):
        middle = 0.5 * (low + high)
        if _hermite(middle, step, speed, acceleration, speed_after, acceleration_after) > 0.0:
            low = middle
        else:
            high = middle
    return high


@helper()
def _dwell(missing, velocity, rise, rise_time):
    """Time at rest until the spring's force, short of the level by ``missing``, meets the level, which rises (6)."""
    if np.isinf(rise_time):
        return missing / velocity
    # velocity·d − missing = rise·d/(d + rise_time): the larger root, the only one that is not negative.
    half = 0.5 * (missing + rise - velocity * rise_time)
    root = np.sqrt(half * half + velocity * missing * rise_time)
    return (half + root) / velocity if half > 0.0 else missing * rise_time / max(root - half, 1e-300)


@helper()
def _risen(rise, dwell, rise_time):
    """By how much the level has risen, Eq. (6)."""
    if rise_time == 0.0:
        return rise
    return 0.0 if np.isinf(rise_time) else rise * dwell / (dwell + rise_time)


@kernel(nogil=True)
def _simulate(
    damping_ratio, stribeck, velocity, lag, rise_time, factor, refinement, arrests, swing, levels, breakaways
):
    """Fill the arrays of :class:`Motion`; the number of breakaways and the time of the last arrest (-1: none)."""
    longest = _longest_step(damping_ratio, stribeck, velocity) / refinement
    has_lag = lag > 0.0
    count = int(np.ceil(lag / longest)) if has_lag else 1
    step = lag / count if has_lag else longest
    size = count + 1
    past_speed, past_acceleration = np.zeros(size), np.zeros(size)
    level, place, speed, time = stribeck, 0.0, 0.0, 0.0
    known, last = 0, -1.0
    if factor > 0.0:
        speed = factor * velocity
        place = _acceleration(0.0, speed, damping_ratio, level, speed)
        past_speed[:] = speed
    else:
        if len(levels) > 0:
            levels[0], breakaways[0] = level, 0.0
            known = 1
    slot = 0
    acceleration = 0.0
    period, end = 0, len(arrests)
    while True:
        # The ring holds the step's own begin in ``slot``; the one after it is the oldest, one lag before.
        older = slot + 1 if slot + 1 < size else 0
        old = older + 1 if older + 1 < size else 0
        past_speed[slot], past_acceleration[slot] = speed, acceleration
        begin_speed, begin_acceleration = past_speed[older], past_acceleration[older]
        end_speed, end_acceleration = past_speed[old], past_acceleration[old]
        middle = _hermite(0.5, step, begin_speed, begin_acceleration, end_speed, end_acceleration)
        place_after, speed_after = _step(
            step, place, speed, damping_ratio, level, velocity, has_lag, begin_speed, middle, end_speed
        )
        acceleration_after = _acceleration(
            place_after, speed_after, damping_ratio, level, end_speed if has_lag else speed_after
        )
        share = -1.0
        if speed > 0.0 and (speed_after <= 0.0 or acceleration < 0.0 < acceleration_after):
            share = _first_zero(step, speed, acceleration, speed_after, acceleration_after)
        if share >= 0.0:
            lagged_middle = _hermite(0.5 * share, step, begin_speed, begin_acceleration, end_speed, end_acceleration)
            lagged_end = _hermite(share, step, begin_speed, begin_acceleration, end_speed, end_acceleration)
            place, _ = _step(
                share * step, place, speed, damping_ratio, level, velocity, has_lag, begin_speed, lagged_middle,
                lagged_end,
            )  # fmt: skip
            time += share * step
        else:
            time += step
        now = int(time / (2.0 * np.pi))
        if now >= end:
            return known, last
        period = max(period, now)
        if share >= 0.0:
            arrests[period] += 1
            swing[period] = max(swing[period], 1.0)
            last = time
            held = level / (1.0 + lagged_end * lagged_end) if has_lag else level
            missing = max(held - (level - place), 0.0)
            dwell = _dwell(missing, velocity, stribeck - held, rise_time)
            level = held + _risen(stribeck - held, dwell, rise_time)
            if known < len(levels):
                levels[known], breakaways[known] = level, time / (2.0 * np.pi)
                known += 1
            place, speed, acceleration = 0.0, 0.0, 0.0
            past_speed[:] = 0.0
            past_acceleration[:] = 0.0
            slot = 0
        else:
            place, speed, acceleration = place_after, speed_after, acceleration_after
            swing[period] = max(swing[period], abs(speed - velocity) / velocity)
            slot = older


@kernel()
def _outcome(arrests, swing, count):
    """What joints with so many periods of motion are called.

    STICKS with an arrest in each eighth of the last half and in the last window. Without any in the last half, by the
    swing in the last window: STEADY if it is small and does not grow, SWINGS if it is not and hardly changes.
    """
    half = count // 2
    if arrests[half:count].sum() > 0:
        for part in range(4):
            if arrests[half + part * half // 4 : half + (part + 1) * half // 4].sum() == 0:
                return UNDECIDED
        return STICKS if arrests[count - WINDOW : count].sum() > 0 else UNDECIDED
    middle = 3 * count // 4
    before, after = swing[middle - WINDOW : middle].max(), swing[count - WINDOW : count].max()
    if after <= LARGEST_STEADY_SWING:
        return STEADY if after <= (1.0 + _CHANGE) * before or after <= _NOISE else UNDECIDED
    return SWINGS if abs(after - before) <= _CHANGE * before else UNDECIDED


@kernel(nogil=True)
def _all_outcomes(points, factor, periods, most, sticking, refinement, found):
    nothing = np.empty(0)
    for i in range(points.shape[0]):
        count = periods
        while True:
            arrests, swing = np.zeros(count, dtype=np.int64), np.zeros(count)
            _simulate(
                points[i, 0], points[i, 1], points[i, 2], points[i, 3], points[i, 4], factor, refinement, arrests,
                swing, nothing, nothing,
            )  # fmt: skip
            found[i] = _outcome(arrests, swing, count)
            if found[i] == STICKS and count < sticking:
                count = sticking
            elif found[i] == UNDECIDED and 2 * count <= most:
                count *= 2
            else:
                break
