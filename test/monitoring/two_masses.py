# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Motor and load on a spring, as a harmonic drive or a belt makes them: what an encoder sees of such a joint."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.model.friction import Friction, Gains, Joint, Transmission
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.monitoring.samples import Batch, FloatArray


def two_mass_joint(friction: Friction, masses: tuple[float, float], resonance: float, encoder: str = "motor") -> Joint:
    """Motor and load of given inertias [kg·m²], which swing against each other at the resonance [Hz]."""
    inertia = sum(masses)
    antiresonance = resonance * math.sqrt(masses[0] / inertia)
    transmission = Transmission(resonance=resonance, antiresonance=antiresonance, encoder=encoder)
    return Joint(inertia=inertia, friction=friction, transmission=transmission)


def seen(joint: Joint, gains: Gains, velocities: FloatArray, rate: float) -> Batch:
    """The joint at commanded velocities [rad/s] by an encoder without counts, sampled at a rate [Hz]."""
    references = np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    positions = JointSimulation(joint, gains).advance(1.0 / rate, references, velocities).position
    return Batch(
        time=np.arange(len(positions)) / rate,
        position=np.concatenate([[0.0], positions[:-1]]),
        reference_position=references,
    )


def in_counts(batch: Batch, count: float) -> Batch:
    """The samples by an encoder of a resolution [rad]."""
    return replace(batch, position=count * np.round(batch.position / count))
