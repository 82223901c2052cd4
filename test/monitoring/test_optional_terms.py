# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 18: viscous friction that is no straight line over speed. Its slips left nothing over, and were believed.

The machines are the tests' own, integrated apart from the package.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import Machine
from random_joints import cut_slips
from random_joints import random_recording as random_joint_recording
from random_machines import CONDITIONS, random_recording
from two_speeds import monitor_of, recording

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.learner import LearnerMemory
from stickslip_ros.monitoring.friction.optional_terms import TermScore
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.selected_model import select_model
from stickslip_ros.nodes.state.plain_data import from_plain, to_plain

GAINS = Gains(stiffness=630.0)
RESOLUTION = 5e-6  # [rad], some thousandth of a slip
NODES = 200


def learnt_from(condition: str, seed: int) -> tuple[Machine, FrictionEstimate]:
    """A random machine, and what is learnt from its recording."""
    random = random_recording(seed, CONDITIONS[condition])
    estimate = monitor_of(random.batch, random.gains).learner.estimate
    assert estimate is not None
    return random.machine, estimate


def off(estimate: FrictionEstimate, name: str, truth: float) -> float:
    """In standard errors."""
    return abs(estimate[name].value - truth) / estimate[name].std


def brute_force(
    inertia: float, stiffness: float, viscous: float, drag: float, level: float, unit: float, lag: float, speed: float,
    times: FloatArray, begin: float,
) -> FloatArray:  # fmt: skip
    """Positions of one slip at the times, by a hundred thousand steps of Heun's method; 0 before it begins."""
    steps = 100_000
    step = (float(times[-1]) - begin) / steps
    behind = round(lag / step)
    ways, speeds = np.zeros(steps + 1), np.zeros(steps + 1)

    def pull(way: float, now: float, index: int) -> float:
        lagged = speeds[index - behind] if index >= behind else 0.0
        falls = level * (1.0 - 1.0 / (1.0 + (lagged / unit) ** 2))
        force = stiffness * (speed * step * index - way) + falls - (viscous + drag * now) * now
        return force / inertia

    for i in range(steps):
        first = pull(ways[i], speeds[i], i)
        guess = speeds[i] + step * first
        second = pull(ways[i] + step * speeds[i], guess, i + 1)
        speeds[i + 1] = speeds[i] + 0.5 * step * (first + second)
        if speeds[i + 1] <= 0.0 and i > steps // 100:
            ways[i + 1 :] = ways[i]
            break
        ways[i + 1] = ways[i] + 0.5 * step * (speeds[i] + speeds[i + 1])
    return np.interp(times, begin + step * np.arange(steps + 1), ways, left=0.0)


