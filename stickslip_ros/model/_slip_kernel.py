# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled integration of the dimensionless slip, Eq. (14); :mod:`stickslip_ros.model.simulation` is its face.

Given the friction, a slip is linear: ξ¨ + 2ρ ξ˙ + ξ = −f. A step therefore needs no integration: friction is
interpolated through Lobatto points, and the propagator of the linear equation applied to the polynomial is
exact (``_linear_step``). Two regimes share this:

* steps that divide the lag: the friction at a step's points depends on the velocity at the same points
  a whole number of steps ago, which is known; the jumps of derivatives at the multiples of the lag after
  breakaway fall between steps by themselves.
* steps longer than the lag, for short lags and none: the lagged velocity is inside the step, and friction is
  found by fixed-point iteration. The first lag is a step of its own; the others are halved and doubled as the
  friction's polynomial needs.

At breakaway the state depends on the breakaway level alone, and during the first lag Ψ = 1, so a cycle is a
map from one breakaway level to the next. A slip can also begin as sliding at a multiple of the commanded speed.

A slip that is not ended by an arrest is followed until ``_sliding_kernel`` can tell what becomes of it. With a short
lag dips that do not deepen are enough to know that none will come; with a long one dips come and go in beats.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model import _friction_law
from stickslip_ros.model._linear_step import (
    COLUMNS,
    END_POSITION,
    END_VELOCITY,
    NODES,
    POINTS,
    ROWS,
    crossing,
    fill_lagged,
    fill_matrix,
    find_dip,
    fit_force,
    inside,
    multiply,
    roughness,
)
from stickslip_ros.model._sliding_kernel import GOES_ON, SHORT_LAG, WINDOW_END, judge_window, new_watch, note_departure

# How a slip ends. A joint that slides on does not come to a stop, whatever else it does.
ARRESTED, SLIDES_ON, SETTLED, SWUNG, UNDECIDED, TOO_ROUGH = range(6)

_END = (UNDECIDED, SETTLED, SWUNG, SLIDES_ON, UNDECIDED)  # for what _sliding_kernel tells
_NO_ARREST_BEFORE = 0.5  # time after breakaway, 1/ω: a joint that has just left still gains speed
_TOUCH = 1e-11  # speed, of the commanded one: a dip that ends so close above zero touches it
_MOST_SWEEPS = 30  # fixed-point iterations of a step's friction, 1
_LAG_INSIDE = 6.0  # longest step, lags: a longer one is not made to divide the lag
_MOST_HALVINGS = 16  # halvings of the longest step, 1
_MOST_SHORTENING = 64  # steps in a lag, of those of the longest step
_MOST_LAG_STEPS = 1 << 15  # steps in a lag, 1: no more are kept
_REMEMBERED = 256  # latest steps that are kept where steps do not divide the lag, 1

_dwell_until_met = inlined()(_friction_law.dwell_until_met)
_risen_level = inlined()(_friction_law.risen_level)
_stribeck_friction = inlined()(_friction_law.stribeck_friction)
_stribeck_slope = inlined()(_friction_law.stribeck_slope)


@inlined()
def _longest_step(damping_ratio, stribeck, velocity, refinement):
    return 0.4 / (max(1.0, np.sqrt(velocity), 0.5 * stribeck, 2.0 * damping_ratio) * refinement)


@helper()
def keeps_lag(damping_ratio, stribeck, velocity, lag):
    """Whether the velocities of one lag are no more than can be kept."""
    return lag <= _MOST_LAG_STEPS * _longest_step(damping_ratio, stribeck, velocity, 1.0)


@helper()
def prepare(damping_ratio, stribeck, velocity, lag, refinement):
    """Workspace of one parameter point, whose steps :func:`slip` may shorten.

    Longest step and the number of steps in a lag (0: steps longer than the lag), matrices and lagged rows of each
    halving of the step with a flag whether they are filled, Ψ one lag ago, and the latest steps as they were.
    """
    longest = _longest_step(damping_ratio, stribeck, velocity, refinement)
    steps = np.array([longest, 0.0])
    if lag > longest / _LAG_INSIDE:
        steps[1] = np.ceil(lag / longest)
        steps[0] = lag / steps[1]
    aligned = steps[1] > 0.0
    halvings = 1 if aligned else _MOST_HALVINGS
    return (
        steps,
        np.empty((halvings, ROWS, COLUMNS)),
        np.empty((halvings, POINTS, COLUMNS)),
        np.zeros(halvings, dtype=np.bool_),
        np.empty((min(int(steps[1]) * _MOST_SHORTENING, _MOST_LAG_STEPS), POINTS)),
        np.empty((1 if aligned or lag == 0.0 else _REMEMBERED, POINTS + 3)),
    )


@inlined()
def shorten(prepared):
    """Halve the steps that divide the lag; False if they are as short as they may be."""
    steps, _, _, filled, ring, _ = prepared
    if 2.0 * steps[1] > ring.shape[0]:
        return False
    steps[0] *= 0.5
    steps[1] *= 2.0
    filled[0] = False
    return True


