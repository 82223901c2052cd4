# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled integration of Eqs (4)-(6) for one joint; :mod:`stickslip_ros.model.joint_simulation` is its face.

Kept apart because importing numba costs more than the rest of the floor together.

Sliding is integrated by Runge-Kutta steps of order four that end at the sampling instants and, since
the friction's derivative jumps there, at breakaway + lag. The velocity one lag ago comes from a ring of
(time, velocity, acceleration) since breakaway, by cubic Hermite interpolation; a step is never longer
than the lag, so it is always known. Arrest is located by re-stepping, breakaway by root finding on the
force balance, both to round-off.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined, kernel
from stickslip_ros.model import _friction_law

# Indices of the state vector.
TIME, POSITION, VELOCITY, INTEGRAL, DIRECTION, EVENT_TIME, LEVEL, HISTORY_HEAD, HISTORY_COUNT, HISTORY_CURSOR = range(
    10
)
STATE_SIZE = 10
# Indices of the parameter vector.
(
    INERTIA, COULOMB, VISCOUS, STRIBECK, STRIBECK_VELOCITY, LAG, RISE_TIME, LAW,
    STIFFNESS, DAMPING, INTEGRAL_GAIN, LOAD,
) = range(12)  # fmt: skip
PARAMETERS_SIZE = 12
# Columns of an event.
EVENT_COLUMNS = 5  # time, +1 breakaway / -1 arrest, direction of the slip, position, Stribeck friction level
BREAKAWAY, ARREST = 1.0, -1.0

_MOST_EVENTS = 64  # in one sampling period


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
def _instant_shape(velocity, parameters):
    return _stribeck_friction(parameters[LAW], 1.0, velocity / parameters[STRIBECK_VELOCITY])


@helper()
def _shape(time, velocity, state, history, parameters, delayed):
    """Ψ of Eq. (5)."""
    if delayed:
        if time - state[EVENT_TIME] <= parameters[LAG]:
            return 1.0
        velocity = _lagged_velocity(time - parameters[LAG], state, history)
    return _instant_shape(velocity, parameters)


@helper()
def _control(position, velocity, integral, reference, reference_velocity, parameters):
    return (
        parameters[STIFFNESS] * (reference - position)
        + parameters[DAMPING] * (reference_velocity - velocity)
        + parameters[INTEGRAL_GAIN] * integral
    )


@helper()
def _acceleration(position, velocity, integral, reference, reference_velocity, shape, state, parameters):
    """Acceleration of Eq. (4), sliding in the direction of the state."""
    direction = state[DIRECTION]
    force = _control(position, velocity, integral, reference, reference_velocity, parameters) - parameters[LOAD]
    force -= direction * (parameters[COULOMB] + state[LEVEL] * shape) + parameters[VISCOUS] * velocity
    return force / parameters[INERTIA]


@helper()
def _slide(step, reference, reference_velocity, shape_0, shape_1, shape_2, state, parameters, delayed, out):
    """One Runge-Kutta step; writes position, velocity, integral to ``out``. Reference at the step's start."""
    x, v, z = state[POSITION], state[VELOCITY], state[INTEGRAL]
    half = 0.5 * step
    middle, end = reference + reference_velocity * half, reference + reference_velocity * step
    a1 = _acceleration(x, v, z, reference, reference_velocity, shape_0, state, parameters)
    z1 = reference - x
    x2, v2 = x + half * v, v + half * a1
    z2 = middle - x2
    s = shape_1 if delayed else _instant_shape(v2, parameters)
    a2 = _acceleration(x2, v2, z + half * z1, middle, reference_velocity, s, state, parameters)
    x3, v3 = x + half * v2, v + half * a2
    z3 = middle - x3
    s = shape_1 if delayed else _instant_shape(v3, parameters)
    a3 = _acceleration(x3, v3, z + half * z2, middle, reference_velocity, s, state, parameters)
    x4, v4 = x + step * v3, v + step * a3
    z4 = end - x4
    s = shape_2 if delayed else _instant_shape(v4, parameters)
    a4 = _acceleration(x4, v4, z + step * z3, end, reference_velocity, s, state, parameters)
    out[0] = x + step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
    out[1] = v + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    out[2] = z + step / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)


