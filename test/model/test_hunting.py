# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Standing still with integral action: who hunts, how far, and with which gains nobody does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from brute_standstill import late_motion
from conftest import nightly

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.hunting import hunting, largest_non_hunting_integral, least_quiet_stiffness, starts_of
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation
from stickslip_ros.model.long_motion import natural_period

pytestmark = pytest.mark.slow

# Canudas de Wit, Olsson, Åström and Lischinsky, IEEE TAC 40(3), 1995, Table I.
PUBLISHED = Friction(
    stribeck=0.5, stribeck_velocity=0.001, coulomb=1.0, viscous=0.4, law="exponential",
    presliding_stiffness=1e5, presliding_damping=math.sqrt(1e5), contact="lugre",
)  # fmt: skip
HUNTS = Gains(stiffness=630.0, integral=1000.0)


def soft(joint: Joint, stiffness: float, contact: str) -> Joint:
    """The same joint on a contact that gives way, with half of its critical damping."""
    damping = 0.5 * float(np.sqrt(stiffness * float(joint.inertia)))
    friction = replace(joint.friction, presliding_stiffness=stiffness, presliding_damping=damping, contact=contact)
    return replace(joint, friction=friction)


def test_period_and_amplitude_are_those_of_the_simulation(puma: Joint) -> None:
    """Issue 23: hunting from every start; period and amplitude are read off a long simulation of the same."""
    found = hunting(puma, HUNTS)
    assert found.hunts
    assert found.starts == starts_of(puma)
    motion = JointSimulation(puma, HUNTS).advance(0.01, np.full(50_000, 0.0159), np.zeros(50_000))
    late = motion.position[30_000:]
    assert found.amplitude == pytest.approx(0.5 * np.ptp(late), rel=0.05)
    forward = [one.time for one in motion.events if one.kind is EventKind.BREAKAWAY and one.direction > 0]
    assert found.period == pytest.approx(np.mean(np.diff(forward[-6:])), rel=0.05)


@pytest.mark.parametrize("contact", ["elasto_plastic", "lugre"])
def test_presliding_lets_a_joint_settle(puma: Joint, contact: str) -> None:
    """Issue 23: a soft contact comes to rest where the rigid law hunts; an elastic one that is stiff hunts like it."""
    assert hunting(puma, HUNTS).hunts
    assert hunting(soft(puma, 1e4, contact), HUNTS).hunts is False
    if contact == "elasto_plastic":
        assert hunting(soft(puma, 1e5, contact), HUNTS).hunts


def test_gains_without_hunting() -> None:
    """Issue 23: the LuGre paper's PID control hunts as published; from the least k_p on no start does."""
    joint, gains = Joint(inertia=1.0, friction=PUBLISHED), Gains(stiffness=3.0, damping=6.0, integral=4.0)
    found = hunting(joint, gains)
    assert found.hunts
    assert found.period == pytest.approx(24.4, abs=0.5)
    assert found.amplitude == pytest.approx(0.064, abs=0.003)
    stiffness = least_quiet_stiffness(joint, gains)
    assert 3.0 < stiffness < 1000.0
    assert hunting(joint, replace(gains, stiffness=1.04 * stiffness)).hunts is False
    assert hunting(joint, replace(gains, stiffness=0.94 * stiffness)).hunts
    # However weak, integral action makes this mass hunt.
    assert largest_non_hunting_integral(joint, gains) == 0.0


SECOND = Joint(
    inertia=6.5,
    friction=Friction(stribeck=2.3, stribeck_velocity=0.004, lag=0.02, rise_time=0.1, viscous=5.0, coulomb=4.0),
)
THIRD = Joint(
    inertia=0.4,
    friction=Friction(stribeck=0.3, stribeck_velocity=0.02, lag=0.01, rise_time=0.4, viscous=0.6, coulomb=0.9),
)


