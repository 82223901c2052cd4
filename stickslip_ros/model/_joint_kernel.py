# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled integration of Eqs (4)-(6) for one joint; :mod:`stickslip_ros.model.joint_simulation` is its face.

Kept apart because importing numba costs more than the rest of the floor together. Here is the controller; the joint
between two of its looks is ``_plant_kernel``'s, on a contact that creeps ``_creeping_kernel``'s.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import inlined, kernel
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._creeping_kernel import ROOM, creep_until
from stickslip_ros.model._elastic_kernel import PROPAGATORS
from stickslip_ros.model._friction_law import CREEPING
from stickslip_ros.model._plant_kernel import TRIAL, move_until
from stickslip_ros.model._plant_state import control


@inlined()
def _compensating(time, reference, position, period, compensation, held):
    """Torque of a friction compensation that sees a quantized position at the start of each period."""
    resolution = compensation[at.RESOLUTION]
    measured = resolution * np.floor(position / resolution + 0.5) if resolution > 0.0 else position
    speed = (measured - held[at.MEASURED]) / period
    held[at.MEASURED] = measured
    held[at.SPEED] += (speed - held[at.SPEED]) * compensation[at.FILTER]
    torque = compensation[at.FEEDBACK] * np.tanh(held[at.SPEED] / compensation[at.WIDTH])
    error = reference - measured
    fading = 1.0 - abs(held[at.SPEED]) / compensation[at.FADE]
    if fading > 0.0 and abs(error) > compensation[at.DEADBAND]:
        torque += compensation[at.PUSH] * fading * (1.0 if error > 0.0 else -1.0)
    return torque + compensation[at.DITHER] * np.sin(compensation[at.DITHER_RATE] * time)


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
    seen, seen_velocity = at.POSITION, at.VELOCITY
    if parameters[at.ON_LOAD] > 0.0:
        seen, seen_velocity = at.LOAD_POSITION, at.LOAD_VELOCITY
    if sampled:
        plant[at.STIFFNESS] = plant[at.DAMPING] = plant[at.INTEGRAL_GAIN] = 0.0
    count = np.int64(0)
    applied, origin, lagged = 0.0, state[at.TIME], parameters[at.LAG] > 1e-3 * step
    room, trial, propagators, kept = np.empty(ROOM), np.empty(TRIAL), np.empty(PROPAGATORS), np.zeros(1)
    for i in range(references.shape[0]):
        reference, velocity_d = references[i], reference_velocities[i]
        effort = added[i]
        if compensation[at.FILTER] > 0.0:
            effort += _compensating(origin + i * period, reference, state[seen], period, compensation, held)
        if sampled:
            error = reference - state[seen]
            held[at.ERROR_INTEGRAL] += error * period
            effort += (
                parameters[at.STIFFNESS] * error
                + parameters[at.DAMPING] * (velocity_d - state[seen_velocity])
                + parameters[at.INTEGRAL_GAIN] * held[at.ERROR_INTEGRAL]
            )
        applied = held[at.EFFORT] if delayed else effort
        held[at.EFFORT] = effort
        plant[at.LOAD] = parameters[at.LOAD] - applied
        end = origin + (i + 1) * period
        if parameters[at.CONTACT] == CREEPING:
            count = creep_until(end, reference, velocity_d, state, history, plant, lagged, room, events, count)
        else:
            count = move_until(
                end, reference, velocity_d, step, state, history, plant, lagged, trial, propagators, kept, events, count
            )
        samples[i, 0] = state[seen]
        samples[i, 1] = state[seen_velocity]
        samples[i, 2] = applied
        if not sampled:
            ahead = reference + velocity_d * period
            samples[i, 2] += control(state[seen], state[seen_velocity], state[at.INTEGRAL], ahead, velocity_d, plant)
    return count