@helper()
def _remember(time, velocity, acceleration, state, history):
    head = int(state[HISTORY_HEAD])
    slot = head % history.shape[0]
    history[slot, 0] = time
    history[slot, 1] = velocity
    history[slot, 2] = acceleration
    state[HISTORY_HEAD] = head + 1
    state[HISTORY_COUNT] = min(state[HISTORY_COUNT] + 1, history.shape[0])


@helper()
def _excess(dwell, time, start, reference, reference_velocity, state, parameters):
    """Applied force less what static friction can hold, at ``time``; > 0 breaks away. Sign of the force second."""
    elapsed = time - start
    error = reference - state[POSITION]
    integral = state[INTEGRAL] + error * elapsed + 0.5 * reference_velocity * elapsed * elapsed
    force = (
        _control(
            state[POSITION], 0.0, integral, reference + reference_velocity * elapsed, reference_velocity, parameters
        )
        - parameters[LOAD]
    )
    level = _risen_level(state[LEVEL], parameters[STRIBECK], dwell, parameters[RISE_TIME])
    return abs(force) - parameters[COULOMB] - level, 1.0 if force >= 0.0 else -1.0


@helper()
def _record(events, count, time, kind, state):
    if count < events.shape[0]:
        events[count, 0] = time
        events[count, 1] = kind
        events[count, 2] = state[DIRECTION]
        events[count, 3] = state[POSITION]
        events[count, 4] = state[LEVEL]
    return count + 1


@inlined()
def _stick_until(end, reference, reference_velocity, state, parameters, events, count):
    """Advance a stuck joint to ``end`` or to its breakaway; returns the events' count and the first acceleration."""
    start = state[TIME]
    arrest = state[EVENT_TIME]
    now, sign_now = _excess(start - arrest, start, start, reference, reference_velocity, state, parameters)
    later, sign_later = _excess(end - arrest, end, start, reference, reference_velocity, state, parameters)
    breakaway = end
    broken = False
    if now > 0.0:
        breakaway, broken, sign_later = start, True, sign_now
    elif later > 0.0:
        low, high = start, end
        # The excess is convex in time while the force keeps its sign, so there is one crossing.
        for _ in range(60):
            middle = 0.5 * (low + high)
            if _excess(middle - arrest, middle, start, reference, reference_velocity, state, parameters)[0] > 0.0:
                high = middle
            else:
                low = middle
        breakaway, broken = high, True
    elapsed = breakaway - start
    state[INTEGRAL] += (reference - state[POSITION]) * elapsed + 0.5 * reference_velocity * elapsed * elapsed
    state[TIME] = breakaway
    if broken:
        state[LEVEL] = _risen_level(state[LEVEL], parameters[STRIBECK], breakaway - arrest, parameters[RISE_TIME])
        state[DIRECTION] = sign_later
        state[EVENT_TIME] = breakaway
        state[HISTORY_COUNT] = 0
        state[HISTORY_CURSOR] = state[HISTORY_HEAD]
        acceleration = _acceleration(
            state[POSITION],
            0.0,
            state[INTEGRAL],
            reference + reference_velocity * elapsed,
            reference_velocity,
            1.0,
            state,
            parameters,
        )
        count = _record(events, count, breakaway, BREAKAWAY, state)
        return count, acceleration
    return count, 0.0