@helper()
def slip(level, velocity, damping_ratio, lag, law, above, follow, prepared, tolerance, record):
    """One slip from breakaway at ``level``, by a law of ``_friction_law``.

    With ``above`` > 0 it begins at (1 + above) times the commanded speed, which it has had for long, with the forces
    balanced. ``follow`` asks for STEADY or SWINGS instead of SLIDES_ON. Returns how it ends, its duration, the position
    at its end (relative to steady motion without Stribeck friction), Ψ then, the distance slipped and the number of
    rows written to ``record``: time, position, velocity relative to the commanded one, Ψ at the end of each step.
    """
    steps, matrices, lagged_rows, filled, ring, latest = prepared
    longest, lag_steps = steps[0], int(steps[1])
    if lag_steps > ring.shape[0]:
        # The velocities of so long a lag are more than are kept.
        return UNDECIDED, 0.0, 0.0, 0.0, 0.0, np.int64(0)
    vector = np.empty(COLUMNS)
    result = np.empty(ROWS)
    responses = np.empty(POINTS + 2)
    coefficients = np.empty(POINTS)
    start, speed, shape = 2.0 * damping_ratio * velocity - level, -velocity, 1.0
    if above > 0.0:
        speed = above * velocity
        shape = _stribeck_friction(law, 1.0, velocity + speed)
        start = -level * shape - 2.0 * damping_ratio * speed
    position = start
    time, acceleration = 0.0, 0.0
    step = longest
    # Of a type from the start: a constant would have what it is passed to compiled once more, for the constant.
    halving = index = recorded = np.int64(0)
    if not filled[halving]:
        _fill(halving, longest, lag, lag_steps, damping_ratio, matrices, lagged_rows, filled)
    if lag_steps == 0 and lag > 0.0:
        for j in range(POINTS):
            coefficients[j] = 0.0
        coefficients[0] = -level * shape
        _push_velocity(latest, index, time, position, speed, coefficients)
        position, speed, acceleration, _ = inside(lag, damping_ratio, position, speed, coefficients, responses)
        time = lag
        index = 1  # type: ignore[assignment]
    touch = _TOUCH * velocity
    rough = tolerance * level
    minimum, drop, rises = np.inf, np.inf, 0
    forgets = lag <= SHORT_LAG
    slope = -_stribeck_slope(law, level, velocity)
    watched = new_watch(lag)
    while True:
        vector[0] = position
        vector[1] = speed
        if lag_steps > 0:
            slot = index % lag_steps
            if index < lag_steps:
                for j in range(POINTS):
                    vector[2 + j] = -level * shape
            else:
                for j in range(POINTS):
                    vector[2 + j] = -level * ring[slot, j]
                if roughness(vector) > rough:
                    return TOO_ROUGH, time, position, 0.0, 0.0, recorded
            multiply(matrices, halving, vector, result)
            for j in range(POINTS):
                ring[slot, j] = _stribeck_friction(law, 1.0, velocity + result[j])
        else:
            while True:
                step = longest * 0.5**halving
                if not filled[halving]:
                    _fill(halving, step, lag, lag_steps, damping_ratio, matrices, lagged_rows, filled)
                solved = _iterate(
                    time, level, velocity, damping_ratio, lag, law, step, acceleration, lagged_rows, halving, latest,
                    index, vector, responses, coefficients,
                )  # fmt: skip
                left_over = roughness(vector)
                if (solved and left_over <= rough) or halving + 1 == _MOST_HALVINGS:
                    break
                halving += 1
            multiply(matrices, halving, vector, result)
            if lag > 0.0:
                fit_force(vector, step, coefficients)
                _push_velocity(latest, index, time, position, speed, coefficients)
            if left_over < 1e-3 * rough and halving > 0:
                halving -= 1
        force = vector[COLUMNS - 1]
        acceleration_before = acceleration
        acceleration = -result[END_POSITION] - 2.0 * damping_ratio * result[END_VELOCITY] + force
        if time + step > _NO_ARREST_BEFORE:
            low, high = _first_not_above_zero(velocity, result)
            arrest = -1.0
            if high > 0.0:
                fit_force(vector, step, coefficients)
                arrest = crossing(
                    low * step, high * step, damping_ratio, position, speed, coefficients, -velocity, responses
                )
            elif acceleration_before < 0.0 <= acceleration:
                fit_force(vector, step, coefficients)
                dip = find_dip(step, damping_ratio, position, speed, coefficients, responses)
                lowest = velocity + inside(dip, damping_ratio, position, speed, coefficients, responses)[1]
                if lowest < -touch:
                    arrest = crossing(0.0, dip, damping_ratio, position, speed, coefficients, -velocity, responses)
                elif lowest <= touch:
                    arrest = dip
                else:
                    # Dips that do not deepen, or deepen by less and less towards a limit above zero: no arrest.
                    drop_before, drop = drop, minimum - lowest
                    minimum = lowest
                    rises = rises + 1 if drop <= 0.0 else 0
                    settles = (
                        np.isfinite(drop_before)
                        and 0.0 < drop < 0.9 * drop_before
                        and lowest > 2.0 * drop * drop / (drop_before - drop)
                    )
                    if forgets and not follow and (rises >= 2 or settles):
                        return SLIDES_ON, time, position, 0.0, 0.0, recorded
            if arrest >= 0.0:
                end, _, _, force = inside(arrest, damping_ratio, position, speed, coefficients, responses)
                arrested = min(max(-force / level, 0.0), 1.0) if level > 0.0 else 1.0
                duration = time + arrest
                if recorded < record.shape[0]:
                    _record(record, recorded, duration, end, -velocity, arrested)
                    recorded += 1
                return ARRESTED, duration, end, arrested, end - start + velocity * duration, recorded
        time += step
        index += 1
        position, speed = result[END_POSITION], result[END_VELOCITY]
        if recorded < record.shape[0]:
            _record(record, recorded, time, position, speed, -force / level if level > 0.0 else 1.0)
            recorded += 1
        for j in range(POINTS):
            note_departure(watched, abs(result[j]))
        if time > watched[WINDOW_END]:
            becomes = judge_window(watched, time, velocity, slope, damping_ratio, lag, follow)
            if becomes != GOES_ON:
                ends = _END[becomes]
                return ends, time, position, 0.0, 0.0, recorded


