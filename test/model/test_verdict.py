# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact verdict on one joint, in the paper's case and beyond it."""

from __future__ import annotations

import importlib
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation, simulate
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, ExactVerdict, verdict

GAINS = Gains(stiffness=2016.0, damping=20.0)
SPEED = 0.00493


def same(one: ExactVerdict, other: ExactVerdict, rel: float) -> bool:
    """Verdicts that differ by no more than a share."""
    return one.smooth == other.smooth and math.isclose(
        one.critical_damping_ratio, other.critical_damping_ratio, rel_tol=rel
    )


def test_all_that_the_verdict_tells(puma: Joint) -> None:
    """Issue 3: exact verdict, critical damping ratio, lowest smooth velocity, least stiffness."""
    answer = verdict(puma, GAINS, SPEED)
    assert answer.smooth is False
    assert answer.reason is None
    assert answer.critical_damping_ratio == pytest.approx(0.1628, rel=0.005)
    assert answer.lowest_smooth_velocity > SPEED
    assert answer.least_smooth_stiffness > 2016.0
    assert verdict(puma, replace(GAINS, stiffness=1.01 * answer.least_smooth_stiffness), SPEED).smooth
    assert verdict(puma, GAINS, 1.01 * answer.lowest_smooth_velocity).smooth
    quick = verdict(puma, GAINS, SPEED, detail=Detail.BOUNDARY)
    assert same(quick, answer, 1e-12)
    assert math.isnan(quick.lowest_smooth_velocity)


@pytest.mark.parametrize(
    ("gains", "velocity", "reason"),
    [
        (Gains(stiffness=0.0), 0.01, "the stiffness is not positive"),
        (Gains(stiffness=100.0), 0.0, "the commanded velocity is zero"),
        (Gains(stiffness=math.nan), 0.01, "not a finite number"),
        (Gains(stiffness=5e-324), 0.01, "damping ratio is beyond"),
        (Gains(stiffness=100.0, damping=1e9), 0.01, "damping ratio is beyond 20"),
        (Gains(stiffness=100.0, damping=-50.0), 0.01, "damping is negative"),
        (Gains(stiffness=100.0), 1e9, "too large to integrate"),
    ],
)
def test_meaningless_questions_have_no_answer(puma: Joint, gains: Gains, velocity: float, reason: str) -> None:
    """Issue 3: no number where the question has no meaning, and the reason."""
    answer = verdict(puma, gains, velocity)
    assert answer.smooth is None
    assert answer.reason is not None
    assert reason in answer.reason
    assert math.isnan(answer.critical_damping_ratio)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e-6, 1e-3, 1e6, nightly(1e9)])
@pytest.mark.parametrize("velocity", [nightly(1e-9), 1e-3, 10.0])
def test_extreme_joints_are_answered_in_time(puma: Joint, stiffness: float, velocity: float) -> None:
    """Issue 3: no gain or speed makes the integration run away."""
    begin = time.process_time()
    verdict(puma, Gains(stiffness=stiffness), velocity)
    assert time.process_time() - begin < 30.0


def test_a_load_changes_no_verdict(puma: Joint) -> None:
    """Issue 3: a constant load shifts the position, not the verdict; simulated with and without integral action."""
    plain = verdict(puma, GAINS, SPEED)
    assert same(verdict(puma, GAINS, SPEED, OperatingConditions(load=7.0)), plain, 1e-12)
    integral = replace(GAINS, integral=500.0)
    loaded = verdict(puma, integral, SPEED, OperatingConditions(load=7.0))
    assert same(loaded, verdict(puma, integral, SPEED), 0.011)


def test_little_integral_action_and_fast_control_are_the_papers_case(puma: Joint) -> None:
    """Issue 3: k_i → 0 and a controller period → 0 lead to the paper's case, from another integrator."""
    plain = verdict(puma, GAINS, SPEED)
    assert same(verdict(puma, replace(GAINS, integral=1.0), SPEED), plain, 0.015)
    assert same(verdict(puma, GAINS, SPEED, OperatingConditions(controller_period=2e-4)), plain, 0.015)


