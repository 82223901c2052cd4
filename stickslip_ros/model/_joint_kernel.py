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
from stickslip_ros.model import _creeping_kernel as creeping
from stickslip_ros.model import _two_mass_kernel as two_masses
from stickslip_ros.model._creeping_kernel import creep_until
from stickslip_ros.model._elastic_kernel import PROPAGATORS, hold_until
from stickslip_ros.model._friction_law import CREEPING, RIGID
from stickslip_ros.model._plant_state import (
    CONTACT,
    COULOMB,
    DAMPING,
    DEADBAND,
    DEFLECTION,
    DIRECTION,
    DITHER,
    DITHER_RATE,
    EFFORT,
    ERROR_INTEGRAL,
    EVENT_TIME,
    FADE,
    FEEDBACK,
    FILTER,
    INERTIA,
    INTEGRAL,
    INTEGRAL_GAIN,
    LAG,
    LEVEL,
    LOAD,
    LOAD_POSITION,
    LOAD_VELOCITY,
    MEASURED,
    MOST_EVENTS,
    ON_LOAD,
    POSITION,
    PRESLIDING_STIFFNESS,
    PUSH,
    RESOLUTION,
    RISE_TIME,
    SPEED,
    SPRING,
    STIFFNESS,
    STRIBECK,
    TIME,
    VELOCITY,
    VISCOUS,
    WIDTH,
    arrests,
    breaks_away,
    control,
    instant_shape,
    push_velocity,
    record_breakaway,
    risen_level,
    shape,
)
from stickslip_ros.model._two_mass_kernel import swing_until

# Of the rows that integrate step by step, whichever kernel does: it has room for both.
_ROOM = (max(creeping.ROOM[0], two_masses.ROOM[0]), max(creeping.ROOM[1], two_masses.ROOM[1]))


@helper()
def _acceleration(position, velocity, integral, reference, reference_velocity, psi, state, parameters):
    """Acceleration of Eq. (4), sliding in the direction of the state."""
    direction = state[DIRECTION]
    force = control(position, velocity, integral, reference, reference_velocity, parameters) - parameters[LOAD]
    force -= direction * (parameters[COULOMB] + state[LEVEL] * psi) + parameters[VISCOUS] * velocity
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
    s = shape_1 if delayed else instant_shape(v2, parameters)
    a2 = _acceleration(x2, v2, z + half * z1, middle, reference_velocity, s, state, parameters)
    x3, v3 = x + half * v2, v + half * a2
    z3 = middle - x3
    s = shape_1 if delayed else instant_shape(v3, parameters)
    a3 = _acceleration(x3, v3, z + half * z2, middle, reference_velocity, s, state, parameters)
    x4, v4 = x + step * v3, v + step * a3
    z4 = end - x4
    s = shape_2 if delayed else instant_shape(v4, parameters)
    a4 = _acceleration(x4, v4, z + step * z3, end, reference_velocity, s, state, parameters)
    out[0] = x + step / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
    out[1] = v + step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    out[2] = z + step / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)


@helper()
def _excess(dwell, time, start, reference, reference_velocity, state, parameters):
    """Applied force less what static friction can hold, at ``time``; > 0 breaks away. Sign of the force second."""
    elapsed = time - start
    error = reference - state[POSITION]
    integral = state[INTEGRAL] + error * elapsed + 0.5 * reference_velocity * elapsed * elapsed
    force = (
        control(
            state[POSITION], 0.0, integral, reference + reference_velocity * elapsed, reference_velocity, parameters
        )
        - parameters[LOAD]
    )
    level = risen_level(state[LEVEL], parameters[STRIBECK], dwell, parameters[RISE_TIME])
    return abs(force) - parameters[COULOMB] - level, 1.0 if force >= 0.0 else -1.0


