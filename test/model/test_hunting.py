# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Standing still with integral action: who hunts, how far, and with which gains nobody does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.hunting import STARTS, hunting, largest_quiet_integral, least_quiet_stiffness
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation

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
    assert found.starts == STARTS
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
    assert largest_quiet_integral(joint, gains) == 0.0


def test_without_integral_action_nothing_hunts(puma: Joint) -> None:
    """Issue 23: a spring alone holds the joint where it sticks."""
    assert hunting(puma, Gains(stiffness=630.0)).hunts is False
