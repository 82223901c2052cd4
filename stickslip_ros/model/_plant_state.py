# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Plant state: indices of the vectors of the compiled integration of one joint; its friction, slips and rests."""

from __future__ import annotations

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model import _friction_law
from stickslip_ros.model._friction_law import RIGID

# Indices of the state vector. DEFLECTION is of the contact, STEP the integration's last one where it chooses them.
# A slip begins at SLIP_FROM; while it is PENDING it may come to nothing, and the rest of REST_TIME, REST_LEVEL goes on.
# Of two masses on a spring the motor's are POSITION and VELOCITY; a rigid joint has nothing at the load's.
(
    TIME, POSITION, VELOCITY, INTEGRAL, DIRECTION, EVENT_TIME, LEVEL, HISTORY_HEAD, HISTORY_COUNT, HISTORY_CURSOR,
    DEFLECTION, STEP, SLIP_FROM, PENDING, REST_TIME, REST_LEVEL, LOAD_POSITION, LOAD_VELOCITY,
) = range(18)  # fmt: skip
STATE_SIZE = LOAD_VELOCITY + 1
MOST_EVENTS = 64  # events in one sampling period, 1
# Indices of the parameter vector: the parameters in the order of the table in `friction`, then all else. INERTIA is the
# motor's where there is a SPRING, of stiffness 0 where there is none. ON_LOAD: 1 where the load is what is measured.
(
    INERTIA, COULOMB, VISCOUS, STRIBECK, STRIBECK_VELOCITY, LAG, RISE_TIME, PRESLIDING_STIFFNESS, PRESLIDING_DAMPING,
    LAW, CONTACT, STIFFNESS, DAMPING, INTEGRAL_GAIN, LOAD, LOAD_INERTIA, SPRING, SPRING_DAMPING, ON_LOAD,
) = range(19)  # fmt: skip
PARAMETERS_SIZE = ON_LOAD + 1
# What a controller holds from one period to the next.
EFFORT, ERROR_INTEGRAL, MEASURED, SPEED = range(4)
# A friction compensation; FILTER is the share of a new speed in the filtered one, 0 where nothing is compensated.
FEEDBACK, WIDTH, PUSH, FADE, DEADBAND, DITHER, DITHER_RATE, FILTER, RESOLUTION = range(9)
COMPENSATION_SIZE = RESOLUTION + 1
# Columns of an event.
EVENT_COLUMNS = 5  # time, +1 breakaway / -1 arrest, direction of the slip, position, Stribeck friction level
BREAKAWAY, ARREST = 1.0, -1.0  # kinds of an event, as a number

_risen_level = inlined()(_friction_law.risen_level)
_stribeck_friction = inlined()(_friction_law.stribeck_friction)


@inlined()
def _lagged_velocity(time, state, history):
    """Velocity at ``time`` from the ring; the cursor only moves forward."""
    count = int(state[HISTORY_COUNT])
    head = int(state[HISTORY_HEAD])
    capacity = history.shape[0]
    oldest = head - count
    cursor = max(int(state[HISTORY_CURSOR]), oldest)
    while cursor + 2 < head and history[(cursor + 1) % capacity, 0] <= time:
        cursor += 1
    state[HISTORY_CURSOR] = cursor
    left, right = cursor % capacity, (cursor + 1) % capacity
    width = history[right, 0] - history[left, 0]
    if width <= 0.0:
        return history[left, 1]
    s = (time - history[left, 0]) / width
    r = 1.0 - s
    return r * r * ((1.0 + 2.0 * s) * history[left, 1] + s * width * history[left, 2]) + s * s * (
        (3.0 - 2.0 * s) * history[right, 1] - r * width * history[right, 2]
    )


@helper()
def shape(time, velocity, state, history, parameters, delayed):
    """Ψ of Eq. (5)."""
    if delayed:
        if time - state[EVENT_TIME] <= parameters[LAG]:
            return 1.0
        velocity = _lagged_velocity(time - parameters[LAG], state, history)
    return _stribeck_friction(parameters[LAW], 1.0, velocity / parameters[STRIBECK_VELOCITY])


@helper()
def control(position, velocity, integral, reference, reference_velocity, parameters):
    """Effort of a controller that acts continuously."""
    return (
        parameters[STIFFNESS] * (reference - position)
        + parameters[DAMPING] * (reference_velocity - velocity)
        + parameters[INTEGRAL_GAIN] * integral
    )


@helper()
def push_velocity(time, velocity, acceleration, state, history):
    """Push a velocity into the ring."""
    head = int(state[HISTORY_HEAD])
    slot = head % history.shape[0]
    history[slot, 0] = time
    history[slot, 1] = velocity
    history[slot, 2] = acceleration
    state[HISTORY_HEAD] = head + 1
    state[HISTORY_COUNT] = min(state[HISTORY_COUNT] + 1, history.shape[0])


@helper()
def _record(events, count, time, kind, position, state):
    if count < events.shape[0]:
        events[count, 0] = time
        events[count, 1] = kind
        events[count, 2] = state[DIRECTION]
        events[count, 3] = position
        events[count, 4] = state[LEVEL]
    return count + 1


@helper()
def level_at(time, state, parameters):
    """F_s of Eq. (6) at a time of the present rest."""
    return _risen_level(state[LEVEL], parameters[STRIBECK], time - state[EVENT_TIME], parameters[RISE_TIME])


@helper()
def breaks_away(time, direction, state, parameters):
    """The slip's beginning; the ring is empty then."""
    state[REST_TIME], state[REST_LEVEL] = state[EVENT_TIME], state[LEVEL]
    state[LEVEL] = level_at(time, state, parameters)
    state[DIRECTION] = direction
    state[EVENT_TIME] = time
    state[SLIP_FROM], state[PENDING] = state[POSITION], 1.0
    state[HISTORY_COUNT] = 0
    state[HISTORY_CURSOR] = state[HISTORY_HEAD]


@helper()
def record_breakaway(state, parameters, events, count):
    """Record a breakaway once the slip has gone far enough to have one; returns the number of events.

    A contact that springs back after an arrest may give way again by next to nothing. It is renewed, and static
    friction begins to rise anew, by a slip that is longer than the deflection which Stribeck friction alone can cause.
    """
    if state[PENDING] == 0.0:
        return count
    if parameters[CONTACT] != RIGID:
        gone = abs(state[POSITION] - state[SLIP_FROM])
        if parameters[PRESLIDING_STIFFNESS] * gone < state[LEVEL]:
            return count
    state[PENDING] = 0.0
    return _record(events, count, state[EVENT_TIME], BREAKAWAY, state[SLIP_FROM], state)


@helper()
def arrests(psi, state, events, count):
    """The slip's end, with what Ψ is then; returns the number of events."""
    if state[PENDING] != 0.0:
        state[EVENT_TIME], state[LEVEL] = state[REST_TIME], state[REST_LEVEL]
    else:
        state[LEVEL] *= psi
        state[EVENT_TIME] = state[TIME]
        count = _record(events, count, state[TIME], ARREST, state[POSITION], state)
    state[DIRECTION] = 0.0
    return count