def test_slow_control_needs_more_damping(puma: Joint) -> None:
    """Issue 3: a sampled controller needs more damping, one period of delay still more, and too slow it never calms."""
    ratios = [
        verdict(puma, GAINS, SPEED, conditions).critical_damping_ratio
        for conditions in (
            OperatingConditions(),
            OperatingConditions(controller_period=0.005),
            OperatingConditions(controller_period=0.01),
            OperatingConditions(controller_period=0.01, control_delay=True),
        )
    ]
    assert ratios == sorted(ratios)
    assert ratios[-1] > 1.3 * ratios[0]
    assert verdict(puma, GAINS, SPEED, OperatingConditions(controller_period=0.1, control_delay=True)).smooth is False


def test_hunting_at_standstill(puma: Joint) -> None:
    """Issue 3: strong integral action makes a joint hunt about a standing reference; weak or none does not."""
    soft = Gains(stiffness=630.0, damping=20.0)
    hunting = verdict(puma, replace(soft, integral=1000.0), 0.0)
    assert hunting.smooth is False
    assert hunting.reason == "hunting"
    calm = verdict(puma, replace(soft, integral=200.0), 0.0)
    assert calm.smooth is True
    assert calm.reason is None
    without_excess = replace(puma, friction=replace(puma.friction, stribeck=0.0))
    assert verdict(without_excess, replace(soft, integral=200.0), 0.0).smooth is True


def test_sampled_control_holds_its_effort_and_may_be_late(puma: Joint) -> None:
    """Issue 3: the effort of a sampled controller is that of the sample, or of the one before."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=0.0, stribeck_velocity=1.0))
    gains = Gains(stiffness=4.0, damping=1.0)
    efforts = {}
    for late in (False, True):
        simulation = JointSimulation(joint, gains, sampled=True, control_delay=late)
        motion = simulation.advance(0.1, np.full(30, 1.0), np.zeros(30))
        position = np.concatenate([[0.0], motion.position])
        velocity = np.concatenate([[0.0], motion.velocity])
        expected = 4.0 * (1.0 - position) - velocity
        efforts[late] = motion.effort
        np.testing.assert_allclose(motion.effort[late:], expected[: 30 - late], rtol=1e-9)
        # Between samples the effort is constant, so the velocity is linear in time.
        np.testing.assert_allclose(np.diff(velocity), 0.1 * motion.effort, atol=1e-9)
    assert efforts[True][0] == 0.0
    continuous = simulate(joint, gains, np.full(30, 1.0), np.zeros(30), period=0.1)
    assert not np.allclose(continuous.effort, efforts[False])


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"load": math.inf}, "load"),
        ({"controller_period": -1.0}, "controller_period"),
        ({"control_delay": True}, "controller_period"),
    ],
)
def test_bad_conditions_are_refused_by_name(values: dict[str, float], name: str) -> None:
    """Issue 3: conditions that cannot be are refused with their name."""
    with pytest.raises(InvalidParameterError, match=f"'{name}'"):
        OperatingConditions(**values)  # type: ignore[arg-type]


def test_a_controller_too_fast_to_follow_has_no_answer(puma: Joint) -> None:
    """Issue 3: where a natural period holds too many controller periods the answer says so."""
    answer = verdict(puma, Gains(stiffness=0.1), SPEED, OperatingConditions(controller_period=1e-5))
    assert answer.smooth is None


def test_earlier_names_answer_for_one_version(puma: Joint) -> None:
    """Issue 39: functions that `verdict` and `outcomes` replace are there, with a warning of what to write instead."""
    for name, of, answers in (
        ("exact_verdict", "verdict", lambda ask: repr(ask(puma, GAINS, SPEED)) == repr(verdict(puma, GAINS, SPEED))),
        ("exactly_smooth", "verdict", lambda ask: ask(puma, GAINS, SPEED) is False),
        ("exactly_smooth", "verdict", lambda ask: ask(puma, replace(GAINS, integral=1e9), SPEED) is False),
        ("exact_outcome", "verdict", lambda ask: ask(puma, GAINS, SPEED).outcome is Outcome.STICKS),
        ("is_steady", "outcome", lambda ask: not ask(dimensionless_groups(puma, GAINS, SPEED))),
        ("ever_sticks", "outcome", lambda ask: ask(dimensionless_groups(puma, GAINS, SPEED))),
    ):
        with pytest.warns(DeprecationWarning, match=f"{name} is "):
            earlier = getattr(importlib.import_module(f"stickslip_ros.model.{of}"), name)
        assert answers(earlier), name
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        _ = importlib.import_module("stickslip_ros.model.verdict").other
