# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The simulator of joints off the paper's law, where it can be compared: with the package's own on the paper's law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machines import ARREST_TIME, EXPONENTIAL, LEVEL, LUGRE, TIME, Machine, Motion, drawn, simulate, sticks

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation, Trajectory

PUMA = Machine(
    inertia=6.3, coulomb=8.43, viscous=4.94, stribeck=1.6, stribeck_velocity=0.0058, lag=0.05, rise_time=0.264
)
GAINS = Gains(stiffness=630.0, damping=2.0)
PERIOD = 1e-3


def joint_of(machine: Machine, law: str = "hess_soom") -> Joint:
    return Joint(
        inertia=machine.inertia,
        friction=Friction(
            coulomb=machine.coulomb,
            viscous=machine.viscous,
            stribeck=machine.stribeck,
            stribeck_velocity=machine.stribeck_velocity,
            lag=machine.lag,
            rise_time=machine.rise_time,
            law=law,
        ),
    )


def both(machine: Machine, velocity: float, law: str = "hess_soom", count: int = 20_000) -> tuple[Motion, Trajectory]:
    """The same motion twice, by this simulator and by the package's."""
    velocities = np.where(np.arange(count) < 0.6 * count, velocity, -1.5 * velocity)
    references = drawn(machine, GAINS) + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) * PERIOD
    simulation = JointSimulation(
        joint_of(machine, law), GAINS, load=machine.load, sampled=machine.sampled,
        control_delay=machine.control_delay > 0,
    )  # fmt: skip
    theirs = simulation.advance(PERIOD, references, velocities)
    return simulate(machine, GAINS, references, velocities, PERIOD), theirs


@pytest.mark.parametrize(
    ("machine", "law"),
    [
        (PUMA, "hess_soom"),
        (replace(PUMA, load=3.0, lag=0.008, rise_time=1.5), "hess_soom"),
        (replace(PUMA, law=EXPONENTIAL), "exponential"),
        (replace(PUMA, sampled=True, control_delay=PERIOD), "hess_soom"),
    ],
    ids=["paper", "load, short lag", "exponential", "sampled, late"],
)
@pytest.mark.parametrize("velocity", [0.003, 0.012])
def test_slips_are_those_of_the_package(machine: Machine, law: str, velocity: float) -> None:
    """Levels, times and positions of all slips, in both directions."""
    own, theirs = both(machine, velocity, law)
    begins = [event for event in theirs.events if event.kind is EventKind.BREAKAWAY]
    ends = [event for event in theirs.events if event.kind is EventKind.ARREST]
    assert len(own.slips) == len(ends) >= 4
    levels = [event.stribeck_level for event in begins[: len(ends)]]
    np.testing.assert_allclose(own.slips[:, LEVEL], levels, rtol=2e-3)
    np.testing.assert_allclose(own.slips[:, TIME], [event.time for event in begins[: len(ends)]], atol=1e-3)
    np.testing.assert_allclose(own.slips[:, ARREST_TIME], [event.time for event in ends], atol=1e-3)
    way = float(np.ptp(theirs.position)) / len(ends)
    np.testing.assert_allclose(own.position[1:], theirs.position[:-1], atol=1e-3 * way)


@pytest.mark.parametrize("velocity", [0.003, 0.006])
def test_sticking_ends_at_the_exact_boundary(velocity: float) -> None:
    joint = joint_of(PUMA)
    groups = dimensionless_groups(joint, GAINS, velocity)
    total = float(exact_critical_damping_ratio(groups)) * 2.0 * np.sqrt(630.0 * PUMA.inertia)
    assert sticks(PUMA, replace(GAINS, damping=0.97 * total - PUMA.viscous), velocity)
    assert not sticks(PUMA, replace(GAINS, damping=1.03 * total - PUMA.viscous), velocity)


def test_direction_drift_and_ripple_change_the_force_as_they_say() -> None:
    """Forces at breakaway, read off the effort: by direction, by time, by position."""
    velocity, count = 0.003, 20_000
    slow = replace(PUMA, rise_time=1e-6)

    def breakaway_forces(machine: Machine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        velocities = np.where(np.arange(count) < count // 2, velocity, -velocity)
        references = drawn(machine, GAINS) + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) * PERIOD
        motion = simulate(machine, GAINS, references, velocities, PERIOD)
        index = (motion.slips[:, TIME] / PERIOD).astype(int)
        return motion.effort[index], motion.slips[:, TIME], motion.slips[:, 1]

    forces, _, _ = breakaway_forces(replace(slow, asymmetry=0.2))
    expected = np.where(forces > 0, 1.2 * 8.43 + 1.6, -0.8 * 8.43 - 1.6)
    np.testing.assert_allclose(forces, expected, rtol=2e-3)
    forces, times, _ = breakaway_forces(replace(slow, drift=0.01))
    np.testing.assert_allclose(np.abs(forces), (1.0 + 0.01 * times) * 10.03, rtol=2e-3)
    forces, _, positions = breakaway_forces(replace(slow, ripple=0.1, ripples=20.0))
    np.testing.assert_allclose(np.abs(forces), 10.03 + 0.843 * np.sin(40.0 * np.pi * positions), rtol=2e-3)


def test_bristles_yield_at_rest_and_slide_on_the_curve() -> None:
    """LuGre: under a growing force F the joint yields by g/σ₀ ln 1/(1 − F/g); in steady sliding the force is g."""
    machine = replace(PUMA, law=LUGRE, bristle_stiffness=6e4, bristle_damping=600.0)
    count = 8000
    slow = 0.0005
    held = simulate(machine, GAINS, slow * PERIOD * np.arange(count), np.full(count, slow), PERIOD)
    share = held.effort[-1] / 10.03
    assert 0.2 < share < 0.3
    assert held.position[-1] == pytest.approx(10.03 / 6e4 * np.log(1.0 / (1.0 - share)), rel=0.02)
    speed = 0.05
    slid = simulate(machine, GAINS, speed * PERIOD * np.arange(count), np.full(count, speed), PERIOD)
    assert slid.effort[-1] == pytest.approx(8.43 + 4.94 * speed, rel=1e-2)
