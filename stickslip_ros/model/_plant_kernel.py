# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled: a joint that sticks and slides, rigid or of two masses on a spring (:mod:`.transmission`).

    M x¨ = u(t) − friction − (k_s (x − y) + d_s (x˙ − y˙)),    M_l y¨ = k_s (x − y) + d_s (x˙ − y˙)

with all friction at the motor; a rigid joint has no load of its own, and no spring.

The steps are Runge-Kutta's of order four, short beside the fastest motion. They end at the sampling instants and, since
the friction's derivative jumps there, at breakaway + lag. The velocity one lag ago comes from a ring of
(time, velocity, acceleration) since breakaway, by cubic Hermite interpolation; a step is never longer than the lag, so
that it is always known. Arrest and breakaway are located by bisecting the step, to round-off. A rigid joint that sticks
takes one step to its breakaway; on an elastic contact it is ``_elastic_kernel``'s. Where a motor sticks the load rings,
and the spring's force counts in the balance at breakaway.
"""

from __future__ import annotations

from stickslip_ros.compilation import helper
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._elastic_kernel import hold_until
from stickslip_ros.model._friction_law import RIGID
from stickslip_ros.model._plant_state import (
    arrests,
    breaks_away,
    control,
    level_at,
    push_velocity,
    record_breakaway,
    shape,
)

_BISECTIONS = 60  # of a step
_TOGETHER = 1e-12  # s, between instants that are one
# A step's end: the motor's position and velocity, the error's integral, the load's position and velocity.
_X, _V, _Z, _Y, _W = range(5)
TRIAL = _W + 1


@helper()
def _force(x, v, z, y, w, reference, reference_velocity, parameters):
    """What acts on the motor, but for friction; and the spring's force on the load."""
    spring, position, velocity = 0.0, x, v
    if parameters[at.SPRING] > 0.0:
        spring = parameters[at.SPRING] * (x - y) + parameters[at.SPRING_DAMPING] * (v - w)
        if parameters[at.ON_LOAD] > 0.0:
            position, velocity = y, w
    effort = control(position, velocity, z, reference, reference_velocity, parameters)
    return effort - parameters[at.LOAD] - spring, spring


@helper()
def _rates(x, v, z, y, w, reference, reference_velocity, psi, state, parameters):
    """Slopes of the motor's velocity, the error's integral and the load's velocity."""
    direction = state[at.DIRECTION]
    force, spring = _force(x, v, z, y, w, reference, reference_velocity, parameters)
    if direction != 0.0:
        force -= direction * (parameters[at.COULOMB] + state[at.LEVEL] * psi) + parameters[at.VISCOUS] * v
    elif parameters[at.CONTACT] != RIGID:
        force -= parameters[at.PRESLIDING_STIFFNESS] * (state[at.DEFLECTION] + x - state[at.POSITION])
        force -= (parameters[at.PRESLIDING_DAMPING] + parameters[at.VISCOUS]) * v
    else:
        force = 0.0
    error = reference - (y if parameters[at.ON_LOAD] > 0.0 else x)
    return force / parameters[at.INERTIA], error, spring / parameters[at.LOAD_INERTIA] if spring != 0.0 else 0.0


@helper()
def _rates_now(reference, reference_velocity, state, history, parameters, delayed):
    """The same in the state."""
    psi = 1.0
    if state[at.DIRECTION] != 0.0:
        psi = shape(state[at.TIME], state[at.VELOCITY], state, history, parameters, delayed)
    return _rates(
        state[at.POSITION], state[at.VELOCITY], state[at.INTEGRAL], state[at.LOAD_POSITION], state[at.LOAD_VELOCITY],
        reference, reference_velocity, psi, state, parameters,
    )  # fmt: skip


@helper()
def _try(size, reference, reference_velocity, rates, state, history, parameters, delayed, trial):
    """One step from the state with its slopes, into ``trial``; the reference at the step's start."""
    x, v, z = state[at.POSITION], state[at.VELOCITY], state[at.INTEGRAL]
    y, w = state[at.LOAD_POSITION], state[at.LOAD_VELOCITY]
    dv, dz, dw = rates
    pace, load_pace, psi = v, w, 1.0
    sum_x, sum_v, sum_z, sum_y, sum_w = v, dv, dz, w, dw
    for stage in range(1, 4):
        share, weight = (size, 1.0) if stage == 3 else (0.5 * size, 2.0)
        at_x, at_y, at_z = x + share * pace, y + share * load_pace, z + share * dz
        pace, load_pace = v + share * dv, w + share * dw
        if state[at.DIRECTION] != 0.0 and (stage != 2 or not delayed):
            psi = shape(state[at.TIME] + share, pace, state, history, parameters, delayed)
        now = reference + reference_velocity * share
        dv, dz, dw = _rates(at_x, pace, at_z, at_y, load_pace, now, reference_velocity, psi, state, parameters)
        sum_x, sum_v, sum_z = sum_x + weight * pace, sum_v + weight * dv, sum_z + weight * dz
        sum_y, sum_w = sum_y + weight * load_pace, sum_w + weight * dw
    sixth = size / 6.0
    trial[_X], trial[_V], trial[_Z] = x + sixth * sum_x, v + sixth * sum_v, z + sixth * sum_z
    trial[_Y], trial[_W] = y + sixth * sum_y, w + sixth * sum_w


