# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 38: Stribeck friction that differs by direction passed for a rise time twice as long, and F_s∞ was open.

The machines are the tests' own, integrated apart from the package.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from machines import Machine, drawn, simulate
from random_joints import cut_slips, later
from two_speeds import monitor_of

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.friction.learner import FrictionLearner, LearnerMemory
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.nodes.kept_state import from_plain, to_plain

GAINS = Gains(stiffness=630.0)
RATE, SECONDS = 500.0, 80.0
PARAMETERS = ("inertia", "viscous", "stribeck", "stribeck_velocity", "lag", "rise_time")


def to_and_fro(machine: Machine, speeds: tuple[float, ...]) -> Batch:
    """Each speed forward, then back."""
    times = np.arange(int(SECONDS * RATE)) / RATE
    part = (times / SECONDS * 2 * len(speeds)).astype(int)
    velocities = np.where(part % 2 == 0, 1.0, -1.0) * np.asarray(speeds)[part // 2]
    references = drawn(machine, GAINS) + np.append(0.0, np.cumsum(velocities)[:-1]) / RATE
    motion = simulate(machine, GAINS, references, velocities, 1.0 / RATE)
    return Batch(
        time=times, position=5e-6 * np.round(motion.position / 5e-6), effort=motion.effort,
        reference_position=references, reference_velocity=velocities,
    )  # fmt: skip


def learnt(machine: Machine, speeds: tuple[float, ...]) -> tuple[Batch, JointMonitor]:
    """A recording, and a monitor that has learnt from it."""
    batch = to_and_fro(machine, speeds)
    return batch, monitor_of(batch, GAINS)


@pytest.mark.slow
@pytest.mark.parametrize(("asymmetry", "larger"), [(0.2, "positive"), nightly(-0.1, "negative")])
def test_friction_by_direction_is_reported(puma: Joint, asymmetry: float, larger: str) -> None:
    """All parameters are those of the direction with more friction, and later slips are explained in both."""
    machine = replace(Machine.of(puma), stribeck_asymmetry=asymmetry)
    batch, monitor = learnt(machine, (0.005, 0.003))
    estimate = monitor.learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    assert estimate.asymmetry is not None
    assert estimate.asymmetry.value == pytest.approx(asymmetry, abs=3.0 * estimate.asymmetry.std)
    assert f"values are for the {larger}" in estimate.summary()
    worse = machine.in_the_worse_direction
    for name in PARAMETERS:
        assert abs(estimate[name].value - float(getattr(worse, name))) < 3.0 * estimate[name].std, name
    assert estimate["stribeck"].identified
    # A monitor that is started anew goes on from there, and slips in either direction are no other friction.
    learner = FrictionLearner()
    assert learner.restore(from_plain(LearnerMemory, to_plain(monitor.learner.memory_of())))
    windows = cut_slips(batch, GAINS)[0]
    assert {window.direction for window in windows} == {1, -1}
    for window in windows:
        learner.add_slip(later(window, SECONDS))
    assert learner.change is None
    assert learner.estimate is not None
    assert learner.estimate.asymmetry == estimate.asymmetry


@pytest.mark.slow
def test_equal_friction_is_equal(puma: Joint) -> None:
    """A load that is constant makes no difference of Stribeck friction."""
    machine = replace(Machine.of(puma), load=3.0, asymmetry=0.1)
    estimate = learnt(machine, (0.005, 0.003))[1].learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    assert estimate.asymmetry is None


@pytest.mark.slow
@pytest.mark.nightly
def test_one_speed_is_enough(puma: Joint) -> None:
    """Slips and rests of one direction are longer, as where friction rises with the dwell: a rise time 2.5 times too
    long explained most of that.
    """
    machine = replace(Machine.of(puma), stribeck_asymmetry=0.15)
    estimate = learnt(machine, (0.005,))[1].learner.estimate
    assert estimate is not None
    worse = machine.in_the_worse_direction
    for name in PARAMETERS:
        assert abs(estimate[name].value - float(getattr(worse, name))) < 3.0 * estimate[name].std, name
    assert estimate["rise_time"].identified
