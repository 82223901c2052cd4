# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 39, item 4: the ring after each slip shows frequency and damping of a load on a spring, with errors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from two_masses import in_counts, seen, two_mass_joint

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.limits import AdviceLimits, crossover_frequency
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.ring import RingEstimate
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.settings.known_joints import load_joint

PUMA = load_joint("puma560_joint1").joint
GAINS = Gains(stiffness=630.0, damping=10.0)
MASS = float(PUMA.inertia)


def with_a_load(resonance: float, share: float, encoder: str = "load") -> Joint:
    """The PUMA's joint with so much of its inertia at the motor."""
    return two_mass_joint(PUMA.friction, (share * MASS, (1.0 - share) * MASS), resonance, encoder)


def slow(joint: Joint, count: float, rate: float = 1000.0) -> Batch:
    return in_counts(seen(joint, GAINS, np.full(int(14.0 * rate), 0.005), rate), count)


def ring_of(batch: Batch) -> RingEstimate | None:
    monitor = JointMonitor()
    monitor.process(batch)
    return monitor.assessment().ring


@pytest.mark.parametrize(
    ("resonance", "share", "count", "rate"),
    [
        (12.0, 0.3, 2.5e-5, 1000.0),
        (25.0, 0.7, 2e-6, 500.0),
        nightly(12.0, 0.7, 2.5e-5, 1000.0),
        nightly(40.0, 0.3, 2e-6, 1000.0),
    ],
)
def test_a_load_rings_at_the_antiresonance(resonance: float, share: float, count: float, rate: float) -> None:
    """By an encoder on the load, while the motor sticks; the errors are those of the scatter."""
    joint = with_a_load(resonance, share)
    found = ring_of(slow(joint, count, rate))
    assert found is not None
    assert joint.transmission is not None
    damped = joint.transmission.antiresonance * math.sqrt(1.0 - joint.transmission.spring_damping**2)
    assert found.frequency == pytest.approx(damped, rel=0.01)
    assert found.frequency_std < 0.01 * damped
    assert abs(found.damping_ratio - joint.transmission.spring_damping) < max(0.005, 4.0 * found.damping_ratio_std)


def shaken(batch: Batch) -> Batch:
    """The same beside a machine that shakes it, which does not die out."""
    return replace(batch, position=batch.position + 1e-4 * np.sin(2.0 * math.pi * 11.0 * batch.time))


def wandering(batch: Batch) -> Batch:
    """The same with readings that wander at random, more slowly than they come."""
    steps: FloatArray = np.random.default_rng(1).standard_normal(len(batch))
    return replace(batch, position=batch.position + 1e-4 * np.convolve(steps, np.ones(20) / 20.0, "same"))


@pytest.mark.parametrize("change", [None, shaken, wandering])
def test_what_does_not_ring_is_not_said_to(change: object) -> None:
    """A rigid joint does not, with whatever beside it."""
    batch = slow(PUMA, 2.5e-5)
    assert ring_of(change(batch) if callable(change) else batch) is None


def test_an_encoder_on_the_motor_does_not_see_it() -> None:
    """The motor sticks while the load rings."""
    assert ring_of(slow(with_a_load(12.0, 0.3, "motor"), 2.5e-5)) is None


def test_advice_keeps_below_the_ring() -> None:
    """The bandwidth's default follows from it, and a limit that is given counts in its place."""
    batch = slow(with_a_load(12.0, 0.3), 2.5e-5)
    for bandwidth in (math.inf, 500.0):
        options = MonitorOptions(learn=False, limits=AdviceLimits(bandwidth=bandwidth, damping_range=(900.0, math.inf)))
        monitor = JointMonitor(PUMA, GAINS, options)
        monitor.process(batch)
        state = monitor.assessment()
        assert state.ring is not None
        assert state.recommendation is not None
        assert state.recommended is not None
        if bandwidth < math.inf:
            assert crossover_frequency(PUMA, state.recommended.gains) > 2.0 * math.pi * state.ring.frequency
        else:
            obstruction = state.recommendation.obstruction
            assert obstruction is not None
            assert "bandwidth" in obstruction.bounds
            assert "of the ring at 6.5" in state.recommended.reason
