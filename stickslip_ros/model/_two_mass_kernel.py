# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: motor and load on a spring (:mod:`stickslip_ros.model.transmission`), with all friction at the motor.

The steps are Runge-Kutta's of order four, short beside the resonance, whether the motor slides, sticks, or rests on an
elastic contact. While it sticks the load rings, and the spring's force counts in the balance at breakaway.
"""

from __future__ import annotations

from stickslip_ros.compilation import helper
from stickslip_ros.model._friction_law import RIGID
from stickslip_ros.model._plant_state import (
    CONTACT,
    COULOMB,
    DEFLECTION,
    DIRECTION,
    EVENT_TIME,
    INERTIA,
    INTEGRAL,
    LAG,
    LEVEL,
    LOAD,
    LOAD_INERTIA,
    LOAD_POSITION,
    LOAD_VELOCITY,
    MOST_EVENTS,
    ON_LOAD,
    POSITION,
    PRESLIDING_DAMPING,
    PRESLIDING_STIFFNESS,
    RISE_TIME,
    SPRING,
    SPRING_DAMPING,
    STRIBECK,
    TIME,
    VELOCITY,
    VISCOUS,
    arrests,
    breaks_away,
    control,
    push_velocity,
    record_breakaway,
    risen_level,
    shape,
)

_BISECTIONS = 60  # of a step
_TOGETHER = 1e-12  # s, between instants that are one
# Rows of the room: states, then slopes. Columns: the motor's position and velocity, the load's, the error's integral.
_NOW, _TRIAL, _MIDDLE, _K1, _K2, _K3, _K4 = range(7)
_X, _V, _Y, _W, _Z = range(5)
_COLUMNS = 5
ROOM = (_K4 + 1, _COLUMNS)


@helper()
def _force(row, reference, reference_velocity, parameters, room):
    """What acts on the motor, but for friction."""
    position, velocity = room[row, _X], room[row, _V]
    if parameters[ON_LOAD] > 0.0:
        position, velocity = room[row, _Y], room[row, _W]
    return (
        control(position, velocity, room[row, _Z], reference, reference_velocity, parameters)
        - parameters[LOAD]
        - parameters[SPRING] * (room[row, _X] - room[row, _Y])
        - parameters[SPRING_DAMPING] * (room[row, _V] - room[row, _W])
    )


@helper()
def _rates(row, out, reference, reference_velocity, psi, state, parameters, room):
    """Slopes of a row of the room, into another."""
    x, v = room[row, _X], room[row, _V]
    direction = state[DIRECTION]
    force = _force(row, reference, reference_velocity, parameters, room)
    if direction != 0.0:
        force -= direction * (parameters[COULOMB] + state[LEVEL] * psi) + parameters[VISCOUS] * v
    elif parameters[CONTACT] != RIGID:
        force -= parameters[PRESLIDING_STIFFNESS] * (state[DEFLECTION] + x - room[_NOW, _X])
        force -= (parameters[PRESLIDING_DAMPING] + parameters[VISCOUS]) * v
    else:
        force = 0.0
    spring = parameters[SPRING] * (x - room[row, _Y]) + parameters[SPRING_DAMPING] * (v - room[row, _W])
    room[out, _X], room[out, _V] = v, force / parameters[INERTIA]
    room[out, _Y], room[out, _W] = room[row, _W], spring / parameters[LOAD_INERTIA]
    room[out, _Z] = reference - (room[row, _Y] if parameters[ON_LOAD] > 0.0 else x)


@helper()
def _try(size, reference, reference_velocity, state, history, parameters, delayed, room):
    """One step from the state at its time, into the room's trial; the reference at the step's start."""
    time = state[TIME]
    slides = state[DIRECTION] != 0.0
    psi = shape(time, room[_NOW, _V], state, history, parameters, delayed) if slides else 1.0
    _rates(_NOW, _K1, reference, reference_velocity, psi, state, parameters, room)
    for stage in range(1, 4):
        share = size if stage == 3 else 0.5 * size
        for i in range(_COLUMNS):
            room[_MIDDLE, i] = room[_NOW, i] + share * room[_K1 + stage - 1, i]
        if slides and (stage != 2 or not delayed):
            psi = shape(time + share, room[_MIDDLE, _V], state, history, parameters, delayed)
        now = reference + reference_velocity * share
        _rates(_MIDDLE, _K1 + stage, now, reference_velocity, psi, state, parameters, room)
    for i in range(_COLUMNS):
        room[_TRIAL, i] = room[_NOW, i] + size / 6.0 * (
            room[_K1, i] + 2.0 * room[_K2, i] + 2.0 * room[_K3, i] + room[_K4, i]
        )


@helper()
def _contact_force(row, reference, reference_velocity, state, parameters, room):
    """What static friction has to hold of a motor at rest."""
    if parameters[CONTACT] != RIGID:
        return parameters[PRESLIDING_STIFFNESS] * (state[DEFLECTION] + room[row, _X] - room[_NOW, _X])
    return _force(row, reference, reference_velocity, parameters, room)


@helper()
def _ends(row, time, reference, reference_velocity, state, parameters, room):
    """Whether the slip, or the rest, of the state has ended in a row of the room at a time."""
    if state[DIRECTION] != 0.0:
        return room[row, _V] * state[DIRECTION] < 0.0
    held = parameters[COULOMB] + risen_level(
        state[LEVEL], parameters[STRIBECK], time - state[EVENT_TIME], parameters[RISE_TIME]
    )
    return abs(_contact_force(row, reference, reference_velocity, state, parameters, room)) > held


@helper()
def swing_until(end, reference, reference_velocity, step, state, history, parameters, delayed, room, events, count):
    """Integrate to ``end``, through slips and rests; returns the number of events."""
    before, start = count, state[TIME]
    while state[TIME] < end - _TOGETHER:
        time = state[TIME]
        ahead = reference + reference_velocity * (time - start)
        room[_NOW, _X], room[_NOW, _V] = state[POSITION], state[VELOCITY]
        room[_NOW, _Y], room[_NOW, _W] = state[LOAD_POSITION], state[LOAD_VELOCITY]
        room[_NOW, _Z] = state[INTEGRAL]
        if state[DIRECTION] == 0.0 and count - before >= MOST_EVENTS:
            # Ever shorter hops, without end: the joint creeps, and rests as far as can be seen.
            state[TIME] = end
            continue
        size = min(step, end - time)
        if state[DIRECTION] != 0.0 and delayed:
            size = min(size, parameters[LAG])
            memory_begins = state[EVENT_TIME] + parameters[LAG]
            if time < memory_begins - _TOGETHER and time + size > memory_begins:
                size = memory_begins - time
        # A controller may jump, the deflection of a contact not.
        ended = state[DIRECTION] == 0.0 and parameters[CONTACT] == RIGID
        if ended:
            ended = _ends(_NOW, time, ahead, reference_velocity, state, parameters, room)
        if ended:
            size = 0.0
        _try(size, ahead, reference_velocity, state, history, parameters, delayed, room)
        if not ended and _ends(
            _TRIAL, time + size, ahead + reference_velocity * size, reference_velocity, state, parameters, room
        ):
            ended = True
            low, high = 0.0, size
            for _ in range(_BISECTIONS):
                size = 0.5 * (low + high)
                _try(size, ahead, reference_velocity, state, history, parameters, delayed, room)
                now = ahead + reference_velocity * size
                if _ends(_TRIAL, time + size, now, reference_velocity, state, parameters, room):
                    high = size
                else:
                    low = size
            size = high
            _try(size, ahead, reference_velocity, state, history, parameters, delayed, room)
        ahead += reference_velocity * size
        holding = _contact_force(_TRIAL, ahead, reference_velocity, state, parameters, room)
        state[TIME] = time + size
        state[DEFLECTION] += room[_TRIAL, _X] - state[POSITION]
        state[POSITION], state[VELOCITY] = room[_TRIAL, _X], room[_TRIAL, _V]
        state[LOAD_POSITION], state[LOAD_VELOCITY] = room[_TRIAL, _Y], room[_TRIAL, _W]
        state[INTEGRAL] = room[_TRIAL, _Z]
        if ended and state[DIRECTION] == 0.0:
            breaks_away(state[TIME], 1.0 if holding >= 0.0 else -1.0, state, parameters)
        elif ended:
            state[VELOCITY] = 0.0
            psi = shape(state[TIME], 0.0, state, history, parameters, delayed)
            if parameters[CONTACT] != RIGID:
                # The contact is as far out as it can be, and springs back.
                held = parameters[COULOMB] + state[LEVEL] * psi
                state[DEFLECTION] = state[DIRECTION] * held / parameters[PRESLIDING_STIFFNESS]
                count = record_breakaway(state, parameters, events, count)
            count = arrests(psi, state, events, count)
        if state[DIRECTION] != 0.0:
            psi = shape(state[TIME], state[VELOCITY], state, history, parameters, delayed)
            _rates(_TRIAL, _K1, ahead, reference_velocity, psi, state, parameters, room)
            push_velocity(state[TIME], state[VELOCITY], room[_K1, _V], state, history)
            count = record_breakaway(state, parameters, events, count)
    state[TIME] = end
    return count