@inlined()
def _stick_until(end, reference, reference_velocity, state, parameters):
    """Advance a stuck joint to ``end`` or to its breakaway; true if it breaks away."""
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
        breaks_away(breakaway, sign_later, state, parameters)
    return broken


@helper()
def advance_period(state, history, parameters, step, period_end, reference_now, velocity_d, workspace, events, count):
    """Integrate one joint to ``period_end``, its reference at ``reference_now`` and moving on with ``velocity_d``.

    ``workspace`` is of :func:`_make_workspace`. Returns the number of events so far, of which ``count`` came before.
    """
    out, propagators, kept, room = workspace
    contact = parameters[CONTACT]
    delayed = parameters[LAG] > 1e-3 * step
    if contact == CREEPING:
        return creep_until(
            period_end, reference_now, velocity_d, state, history, parameters, delayed, room, events, count
        )
    if parameters[SPRING] > 0.0:
        return swing_until(
            period_end, reference_now, velocity_d, step, state, history, parameters, delayed, room, events, count
        )
    longest = min(step, parameters[LAG]) if delayed else step
    before, period_start = count, state[TIME]
    while state[TIME] < period_end - 1e-12:
        time = state[TIME]
        reference = reference_now + velocity_d * (time - period_start)
        if state[DIRECTION] == 0.0:
            if count - before >= MOST_EVENTS:
                # Ever shorter hops, without end: the joint creeps, and rests as far as can be seen.
                state[TIME] = period_end
                continue
            if contact == RIGID:
                broken = _stick_until(period_end, reference, velocity_d, state, parameters)
            else:
                broken = hold_until(period_end, reference, velocity_d, state, parameters, propagators, kept, out)
            if broken:
                count = record_breakaway(state, parameters, events, count)
                moved_on = reference + velocity_d * (state[TIME] - time)
                acceleration = _acceleration(
                    state[POSITION], state[VELOCITY], state[INTEGRAL], moved_on, velocity_d, 1.0, state, parameters
                )
                push_velocity(state[TIME], state[VELOCITY], acceleration, state, history)
            continue
        size = min(longest, period_end - time)
        if delayed:
            memory_begins = state[EVENT_TIME] + parameters[LAG]
            if time < memory_begins - 1e-12 and time + size > memory_begins:
                size = memory_begins - time
        direction = state[DIRECTION]
        shape_0 = shape(time, state[VELOCITY], state, history, parameters, delayed)
        shape_1 = shape(time + 0.5 * size, 0.0, state, history, parameters, delayed) if delayed else 1.0
        shape_2 = shape(time + size, 0.0, state, history, parameters, delayed) if delayed else 1.0
        _slide(size, reference, velocity_d, shape_0, shape_1, shape_2, state, parameters, delayed, out)
        if out[1] * direction < 0.0:
            low, high = 0.0, size
            for _ in range(60):
                middle = 0.5 * (low + high)
                if delayed:
                    shape_1 = shape(time + 0.5 * middle, 0.0, state, history, parameters, delayed)
                    shape_2 = shape(time + middle, 0.0, state, history, parameters, delayed)
                _slide(middle, reference, velocity_d, shape_0, shape_1, shape_2, state, parameters, delayed, out)
                if out[1] * direction < 0.0:
                    high = middle
                else:
                    low = middle
            state[TIME] = time + high
            state[POSITION], state[VELOCITY], state[INTEGRAL] = out[0], 0.0, out[2]
            psi = shape(state[TIME], 0.0, state, history, parameters, delayed)
            if contact != RIGID:
                # The contact is as far out as it can be, and springs back.
                held = parameters[COULOMB] + state[LEVEL] * psi
                state[DEFLECTION] = direction * held / parameters[PRESLIDING_STIFFNESS]
                count = record_breakaway(state, parameters, events, count)
            count = arrests(psi, state, events, count)
            continue
        state[TIME] = time + size
        state[POSITION], state[VELOCITY], state[INTEGRAL] = out[0], out[1], out[2]
        shape_2 = shape(state[TIME], state[VELOCITY], state, history, parameters, delayed)
        acceleration = _acceleration(
            out[0], out[1], out[2], reference + velocity_d * size, velocity_d, shape_2, state, parameters
        )
        push_velocity(state[TIME], out[1], acceleration, state, history)
        count = record_breakaway(state, parameters, events, count)
    state[TIME] = period_end
    return count


