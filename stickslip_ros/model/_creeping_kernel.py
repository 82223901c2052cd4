# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: a joint on a contact that creeps before it yields, the LuGre model, with the paper's lag and rising level.

    M x¨ = u(t) − σ₀ z − σ₁ z˙ − F_v x˙,    z˙ = x˙ − σ₀ |x˙| z / S,    S = F_k + F_s Ψ

after Canudas de Wit, Olsson, Åström and Lischinsky, IEEE TAC 40(3), 1995. Without lag and rise S is theirs, a function
of the velocity alone. With them the contact needs a beginning of the slip, which the model does not have: as with a
rigid contact, it is where the applied force exceeds F_k + F_s(t₂). (A speed as the beginning would be late by as much
for the stiffest contact, while static friction rises on, and σ₀ → ∞ would not be the paper's law.) The slip ends where
the velocity changes sign.

The equation of z is stiff while the joint slides, and its oscillation while the joint rests is quick: the steps are
those of RODAS3 (Sandu and others, Atmospheric Environment 31(20), 1997), of order three with an embedded two, L-stable.
"""

from __future__ import annotations

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model import _friction_law
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._plant_state import (
    arrests,
    breaks_away,
    control,
    level_at,
    push_velocity,
    record_breakaway,
    shape,
)

_TOLERANCE = 1e-6  # error of a step, of its scales of length and speed
# Factors on a step, 1: largest, smallest, and a margin to the step that the error allows.
_GROWS, _SHRINKS, _CAUTION = 5.0, 0.1, 0.9
_GAMMA = 0.5  # coefficient γ of RODAS3, 1
_SHORTEST = 1e-13  # step, of a period: no shorter one is tried
_SPACING = 1.0 / 256.0  # spacing of the velocities that are remembered, of the lag
_FORWARD = 1e-3  # difference of time for the slope by time, of a step
_stribeck_slope = inlined()(_friction_law.stribeck_slope)
# Rows of the room.
_STATE, _TRIAL, _NOW, _LATER, _SLOPE, _RIGHT, _K1, _K2, _K3, _K4 = range(10)
ROOM = (_K4 + 1, 4)


@helper()
def _yield_force(time, velocity, state, history, parameters, delayed):
    """S."""
    if state[at.DIRECTION] == 0.0:
        level = level_at(time, state, parameters)
        psi = 1.0 if delayed else shape(time, velocity, state, history, parameters, False)
    else:
        level = state[at.LEVEL]
        psi = shape(time, velocity, state, history, parameters, delayed)
    return parameters[at.COULOMB] + level * psi


@helper()
def _rates(elapsed, row, state, history, parameters, delayed, course, room, out):
    """Right sides, into a row of the room; the state is another row of it."""
    x, v, z, integral = room[row, 0], room[row, 1], room[row, 2], room[row, 3]
    start, reference, reference_velocity = course
    time = state[at.TIME] + elapsed
    yields = _yield_force(time, v, state, history, parameters, delayed)
    now = reference + reference_velocity * (time - start)
    deflecting = v - parameters[at.PRESLIDING_STIFFNESS] * abs(v) * z / yields
    force = control(x, v, integral, now, reference_velocity, parameters) - parameters[at.LOAD]
    force -= (
        parameters[at.PRESLIDING_STIFFNESS] * z
        + parameters[at.PRESLIDING_DAMPING] * deflecting
        + parameters[at.VISCOUS] * v
    )
    room[out, 0] = v
    room[out, 1] = force / parameters[at.INERTIA]
    room[out, 2] = deflecting
    room[out, 3] = now - x
    return yields


@inlined()
def _stage(right, jacobian, out, room):
    """Solve the four equations of a stage, which fall to one for the velocity."""
    c, spring, damping, contact, drive, by_velocity, by_deflection = jacobian
    x, v, z, integral = room[right, 0], room[right, 1], room[right, 2], room[right, 3]
    own = c - by_deflection
    whole = c + damping + spring / c + contact * by_velocity / own + drive / (c * c)
    v += -spring * x / c - contact * z / own + drive * (integral / c - x / (c * c))
    v /= whole
    room[out, 0] = (x + v) / c
    room[out, 1] = v
    room[out, 2] = (z + by_velocity * v) / own
    room[out, 3] = (integral - room[out, 0]) / c


@inlined()
def _jacobian(step, yields, state, parameters, delayed):
    v, z = state[at.VELOCITY], state[at.DEFLECTION]
    inertia, stiffness = parameters[at.INERTIA], parameters[at.PRESLIDING_STIFFNESS]
    steepness = 0.0
    if not delayed:
        scale = parameters[at.STRIBECK_VELOCITY]
        steepness = _stribeck_slope(parameters[at.LAW], state[at.LEVEL], v / scale) / scale
    sign = 1.0 if v >= 0.0 else -1.0
    by_velocity = 1.0 - stiffness * z * (sign / yields - abs(v) * steepness / (yields * yields))
    by_deflection = -stiffness * abs(v) / yields
    damping = parameters[at.DAMPING] + parameters[at.VISCOUS] + parameters[at.PRESLIDING_DAMPING] * by_velocity
    contact = stiffness + parameters[at.PRESLIDING_DAMPING] * by_deflection
    return (
        1.0 / (_GAMMA * step),
        parameters[at.STIFFNESS] / inertia,
        damping / inertia,
        contact / inertia,
        parameters[at.INTEGRAL_GAIN] / inertia,
        by_velocity,
        by_deflection,
    )


@helper()
def _try(step, state, history, parameters, delayed, course, room):
    """One step of RODAS3, its result into the room; the error in units of what is tolerated."""
    room[_STATE, 0], room[_STATE, 1] = state[at.POSITION], state[at.VELOCITY]
    room[_STATE, 2], room[_STATE, 3] = state[at.DEFLECTION], state[at.INTEGRAL]
    yields = _rates(0.0, _STATE, state, history, parameters, delayed, course, room, _NOW)
    _rates(_FORWARD * step, _STATE, state, history, parameters, delayed, course, room, _LATER)
    jacobian = _jacobian(step, yields, state, parameters, delayed)
    for i in range(4):
        room[_SLOPE, i] = (room[_LATER, i] - room[_NOW, i]) / _FORWARD  # times the step
        room[_RIGHT, i] = room[_NOW, i] + 0.5 * room[_SLOPE, i]
    _stage(_RIGHT, jacobian, _K1, room)
    for i in range(4):
        room[_RIGHT, i] = room[_NOW, i] + 4.0 / step * room[_K1, i] + 1.5 * room[_SLOPE, i]
    _stage(_RIGHT, jacobian, _K2, room)
    for i in range(4):
        room[_TRIAL, i] = room[_STATE, i] + 2.0 * room[_K1, i]
    _rates(step, _TRIAL, state, history, parameters, delayed, course, room, _NOW)
    for i in range(4):
        room[_RIGHT, i] = room[_NOW, i] + (room[_K1, i] - room[_K2, i]) / step
    _stage(_RIGHT, jacobian, _K3, room)
    for i in range(4):
        room[_TRIAL, i] += room[_K3, i]
    _rates(step, _TRIAL, state, history, parameters, delayed, course, room, _NOW)
    for i in range(4):
        room[_RIGHT, i] = room[_NOW, i] + (room[_K1, i] - room[_K2, i] - 8.0 / 3.0 * room[_K3, i]) / step
    _stage(_RIGHT, jacobian, _K4, room)
    for i in range(4):
        room[_TRIAL, i] += room[_K4, i]
    length = (parameters[at.COULOMB] + parameters[at.STRIBECK]) / parameters[at.PRESLIDING_STIFFNESS]
    speed = max(abs(room[_STATE, 1]), abs(room[_TRIAL, 1]), parameters[at.STRIBECK_VELOCITY])
    return max(abs(room[_K4, 0]), abs(room[_K4, 2])) / (_TOLERANCE * length) + abs(room[_K4, 1]) / (_TOLERANCE * speed)


@helper()
def _excess(state, history, parameters, delayed, course):
    """Applied force in the direction of the motion, less what the contact holds for long."""
    start, reference, reference_velocity = course
    time, velocity = state[at.TIME], state[at.VELOCITY]
    now = reference + reference_velocity * (time - start)
    force = control(state[at.POSITION], velocity, state[at.INTEGRAL], now, reference_velocity, parameters)
    force -= parameters[at.LOAD]
    force -= parameters[at.VISCOUS] * velocity
    held = _yield_force(time, velocity, state, history, parameters, delayed)
    return (force if velocity > 0.0 else -force) - held


@helper()
def creep_until(end, reference, reference_velocity, state, history, parameters, delayed, room, events, count):
    """Integrate to ``end``, through slips and rests; returns the number of events."""
    course = state[at.TIME], reference, reference_velocity
    period = end - state[at.TIME]
    step = state[at.STEP] if state[at.STEP] > 0.0 else 1e-3 * period
    while state[at.TIME] < end - _SHORTEST * period:
        time = state[at.TIME]
        largest = end - time
        if delayed and state[at.DIRECTION] != 0.0:
            largest = min(largest, (1.0 - _SPACING) * parameters[at.LAG])
            jump = state[at.EVENT_TIME] + parameters[at.LAG]
            if time < jump - _SHORTEST * period and time + largest > jump:
                largest = jump - time
        size = min(step, largest)
        cursor = state[at.HISTORY_CURSOR]
        error = _try(size, state, history, parameters, delayed, course, room)
        factor = min(_GROWS, max(_SHRINKS, _CAUTION / max(error, 1e-12) ** (1.0 / 3.0)))
        if not error <= 1.0 and size > _SHORTEST * period:
            state[at.HISTORY_CURSOR] = cursor
            step = size * (factor if error > 1.0 else _SHRINKS)
            continue
        if size == step or factor < 1.0:
            step = size * factor
        velocity = room[_TRIAL, 1]
        direction, before = state[at.DIRECTION], 0.0
        if direction == 0.0:
            before = _excess(state, history, parameters, delayed, course)
        if direction != 0.0 and velocity * direction < 0.0:
            share = state[at.VELOCITY] / (state[at.VELOCITY] - velocity)
            state[at.TIME] = time + share * size
            state[at.POSITION] += share * (room[_TRIAL, 0] - state[at.POSITION])
            count = record_breakaway(state, parameters, events, count)
            count = arrests(shape(state[at.TIME], 0.0, state, history, parameters, delayed), state, events, count)
        state[at.TIME] = time + size
        state[at.POSITION], state[at.VELOCITY] = room[_TRIAL, 0], velocity
        state[at.DEFLECTION], state[at.INTEGRAL] = room[_TRIAL, 2], room[_TRIAL, 3]
        if direction == 0.0:
            after = _excess(state, history, parameters, delayed, course)
            if after > 0.0:
                share = -before / (after - before) if before < 0.0 else 0.0
                breaks_away(time + share * size, 1.0 if velocity > 0.0 else -1.0, state, parameters)
        if (
            delayed
            and state[at.DIRECTION] != 0.0
            and (
                state[at.HISTORY_COUNT] == 0.0
                or state[at.TIME] - history[int(state[at.HISTORY_HEAD] - 1) % history.shape[0], 0]
                >= _SPACING * parameters[at.LAG]
            )
        ):
            _rates(0.0, _TRIAL, state, history, parameters, delayed, course, room, _NOW)
            push_velocity(state[at.TIME], velocity, room[_NOW, 1], state, history)
        count = record_breakaway(state, parameters, events, count)
    state[at.STEP] = step
    state[at.TIME] = end
    return count
