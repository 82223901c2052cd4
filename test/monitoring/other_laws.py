# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joints that obey other laws than the paper's: LuGre, an exponential Stribeck curve, Coulomb friction under load.

Integrated by small fixed steps, compiled; stiction without bristles is by a force balance at zero velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

LUGRE, EXPONENTIAL, LOAD_DEPENDENT = range(3)
_STEPS = 20  # in a sample


@dataclass(frozen=True)
class OtherJoint:
    """A joint of another law.

    Attributes
    ----------
    law : one of the module's constants.
    inertia, coulomb, stribeck, stribeck_velocity, viscous : as of the paper's law.
    extra : bristle stiffness [N·m/rad] for LUGRE; the exponent of the curve for EXPONENTIAL; by how much of
        the applied force Coulomb friction grows for LOAD_DEPENDENT.
    """

    law: int
    inertia: float
    coulomb: float
    stribeck: float
    stribeck_velocity: float
    viscous: float
    extra: float

    def simulate(
        self, stiffness: float, damping: float, references: np.ndarray, velocities: np.ndarray, period: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity at the start of every period, from rest at zero."""
        plant = np.array([self.inertia, self.coulomb, self.stribeck, self.stribeck_velocity, self.viscous, self.extra])
        return _integrate(self.law, plant, stiffness, damping, references, velocities, period)


@njit(cache=True)
def _integrate(law, plant, stiffness, damping, references, velocities, period):
    inertia, coulomb, stribeck, stribeck_velocity, viscous, extra = plant
    x, v, z = 0.0, 0.0, 0.0
    positions, speeds = np.empty(len(references)), np.empty(len(references))
    steps = _STEPS * 10 if law == LUGRE else _STEPS
    h = period / steps
    bristle_damping = np.sqrt(extra * inertia) if law == LUGRE else 0.0
    for i in range(len(references)):
        positions[i], speeds[i] = x, v
        for k in range(steps):
            reference = references[i] + velocities[i] * k * h
            force = stiffness * (reference - x) + damping * (velocities[i] - v)
            if law == LUGRE:
                level = coulomb + stribeck * np.exp(-((v / stribeck_velocity) ** 2))
                rate = v - extra * abs(v) / level * z
                v += h / inertia * (force - extra * z - bristle_damping * rate - viscous * v)
                z += h * rate
                x += h * v
                continue
            dry = coulomb + (extra * abs(force) if law == LOAD_DEPENDENT else 0.0)
            if law == EXPONENTIAL:
                falling = np.exp(-(abs(v / stribeck_velocity) ** extra))
            else:
                falling = 1.0 / (1.0 + (v / stribeck_velocity) ** 2)
            friction = dry + stribeck * falling
            if v == 0.0:
                if abs(force) <= friction:
                    continue
                v = h / inertia * (force - np.sign(force) * friction)
            else:
                new = v + h / inertia * (force - np.sign(v) * friction - viscous * v)
                v = 0.0 if new * v < 0.0 else new
            x += h * v
    return positions, speeds


def sticks(joint: OtherJoint, stiffness: float, damping: float, velocity: float, *, rate: float = 1000.0) -> bool:
    """Whether stick-slip goes on at a steady speed, long after the start."""
    natural_period = 2.0 * np.pi * np.sqrt(joint.inertia / stiffness)
    settle = (joint.coulomb + joint.stribeck) / (stiffness * velocity)
    duration = settle + 60.0 * natural_period + 4.0 * joint.stribeck / (stiffness * velocity)
    count = int(duration * rate)
    references = velocity * np.arange(count) / rate
    _, speeds = joint.simulate(stiffness, damping, references, np.full(count, velocity), 1.0 / rate)
    return bool(speeds[int(0.8 * count) :].min() < 0.02 * velocity)