@inlined()
def _make_workspace():
    return np.empty(3), np.empty(PROPAGATORS), np.zeros(1), np.empty(_ROOM)


@inlined()
def _compensating(time, reference, position, period, compensation, held):
    """Torque of a friction compensation that sees a quantized position at the start of each period."""
    resolution = compensation[RESOLUTION]
    measured = resolution * np.floor(position / resolution + 0.5) if resolution > 0.0 else position
    speed = (measured - held[MEASURED]) / period
    held[MEASURED] = measured
    held[SPEED] += (speed - held[SPEED]) * compensation[FILTER]
    torque = compensation[FEEDBACK] * np.tanh(held[SPEED] / compensation[WIDTH])
    error = reference - measured
    fading = 1.0 - abs(held[SPEED]) / compensation[FADE]
    if fading > 0.0 and abs(error) > compensation[DEADBAND]:
        torque += compensation[PUSH] * fading * (1.0 if error > 0.0 else -1.0)
    return torque + compensation[DITHER] * np.sin(compensation[DITHER_RATE] * time)


@kernel(nogil=True)
def advance(
    state, history, parameters, held, sampled, delayed, step, period,
    references, reference_velocities, added, compensation, samples, events,
):  # fmt: skip
    """Integrate one joint over as many sampling periods as there are references.

    ``references[i]`` is the desired position at the start of period i, which moves on with
    ``reference_velocities[i]`` during it; ``added[i]`` is a torque of the controller through it. Writes to
    ``samples[i]`` the position, velocity and control effort at the end of period i; returns the number of events, of
    which as many as fit stand in ``events``.

    A controller that is ``sampled`` does so at the start of each period and holds its effort, which is what ``samples``
    then have; a ``compensation`` is sampled in any case. ``held`` keeps the effort last computed, which a delayed
    controller applies one period later, and the controller's own integral, position and speed.
    """
    plant = parameters.copy()
    seen, seen_velocity = POSITION, VELOCITY
    if parameters[ON_LOAD] > 0.0:
        seen, seen_velocity = LOAD_POSITION, LOAD_VELOCITY
    if sampled:
        plant[STIFFNESS] = plant[DAMPING] = plant[INTEGRAL_GAIN] = 0.0
    count = np.int64(0)
    applied, origin, workspace = 0.0, state[TIME], _make_workspace()
    for i in range(references.shape[0]):
        reference, velocity_d = references[i], reference_velocities[i]
        effort = added[i]
        if compensation[FILTER] > 0.0:
            effort += _compensating(origin + i * period, reference, state[seen], period, compensation, held)
        if sampled:
            error = reference - state[seen]
            held[ERROR_INTEGRAL] += error * period
            effort += (
                parameters[STIFFNESS] * error
                + parameters[DAMPING] * (velocity_d - state[seen_velocity])
                + parameters[INTEGRAL_GAIN] * held[ERROR_INTEGRAL]
            )
        applied = held[EFFORT] if delayed else effort
        held[EFFORT] = effort
        plant[LOAD] = parameters[LOAD] - applied
        count = advance_period(
            state, history, plant, step, origin + (i + 1) * period, reference, velocity_d, workspace, events, count
        )
        samples[i, 0] = state[seen]
        samples[i, 1] = state[seen_velocity]
        samples[i, 2] = applied
        if not sampled:
            samples[i, 2] += control(
                state[seen], state[seen_velocity], state[INTEGRAL], reference + velocity_d * period, velocity_d, plant
            )
    return count