@settings(max_examples=8, deadline=None)
@given(curvature=st.floats(-0.9, 0.9), lag=st.floats(0.02, 1.0), viscous=st.floats(0.05, 0.6), pace=st.floats(0.3, 3.0))
def test_a_slip_with_curved_friction_is_that_of_brute_force(
    curvature: float, lag: float, viscous: float, pace: float
) -> None:
    """Positions are within 1e-3 of a slip's way of those in a hundred thousand steps."""
    inertia, stiffness, unit = 2.0, 500.0, 0.01
    frequency = math.sqrt(stiffness / inertia)
    level, speed = 4.0 * inertia * frequency * unit, pace * unit
    times = np.linspace(0.0, (2.0 * math.pi + lag) / frequency, NODES)
    begin = 0.1 * float(times[-1])
    observed = np.arange(NODES // 4, NODES - 1)
    window = SlipWindow(
        direction=1, rest_begin=0.0, breakaway=begin, arrest=0.8 * float(times[-1]), rest_position=0.0,
        rest_error=1e-6, source=ForceSource.GAINS, gains=Gains(stiffness=stiffness), times=times,
        references=speed * times, forces=0.0 * times, reference_speed=speed, observed=observed,
        values=np.linspace(0.0, 0.1, len(observed)), gaps=np.full(len(observed), times[1]), resolution=1e-5,
        noise=0.0, sample_interval=float(times[1]),
    )  # fmt: skip
    problem = SlipProblem([window]).with_curvature()
    assert problem.curved_at is not None
    own = viscous * inertia * frequency
    parameters = np.log([inertia, own, unit, lag / frequency, level, 0.3])
    positions, _, _ = problem.simulate(np.append(parameters, curvature), np.array([[0.0, begin, math.log(level)]]))
    drag = curvature * own / problem.curved_at
    expected = brute_force(
        inertia, stiffness, own * (1.0 - curvature), drag, level, unit, lag / frequency, speed, times, begin
    )
    assert np.abs(positions - expected).max() < 1e-3 * float(expected.max())


def test_without_evidence_a_supplement_is_as_likely_as_before() -> None:
    """Half, and less where it is known to be next to nothing; sure where it is many errors away from that."""
    assert TermScore(prior=0.5, value=0.0, std=0.5, moves=np.ones(1), gain=0.0).probability == pytest.approx(0.5)
    assert TermScore(prior=0.5, value=0.0, std=0.01, moves=np.ones(1), gain=0.0).probability < 0.02
    assert TermScore(prior=0.5, value=0.3, std=0.02, moves=np.ones(1), gain=200.0).probability == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("curvature", [0.5, -0.4])
def test_curved_friction_is_told(puma: Joint, curvature: float) -> None:
    """Stribeck friction and lag were several per cent and many errors off, and identified."""
    straight = Machine.of(puma)
    speed = 0.05
    machine = replace(straight, viscous=straight.viscous * (1.0 - curvature), drag=straight.viscous * curvature / speed)
    monitor = monitor_of(recording(machine, GAINS, RESOLUTION), GAINS)
    estimate = monitor.learner.estimate
    assert estimate is not None
    assert not estimate.mismatch
    assert estimate.curvature is not None
    at = estimate.curvature.speed
    viscous = machine.viscous + machine.drag * at
    true = machine.drag * at / viscous
    assert estimate.curvature.value == pytest.approx(true, abs=3.0 * estimate.curvature.std)
    assert ("more" if curvature > 0 else "less") + " than in proportion to the speed" in estimate.summary()
    assert off(estimate, "viscous", viscous) < 3.0
    for name in ("inertia", "stribeck", "stribeck_velocity", "lag", "rise_time"):
        assert off(estimate, name, float(getattr(machine, name))) < 3.0, name
    for name in ("inertia", "stribeck"):
        assert estimate[name].identified, name
    # A verdict is about slower motion, where curved friction gives less damping, or more.
    selected, _ = select_model(estimate, None, GAINS)
    assert selected is not None
    assert selected.uncertainty is not None
    drawn = float(np.median(selected.uncertainty.joint.friction.viscous)) / estimate["viscous"].value
    assert drawn == pytest.approx(1.0 - 0.5 * estimate.curvature.value, abs=0.1)
    learnt = monitor.learner.memory_of().learnt
    assert learnt is not None
    assert len(learnt.parameters) == PARAMETERS + 1
    # A monitor that is started anew goes on from there, slip by slip.
    memory = from_plain(LearnerMemory, to_plain(monitor.learner.memory_of()))
    assert memory.learnt is not None
    assert memory.learnt.curved_at == at


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, nightly(3)])
def test_errors_have_what_curved_friction_may_make(seed: int) -> None:
    """Two random joints: Stribeck friction 7.1 and 3.9 % off, 8.7 and 3.5 standard errors."""
    machine, estimate = learnt_from("drag", seed)
    assert estimate["stribeck"].identified
    for name in ("inertia", "stribeck", "stribeck_velocity"):
        assert off(estimate, name, float(getattr(machine, name))) < 2.5, name


@pytest.mark.slow
def test_straight_friction_stays_straight() -> None:
    """Where the paper's law holds, no curve is seen."""
    for seed in range(3):
        _, estimate = learnt_from("base", seed)
        assert estimate.curvature is None


_MORE_SLIPS = pytest.mark.xfail(reason="rests of 20 ms, stamps 2.5 ms off: their noise passes for a curve (issue 38)")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(15, marks=_MORE_SLIPS), 24, 39])
def test_noise_is_no_curve(seed: int) -> None:
    """With stray stamps and lost samples each of these had a curve, and up to three of six verdicts were wrong."""
    drawn = random_joint_recording(seed)
    windows, _ = cut_slips(drawn.noisy(1), drawn.gains)
    estimate = estimate_friction(windows)
    assert estimate is not None
    assert estimate.curvature is None
    frequency = math.sqrt(drawn.joint.inertia / estimate["inertia"].value)
    assert frequency == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
def test_more_than_all_static_friction_held_no_slip() -> None:
    """A slip after a long rest began at twice what F_s∞ was taken for, half of the true one, with an error of 1 %."""
    machine, estimate = learnt_from("drag", 8)
    assert not estimate["stribeck"].identified or off(estimate, "stribeck", machine.stribeck) < 2.5
