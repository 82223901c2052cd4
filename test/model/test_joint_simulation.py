# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The integration of Eqs (4)-(6): known answers, convergence, the exact boundary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import EXACT_CRITICAL_DAMPING

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation, Trajectory, simulate


def move(
    joint: Joint, gains: Gains, velocity: float, duration: float, *, period: float = 1e-3, load: float = 0.0
) -> Trajectory:
    """Constant velocity from rest."""
    count = round(duration / period)
    references = velocity * period * np.arange(count)
    return simulate(joint, gains, references, np.full(count, velocity), period=period, load=load)


def test_without_excess_friction_the_slip_is_a_circle() -> None:
    """Issue 2: Coulomb friction alone gives slips of one natural period and 2π x˙_d/ω, without end."""
    joint = Joint(inertia=2.0, friction=Friction(stribeck=0.0, stribeck_velocity=0.01, coulomb=3.0))
    trajectory = move(joint, Gains(stiffness=200.0), 0.02, 5.0)
    # The circle touches zero velocity without stopping: velocity is x˙_d (1 − cos ωt).
    breakaway = trajectory.events[0].time
    assert breakaway == pytest.approx(3.0 / 200.0 / 0.02, abs=1e-9)
    elapsed = trajectory.time - breakaway
    first = (elapsed > 0) & (elapsed < 2 * math.pi / 10.0 - 0.01)
    np.testing.assert_allclose(
        trajectory.velocity[first], 0.02 * (1 - np.cos(10.0 * elapsed[first])), rtol=0, atol=1e-9
    )
    assert trajectory.position[np.searchsorted(elapsed, 2 * math.pi / 10.0)] == pytest.approx(
        2 * math.pi * 0.002, abs=1e-7
    )


def test_leaving_is_gentle(puma: Joint) -> None:
    """Issue 2: while Ψ = 1 the joint leaves as k_p x˙_d t³/(6M)."""
    trajectory = move(puma, Gains(stiffness=630.0), 0.0058, 3.0)
    elapsed = trajectory.time - trajectory.events[0].time
    soon = (elapsed > 0.01) & (elapsed < 0.05)
    np.testing.assert_allclose(trajectory.position[soon], 630 * 0.0058 * elapsed[soon] ** 3 / (6 * 6.3), rtol=0.03)


def test_events_do_not_depend_on_the_step(puma: Joint) -> None:
    """Issue 2: event times agree between 1 ms and 0.1 ms periods to 1e-8 s."""
    coarse = move(puma, Gains(stiffness=630.0), 0.0058, 20.0)
    fine = move(puma, Gains(stiffness=630.0), 0.0058, 20.0, period=1e-4)
    assert len(coarse.events) == len(fine.events) > 20
    for one, other in zip(coarse.events, fine.events, strict=True):
        assert one.kind is other.kind
        assert one.time == pytest.approx(other.time, abs=1e-8)


def test_an_arrest_has_the_velocity_of_one_lag_ago(puma: Joint) -> None:
    """Issue 39: the step in which a joint stops is bisected, and all its parts have the same past."""
    short = replace(puma, friction=replace(puma.friction, lag=0.01))
    coarse = move(short, Gains(stiffness=630.0), 0.0058, 6.0, period=0.02)
    fine = move(short, Gains(stiffness=630.0), 0.0058, 6.0, period=0.02 / 64)
    assert len(coarse.events) == len(fine.events) > 4
    np.testing.assert_allclose(coarse.event_rows[:, 4], fine.event_rows[:, 4], rtol=1e-6)


@pytest.mark.parametrize(
    ("stiffness", "velocity", "exact"),
    EXACT_CRITICAL_DAMPING,
)
def test_exact_boundary_of_the_paper_joint(puma: Joint, stiffness: float, velocity: float, exact: float) -> None:
    """Issue 2: 2 % below the exact ρ_c of physics.md the cycle goes on for 60 s, 2 % above it dies."""
    last_event = []
    for factor in (0.98, 1.02):
        damping = factor * exact * 2 * 6.3 * math.sqrt(stiffness) - 4.94
        trajectory = move(puma, Gains(stiffness=stiffness * 6.3, damping=damping), velocity * 0.0058, 60.0)
        last_event.append(trajectory.events[-1].time)
    assert last_event[0] > 57.0
    assert last_event[1] < 30.0


def test_direction_and_load_are_symmetric(puma: Joint) -> None:
    """Issue 2: both directions alike; a constant load shifts the reference and nothing else."""
    forward = move(puma, Gains(stiffness=630.0), 0.0058, 10.0)
    backward = move(puma, Gains(stiffness=630.0), -0.0058, 10.0)
    np.testing.assert_allclose(backward.position, -forward.position, atol=1e-12)
    loaded = move(puma, Gains(stiffness=630.0), 0.0058, 10.0, load=2.0)
    assert loaded.events[0].time - forward.events[0].time == pytest.approx(2.0 / 630.0 / 0.0058, abs=1e-9)


def test_gains_change_while_it_moves_and_integral_hunts(puma: Joint) -> None:
    """Issue 2: gains take effect with the next period; integral action breaks away from a standing offset."""
    simulation = JointSimulation(puma, Gains(stiffness=630.0))
    hold = np.full(1000, 0.01)
    still = simulation.advance(1e-3, hold, np.zeros(1000))
    assert still.events == ()
    assert simulation.stuck
    simulation.gains = Gains(stiffness=630.0, integral=2000.0)
    moved = simulation.advance(1e-3, hold, np.zeros(1000))
    assert moved.events[0].kind is EventKind.BREAKAWAY
    assert simulation.time == pytest.approx(2.0)


def test_bad_input_is_refused(puma: Joint) -> None:
    """Issue 2: gains and references that are not finite are refused with their name."""
    with pytest.raises(InvalidParameterError, match="'stiffness' must be finite: nan"):
        JointSimulation(puma, Gains(stiffness=math.nan))
    simulation = JointSimulation(puma, Gains(stiffness=630.0))
    with pytest.raises(InvalidParameterError, match="'period'"):
        simulation.advance(0.0, np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="shape"):
        simulation.advance(1e-3, np.zeros(3), np.zeros(2))


def test_in_pieces_or_at_once(puma: Joint) -> None:
    """Issue 2: how the periods are grouped into calls makes no difference."""
    references = 0.0058e-3 * np.arange(6000)
    velocities = np.full(6000, 0.0058)
    whole = simulate(puma, Gains(stiffness=630.0), references, velocities)
    simulation = JointSimulation(puma, Gains(stiffness=630.0))
    pieces = [simulation.advance(1e-3, references[i : i + 7], velocities[i : i + 7]) for i in range(0, 6000, 7)]
    np.testing.assert_allclose(np.concatenate([piece.position for piece in pieces]), whole.position, atol=1e-11)