@pytest.mark.parametrize(
    ("joint", "stiffness", "integral", "contact"),
    [
        *((None, 630.0, integral, np.inf) for integral in (30.0, 300.0, 700.0, 1000.0)),
        *(nightly(None, 630.0, integral, np.inf) for integral in (3.2, 100.0, 450.0)),
        *((None, stiffness, 1000.0, np.inf) for stiffness in (800.0, 2016.0, 6300.0)),
        nightly(None, 1260.0, 1000.0, np.inf),
        *((None, 630.0, 1000.0, contact) for contact in (1e4, 1e5)),
        nightly(None, 630.0, 1000.0, 3e4),
        *((joint, 625.0, integral, np.inf) for joint in (SECOND, THIRD) for integral in (100.0, 1000.0)),
        *(nightly(joint, 625.0, 20.0, np.inf) for joint in (SECOND, THIRD)),
        *((joint, 625.0, 1000.0, 1e5) for joint in (SECOND, THIRD)),
    ],
)
def test_it_hunts_where_brute_force_does(
    puma: Joint, joint: Joint | None, stiffness: float, integral: float, contact: float
) -> None:
    """Issue 23: from each start the verdict is that of small steps that guess nothing, and so is the amplitude."""
    joint, gains = joint or puma, Gains(stiffness=stiffness, integral=integral)
    if np.isfinite(contact):
        joint = soft(joint, contact, "elasto_plastic")
    found = hunting(joint, gains)
    seconds = 1000.0 * natural_period(joint, gains) + 6.0 * stiffness / integral
    late = {
        start: late_motion(joint, gains, start, seconds) for start in starts_of(joint) if start not in found.unstable
    }
    assert all(start > 1.0 for start in found.unstable)
    # From farther away many swings come before the last ones; which way they go is decided by next to nothing.
    near = [start for start in late if start <= 1.0]
    assert [start for start in near if start in found.starts] == [start for start in near if late[start].hunts]
    if found.hunts:
        assert found.amplitude == pytest.approx(max(one.amplitude for one in late.values() if one.hunts), rel=0.02)


def test_limits_do_not_contradict_the_verdict(puma: Joint) -> None:
    """Issue 23: joint 1 hunts from k_i 320 to 400 on, and no more from k_p 900 on; slips one way are not hunting."""
    integral, stiffness = largest_non_hunting_integral(puma, HUNTS), least_quiet_stiffness(puma, HUNTS)
    assert 315.0 < integral < 340.0
    assert 860.0 < stiffness < 1260.0
    for value in integral * np.array([0.003, 0.01, 0.1, 0.3, 0.98]):
        assert hunting(puma, replace(HUNTS, integral=float(value))).settles
    for value in integral * np.array([1.05, 1.2, 1.4, 2.0, 3.0]):
        assert hunting(puma, replace(HUNTS, integral=float(value))).hunts
    for value in stiffness * np.array([1.02, 2.0, 7.0, 70.0, 700.0]):
        assert hunting(puma, replace(HUNTS, stiffness=float(value))).settles
    assert hunting(puma, replace(HUNTS, stiffness=0.95 * stiffness)).hunts


def test_a_motion_that_grows_is_not_hunting(puma: Joint) -> None:
    """Issue 23: without Coulomb friction the loop of k_i 1000 is unstable; with k_i 3000 it is from far away."""
    slippery = replace(puma, friction=replace(puma.friction, coulomb=0.0))
    found = hunting(slippery, HUNTS)
    assert found.hunts is False
    assert found.unstable == starts_of(slippery)
    assert not found.settles
    far = hunting(puma, replace(HUNTS, integral=3000.0))
    assert far.hunts
    assert set(far.unstable) == {3.0, 10.0}
    sampled = OperatingConditions(controller_period=0.01, control_delay=True)
    assert 1.0 in hunting(puma, replace(HUNTS, damping=2000.0), sampled).unstable


def test_without_integral_action_nothing_hunts(puma: Joint) -> None:
    """Issue 23: a spring alone holds the joint where it sticks."""
    assert hunting(puma, Gains(stiffness=630.0)).hunts is False
