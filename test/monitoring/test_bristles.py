# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issues 18 and 38: what is learnt from a joint on bristles that yield ever more, whose slips begin slowly."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from machines import LUGRE, Machine, drawn, simulate, sticks

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.selected_model import select_model
from stickslip_ros.monitoring.uncertainty import stick_slip_probability

pytestmark = pytest.mark.slow


@pytest.mark.nightly
def test_bristles_that_yield_ever_more_end_no_analysis(puma: Joint) -> None:
    """A LuGre contact, 50 times as stiff as the controller: the errors of a fit were no numbers, and a study raised."""
    gains, rate, resolution = Gains(stiffness=630.0), 1000.0, 2e-5
    stiffness = 50.0 * float(gains.stiffness)
    friction = replace(
        puma.friction,
        presliding_stiffness=stiffness,
        presliding_damping=0.6 * math.sqrt(stiffness * float(puma.inertia)),
        contact="lugre",
    )
    times = np.arange(int(60.0 * rate)) / rate
    velocities = np.where(times < 30.0, 0.005, 0.003)
    references = np.append(0.0, np.cumsum(velocities)) / rate
    motion = JointSimulation(replace(puma, friction=friction), gains).advance(1.0 / rate, references[:-1], velocities)
    monitor = JointMonitor(None, gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(
        Batch(
            time=times,
            position=resolution * np.round(motion.position / resolution),
            effort=motion.effort,
            reference_position=references[1:],
            reference_velocity=velocities,
        )
    )
    monitor.finish()
    assert monitor.learner.estimate is None or monitor.learner.estimate.mismatch


def on_bristles(
    puma: Joint, gains: Gains, directions: np.ndarray, **changes: float
) -> tuple[Machine, FrictionEstimate]:
    """LuGre's joint, integrated apart from the package, and what a monitor learns of it by 2e-5 rad counts in 60 s."""
    rate, resolution = 500.0, 2e-5
    stiffness = 100.0 * float(gains.stiffness)
    machine = replace(
        Machine.of(puma), law=LUGRE, lag=0.0, rise_time=0.0, bristle_stiffness=stiffness,
        bristle_damping=math.sqrt(stiffness * float(puma.inertia)), **changes,
    )  # fmt: skip
    times = np.arange(int(60.0 * rate)) / rate
    velocities = directions * np.where(times < 30.0, 0.005, 0.003)
    references = drawn(machine, gains) + np.cumsum(np.append(0.0, velocities))[:-1] / rate
    motion = simulate(machine, gains, references, velocities, 1.0 / rate)
    monitor = JointMonitor(None, gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(
        Batch(
            time=times,
            position=resolution * np.round(motion.position / resolution),
            effort=motion.effort,
            reference_position=references,
            reference_velocity=velocities,
        )
    )
    monitor.finish()
    assert monitor.learner.estimate is not None
    return machine, monitor.learner.estimate


def test_slips_that_begin_slowly_are_fitted(puma: Joint) -> None:
    """Inertia, Stribeck friction and velocity are identified and right, the contact is reported, the verdict sure."""
    gains = Gains(stiffness=630.0)
    machine, estimate = on_bristles(puma, gains, np.ones(30_000))
    assert not estimate.mismatch
    assert estimate.contact is not None
    assert estimate.law == "exponential"
    for name in ("inertia", "stribeck", "stribeck_velocity"):
        assert estimate[name].identified
    for name in ("inertia", "stribeck", "stribeck_velocity", "viscous", "coulomb_and_load"):
        true = machine.coulomb if name == "coulomb_and_load" else float(getattr(machine, name))
        assert estimate[name].value == pytest.approx(true, abs=2.6 * estimate[name].std)
    assert not estimate["lag"].identified
    assert "yields before it breaks away (lugre" in estimate.summary()
    selected, _ = select_model(estimate, None, gains)
    assert selected is not None
    assert selected.uncertainty is not None
    friction = selected.joint.friction
    assert friction.contact == "lugre"
    assert float(friction.presliding_stiffness) == pytest.approx(machine.bristle_stiffness, rel=0.1)
    # From 112 N·m·s/rad on the joint never stands, and up to some 250 it swings between near rest and three times its
    # speed: it neither sticks nor moves smoothly, and nothing is sure.
    for damping, expected in ((50.0, 1.0), (200.0, 0.5), (400.0, 0.0)):
        tried = replace(gains, damping=damping)
        assert stick_slip_probability(selected.uncertainty, tried, 0.005) == pytest.approx(expected, abs=0.05)
        assert sticks(machine, tried, 0.005) is (expected == 1.0)


@pytest.mark.nightly
def test_a_load_is_distinguished_to_and_fro(puma: Joint) -> None:
    """Slips of both directions separate it from the Coulomb friction."""
    directions = np.where(np.arange(30_000) // 5000 % 2 == 0, 1.0, -1.0)
    machine, estimate = on_bristles(puma, Gains(stiffness=630.0), directions, load=2.0)
    assert estimate.contact is not None
    assert estimate.load.value == pytest.approx(machine.load, abs=2.6 * estimate.load.std)
    assert estimate.coulomb.value == pytest.approx(machine.coulomb, abs=2.6 * estimate.coulomb.std)
    assert estimate.coulomb.identified
