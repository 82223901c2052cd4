# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled simulation of measured slips from their own starts, by the paper's law; :mod:`.slip_problem` is its face."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.model import _friction_law
from stickslip_ros.model import _joint_kernel as kernel

# Indices of the parameter vector.
INERTIA, VISCOUS, STRIBECK_VELOCITY, LAG, STRIBECK, RISE_TIME = range(6)
# Columns of a slip's start.
POSITION, BREAKAWAY, LEVEL = range(3)
# Columns of what is found of a slip: the force on the joint at breakaway in the slip's direction, when and where
# it ends, and the factor by which the Stribeck friction is less there than at breakaway.
HELD, ARREST, ARREST_POSITION, REMAINS = range(4)
FOUND_COLUMNS = 4

_NO_RETURN = 100.0  # levels

_stribeck_friction = inlined()(_friction_law.stribeck_friction)


@helper()
def _at(time, node, times, values):
    """A value at ``time`` on the line through a node and the next."""
    share = (time - times[node]) / (times[node + 1] - times[node])
    return values[node] + (values[node + 1] - values[node]) * share


@compiled(nogil=True)
def simulate_windows(
    parameters, directions, starts, gains, edges, times, references, forces, step, positions, velocities, found
):
    """Simulate slip n from its start over the nodes ``edges[n]`` to ``edges[n + 1]``.

    Between nodes the reference and the force beside the controller's are linear. What holds the joint at its
    breakaway beside the Stribeck friction is its kinetic friction, with any load, during the slip. It may
    stop and go on within the window, but does not turn.
    """
    state = np.zeros(kernel.STATE_SIZE)
    plant = np.zeros(kernel.PARAMETERS_SIZE)
    plant[kernel.INERTIA] = parameters[INERTIA]
    plant[kernel.VISCOUS] = parameters[VISCOUS]
    plant[kernel.STRIBECK_VELOCITY] = parameters[STRIBECK_VELOCITY]
    plant[kernel.LAG] = parameters[LAG]
    plant[kernel.STRIBECK] = parameters[STRIBECK]
    plant[kernel.RISE_TIME] = parameters[RISE_TIME]
    plant[kernel.LAW] = _friction_law.HESS_SOOM
    # Steps end at nodes and are no longer than the lag.
    room = 2 * int(parameters[LAG] / step) + 64
    for n in range(directions.shape[0]):
        room = max(room, 2 * int(parameters[LAG] / step) + 64 + edges[n + 1] - edges[n])
    history = np.zeros((room, 3))
    events = np.zeros((4, kernel.EVENT_COLUMNS))
    out = np.empty(3)
    before = np.int64(0)
    for n in range(directions.shape[0]):
        first, last = edges[n], edges[n + 1] - 1
        rest, begin, level = starts[n, POSITION], starts[n, BREAKAWAY], starts[n, LEVEL]
        stiffness, damping = gains[n, 0], gains[n, 1]
        plant[kernel.STIFFNESS], plant[kernel.DAMPING] = stiffness, damping
        node = first
        while node + 2 <= last and times[node + 1] <= begin:
            node += 1
        rate = (references[node + 1] - references[node]) / (times[node + 1] - times[node])
        force = stiffness * (_at(begin, node, times, references) - rest) + damping * rate
        held = directions[n] * (force + _at(begin, node, times, forces))
        # So much friction, and a load that takes it back, that the joint cannot turn.
        kinetic = held - level
        coulomb = 2.0 * abs(kinetic) + _NO_RETURN * level
        back = directions[n] * (coulomb - kinetic)
        plant[kernel.COULOMB] = coulomb
        for i in range(kernel.STATE_SIZE):
            state[i] = 0.0
        state[kernel.TIME] = begin
        state[kernel.POSITION] = rest
        state[kernel.DIRECTION] = directions[n]
        state[kernel.EVENT_TIME] = begin
        state[kernel.LEVEL] = level
        state[kernel.HISTORY_COUNT] = 1
        state[kernel.HISTORY_HEAD] = 1
        history[0, 0], history[0, 1], history[0, 2] = begin, 0.0, 0.0
        for i in range(first, node + 1):
            positions[i], velocities[i] = rest, 0.0
        found[n, HELD] = held
        found[n, ARREST] = math.nan
        while node < last:
            time = state[kernel.TIME]
            speed = (references[node + 1] - references[node]) / (times[node + 1] - times[node])
            reference = references[node] + speed * (time - times[node])
            plant[kernel.LOAD] = -_at(0.5 * (time + times[node + 1]), node, times, forces) - back
            count = kernel.advance_period(
                state, history, plant, step, times[node + 1], reference, speed, out, events, before
            )
            for i in range(min(count, events.shape[0])):
                if events[i, 1] == kernel.ARREST:
                    found[n, ARREST], found[n, ARREST_POSITION] = events[i, 0], events[i, 3]
                    found[n, REMAINS] = events[i, 4] / level
            node += 1
            positions[node], velocities[node] = state[kernel.POSITION], state[kernel.VELOCITY]
        if math.isnan(found[n, ARREST]):
            ratio = velocities[last] / parameters[STRIBECK_VELOCITY]
            found[n, ARREST_POSITION] = positions[last]
            found[n, REMAINS] = _stribeck_friction(plant[kernel.LAW], 1.0, ratio)