@helper()
def _contact_force(trial, reference, reference_velocity, state, parameters):
    """What static friction has to hold of a motor at rest."""
    if parameters[at.CONTACT] != RIGID:
        return parameters[at.PRESLIDING_STIFFNESS] * (state[at.DEFLECTION] + trial[_X] - state[at.POSITION])
    return _force(
        trial[_X], trial[_V], trial[_Z], trial[_Y], trial[_W], reference, reference_velocity, parameters
    )[0]  # fmt: skip


@helper()
def _ends(trial, time, reference, reference_velocity, state, parameters):
    """Whether the slip, or the rest, of the state has ended where a step has led to at a time."""
    if state[at.DIRECTION] != 0.0:
        return trial[_V] * state[at.DIRECTION] < 0.0
    held = parameters[at.COULOMB] + level_at(time, state, parameters)
    return abs(_contact_force(trial, reference, reference_velocity, state, parameters)) > held


@helper()
def move_until(
    end, reference, reference_velocity, step, state, history, parameters, delayed, trial, propagators, kept, events,
    count,
):  # fmt: skip
    """Integrate to ``end``, through slips and rests; returns the number of events."""
    before, start = count, state[at.TIME]
    rigid, one_mass = parameters[at.CONTACT] == RIGID, parameters[at.SPRING] == 0.0
    rates, known = (0.0, 0.0, 0.0), False
    while state[at.TIME] < end - _TOGETHER:
        time, rests = state[at.TIME], state[at.DIRECTION] == 0.0
        ahead = reference + reference_velocity * (time - start)
        if rests and count - before >= at.MOST_EVENTS:
            # Ever shorter hops, without end: the joint creeps, and rests as far as can be seen.
            break
        if rests and one_mass and not rigid:
            if not hold_until(end, ahead, reference_velocity, state, parameters, propagators, kept, trial):
                continue
            ahead += reference_velocity * (state[at.TIME] - time)
        else:
            size = end - time
            if not (rests and one_mass):
                size = min(size, step)
            if not rests and delayed:
                size = min(size, parameters[at.LAG])
                memory_begins = state[at.EVENT_TIME] + parameters[at.LAG]
                if time < memory_begins - _TOGETHER and time + size > memory_begins:
                    size = memory_begins - time
            if not known:
                rates = _rates_now(ahead, reference_velocity, state, history, parameters, delayed)
            ended, cursor = False, state[at.HISTORY_CURSOR]
            if rests and rigid:
                # A controller may jump, the deflection of a contact not.
                trial[_X], trial[_V], trial[_Z] = state[at.POSITION], state[at.VELOCITY], state[at.INTEGRAL]
                trial[_Y], trial[_W] = state[at.LOAD_POSITION], state[at.LOAD_VELOCITY]
                ended = _ends(trial, time, ahead, reference_velocity, state, parameters)
            if ended:
                size = 0.0
            _try(size, ahead, reference_velocity, rates, state, history, parameters, delayed, trial)
            now = ahead + reference_velocity * size
            if not ended and _ends(trial, time + size, now, reference_velocity, state, parameters):
                ended, low, high = True, 0.0, size
                for bisection in range(_BISECTIONS + 1):
                    # At last at the end that is found.
                    size = 0.5 * (low + high) if bisection < _BISECTIONS else high
                    state[at.HISTORY_CURSOR] = cursor
                    _try(size, ahead, reference_velocity, rates, state, history, parameters, delayed, trial)
                    now = ahead + reference_velocity * size
                    if _ends(trial, time + size, now, reference_velocity, state, parameters):
                        high = size
                    else:
                        low = size
            ahead = now
            holding = _contact_force(trial, ahead, reference_velocity, state, parameters)
            state[at.TIME] = time + size
            state[at.DEFLECTION] += trial[_X] - state[at.POSITION]
            state[at.POSITION], state[at.VELOCITY], state[at.INTEGRAL] = trial[_X], trial[_V], trial[_Z]
            state[at.LOAD_POSITION], state[at.LOAD_VELOCITY] = trial[_Y], trial[_W]
            if ended and rests:
                breaks_away(state[at.TIME], 1.0 if holding >= 0.0 else -1.0, state, parameters)
            elif ended:
                state[at.VELOCITY] = 0.0
                psi = shape(state[at.TIME], 0.0, state, history, parameters, delayed)
                if not rigid:
                    # The contact is as far out as it can be, and springs back.
                    held = parameters[at.COULOMB] + state[at.LEVEL] * psi
                    state[at.DEFLECTION] = state[at.DIRECTION] * held / parameters[at.PRESLIDING_STIFFNESS]
                    count = record_breakaway(state, parameters, events, count)
                count = arrests(psi, state, events, count)
        known = state[at.DIRECTION] != 0.0
        if known:
            rates = _rates_now(ahead, reference_velocity, state, history, parameters, delayed)
            push_velocity(state[at.TIME], state[at.VELOCITY], rates[0], state, history)
            count = record_breakaway(state, parameters, events, count)
    state[at.TIME] = end
    return count