@helper()
def advance_period(state, history, parameters, step, period_end, reference_now, velocity_d, out, events, count):
    """Integrate one joint to ``period_end``, its reference at ``reference_now`` and moving on with ``velocity_d``.

    ``out`` is room for three numbers. Returns the number of events so far, of which ``count`` came before.
    """
    delayed = parameters[LAG] > 1e-3 * step
    longest = min(step, parameters[LAG]) if delayed else step
    before, period_start = count, state[TIME]
    while state[TIME] < period_end - 1e-12:
        time = state[TIME]
        reference = reference_now + velocity_d * (time - period_start)
        if state[DIRECTION] == 0.0:
            if count - before >= _MOST_EVENTS:
                # Ever shorter hops, without end: the joint creeps, and rests as far as can be seen.
                state[TIME] = period_end
                continue
            count, acceleration = _stick_until(period_end, reference, velocity_d, state, parameters, events, count)
            if state[DIRECTION] != 0.0:
                _remember(state[TIME], 0.0, acceleration, state, history)
            continue
        size = min(longest, period_end - time)
        if delayed:
            memory_begins = state[EVENT_TIME] + parameters[LAG]
            if time < memory_begins - 1e-12 and time + size > memory_begins:
                size = memory_begins - time
        direction = state[DIRECTION]
        shape_0 = _shape(time, state[VELOCITY], state, history, parameters, delayed)
        shape_1 = _shape(time + 0.5 * size, 0.0, state, history, parameters, delayed) if delayed else 1.0
        shape_2 = _shape(time + size, 0.0, state, history, parameters, delayed) if delayed else 1.0
        _slide(size, reference, velocity_d, shape_0, shape_1, shape_2, state, parameters, delayed, out)
        if out[1] * direction < 0.0:
            low, high = 0.0, size
            for _ in range(60):
                middle = 0.5 * (low + high)
                if delayed:
                    shape_1 = _shape(time + 0.5 * middle, 0.0, state, history, parameters, delayed)
                    shape_2 = _shape(time + middle, 0.0, state, history, parameters, delayed)
                _slide(middle, reference, velocity_d, shape_0, shape_1, shape_2, state, parameters, delayed, out)
                if out[1] * direction < 0.0:
                    high = middle
                else:
                    low = middle
            state[TIME] = time + high
            state[LEVEL] *= _shape(state[TIME], 0.0, state, history, parameters, delayed)
            state[POSITION], state[VELOCITY], state[INTEGRAL] = out[0], 0.0, out[2]
            state[EVENT_TIME] = state[TIME]
            count = _record(events, count, state[TIME], ARREST, state)
            state[DIRECTION] = 0.0
            continue
        state[TIME] = time + size
        state[POSITION], state[VELOCITY], state[INTEGRAL] = out[0], out[1], out[2]
        shape_2 = _shape(state[TIME], state[VELOCITY], state, history, parameters, delayed)
        acceleration = _acceleration(
            out[0], out[1], out[2], reference + velocity_d * size, velocity_d, shape_2, state, parameters
        )
        _remember(state[TIME], out[1], acceleration, state, history)
    state[TIME] = period_end
    return count


@kernel(nogil=True)
def advance(
    state, history, parameters, held, sampled, delayed, step, period, references, reference_velocities, samples, events
):
    """Integrate one joint over as many sampling periods as there are references.

    ``references[i]`` is the desired position at the start of period i, which moves on with
    ``reference_velocities[i]`` during it. Writes to ``samples[i]`` the position, velocity and control
    effort at the end of period i; returns the number of events, of which as many as fit stand in
    ``events``.

    A controller that is ``sampled`` does so at the start of each period and holds its effort, which is what ``samples``
    then have. ``held`` keeps the effort last computed, which a delayed controller applies one period later, and the
    controller's own integral.
    """
    plant = parameters.copy()
    if sampled:
        plant[STIFFNESS] = plant[DAMPING] = plant[INTEGRAL_GAIN] = 0.0
    count = np.int64(0)
    applied, origin, out = 0.0, state[TIME], np.empty(3)
    for i in range(references.shape[0]):
        reference, velocity_d = references[i], reference_velocities[i]
        if sampled:
            error = reference - state[POSITION]
            held[1] += error * period
            effort = (
                parameters[STIFFNESS] * error
                + parameters[DAMPING] * (velocity_d - state[VELOCITY])
                + parameters[INTEGRAL_GAIN] * held[1]
            )
            applied = held[0] if delayed else effort
            held[0] = effort
            plant[LOAD] = parameters[LOAD] - applied
        count = advance_period(
            state, history, plant, step, origin + (i + 1) * period, reference, velocity_d, out, events, count
        )
        samples[i, 0] = state[POSITION]
        samples[i, 1] = state[VELOCITY]
        samples[i, 2] = (
            applied
            if sampled
            else _control(
                state[POSITION], state[VELOCITY], state[INTEGRAL], reference + velocity_d * period, velocity_d, plant
            )
        )
    return count