@helper()
def _fill(halving, step, lag, lag_steps, damping_ratio, matrices, lagged_rows, filled):
    fill_matrix(step, damping_ratio, matrices, halving)
    if lag_steps == 0:
        fill_lagged(step, lag, damping_ratio, lagged_rows, halving)
    filled[halving] = True


@helper()
def _push_velocity(latest, index, time, position, speed, coefficients):
    row = index % latest.shape[0]
    latest[row, 0] = time
    latest[row, 1] = position
    latest[row, 2] = speed
    for k in range(POINTS):
        latest[row, 3 + k] = coefficients[k]


@inlined()
def _remembered(latest, index, time, damping_ratio, responses, coefficients):
    """Velocity at a time before step ``index``; ``coefficients`` are overwritten."""
    back = index - 1
    oldest = max(index - latest.shape[0], 0)
    while back > oldest and latest[back % latest.shape[0], 0] > time:
        back -= 1
    row = back % latest.shape[0]
    for k in range(POINTS):
        coefficients[k] = latest[row, 3 + k]
    return inside(
        max(time - latest[row, 0], 0.0), damping_ratio, latest[row, 1], latest[row, 2], coefficients, responses
    )[1]


@inlined()
def _first_not_above_zero(velocity, result):
    """Fractions of the step between which the velocity is first seen not to be positive; -1 if it stays so."""
    before = 0.0
    for j in range(POINTS):
        if velocity + result[j] <= 0.0:
            return before, NODES[j]
        before = NODES[j]
    return before, -1.0


@helper()
def _record(record, row, time, position, velocity, shape):
    record[row, 0] = time
    record[row, 1] = position
    record[row, 2] = velocity
    record[row, 3] = shape


@inlined()
def _iterate(
    time, level, velocity, damping_ratio, lag, law, step, acceleration, lagged_rows, halving, latest, index, vector,
    responses, coefficients,
):  # fmt: skip
    """Fill in the friction at the points of a step longer than the lag; False if it does not settle."""
    first = POINTS
    for j in range(POINTS):
        shift = NODES[j] * step - lag
        if shift < 0.0:
            lagged = velocity + _remembered(latest, index, time + shift, damping_ratio, responses, coefficients)
        else:
            first = min(first, j)
            lagged = velocity + vector[1] + acceleration * shift
        vector[2 + j] = -_stribeck_friction(law, level, lagged)
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for j in range(first, POINTS):
            lagged = velocity
            for k in range(COLUMNS):
                lagged += lagged_rows[halving, j, k] * vector[k]
            force = -_stribeck_friction(law, level, lagged)
            change = max(change, abs(force - vector[2 + j]))
            vector[2 + j] = force
        if change <= 1e-14 * level:
            return True
    return False


@inlined()
def stick(end, shape, level, velocity, damping_ratio, stribeck, rise_time):
    """Dwell after an arrest, and the level at the next breakaway: Eq. (6) met by the applied force.

    The force at arrest falls short of what friction holds, and grows with the commanded velocity.
    """
    arrested = level * shape
    deficit = min(-end + 2.0 * damping_ratio * velocity - arrested, 0.0)
    missing = stribeck - arrested
    dwell = _dwell_until_met(deficit, missing, velocity, rise_time)
    return dwell, arrested + missing * _risen_level(0.0, 1.0, dwell, rise_time)
