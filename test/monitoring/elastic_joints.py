# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Random joints whose contact is elastic, by the package's own simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.samples import Batch

CONTACTS = ("elasto_plastic", "lugre", "rigid")
RATE = 500.0  # [Hz]
DURATION = 60.0  # [s]


@dataclass(frozen=True)
class Case:
    """A joint and what is seen of it."""

    contact: str
    stiffness: float
    samples: Batch
    gains: Gains


def random_case(generator: np.random.Generator, contact: str, *, turns: bool) -> Case:
    """A joint that sticks and slips, whose contact is 20 to 1000 times as stiff as its controller."""
    inertia, frequency = 10 ** generator.uniform(-2, 1.5), generator.uniform(5, 20)
    stribeck_velocity, momentum = 10 ** generator.uniform(-3, -1.5), inertia * frequency
    gains = Gains(stiffness=momentum * frequency, damping=momentum * generator.uniform(0.0, 0.3))
    stiffness = math.inf if contact == "rigid" else float(gains.stiffness) * 10 ** generator.uniform(1.3, 3.0)
    stribeck = generator.uniform(3, 10) * momentum * stribeck_velocity
    friction = Friction(
        stribeck=stribeck, stribeck_velocity=stribeck_velocity, coulomb=stribeck * generator.uniform(0.5, 3.0),
        lag=10 ** generator.uniform(-2.3, -1.5), rise_time=10 ** generator.uniform(-1.3, -0.3),
        viscous=0.04 * momentum, presliding_stiffness=stiffness,
        presliding_damping=0.0 if contact == "rigid" else 0.5 * math.sqrt(stiffness * inertia),
        contact="elasto_plastic" if contact == "rigid" else contact,
    )  # fmt: skip
    speed = stribeck_velocity * generator.uniform(0.3, 1.0)
    times = np.arange(int(DURATION * RATE)) / RATE
    half = generator.uniform(4.0, 10.0)
    way = 1.0 - 2.0 * (np.floor(times / half) % 2) if turns else np.ones_like(times)
    reference = np.cumsum(speed * way) / RATE
    motion = simulate(
        Joint(inertia=inertia, friction=friction), gains, reference, speed * way, period=1.0 / RATE
    )  # fmt: skip
    count = stribeck / float(gains.stiffness) / 10 ** generator.uniform(1.5, 4.0)
    samples = Batch(
        time=motion.time, position=count * np.round(motion.position / count),
        reference_position=reference + speed * way / RATE, reference_velocity=speed * way,
    )  # fmt: skip
    return Case(contact, stiffness, samples, gains)
