# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Loops whose motion grows without end: told as that, by every command, and never as a motion."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from stickslip_ros.cli.main import main
from stickslip_ros.model.compensation_effect import compensation_effect
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.long_motion import UnstableLoopError
from stickslip_ros.model.loop_modes import loop_is_unstable
from stickslip_ros.model.reversal import followed, reversal_map, sine
from stickslip_ros.model.verdict import Detail, verdict

UNSTABLE = "the loop is unstable: its motion grows without end"
GIVEN = ["--model", "puma560_joint1", "--stiffness", "6300"]
RUNS_AWAY = [
    ["--damping", "-500"],
    ["--damping", "200", "--integral", "1e9"],
    ["--damping", "200", "--controller-period", "1"],
]


@pytest.mark.parametrize("seed", range(20))
def test_the_linear_loop_by_simulation(seed: int) -> None:
    """Issue 23: without dry friction the simulated joint moves off exactly where the loop is said to be unstable."""
    random = np.random.default_rng(seed)
    inertia, frequency = 10 ** random.uniform(-1, 1), random.uniform(5.0, 20.0)
    stiffness = inertia * frequency**2
    friction = Friction(stribeck=0.0, stribeck_velocity=1.0, viscous=random.choice([0.0, 0.3]) * inertia * frequency)
    joint = Joint(inertia=inertia, friction=friction)
    gains = Gains(
        stiffness=stiffness,
        damping=random.uniform(-0.2, 3.0) * inertia * frequency,
        integral=random.choice([0.0, 1.0]) * random.uniform(0.0, 2.0) * stiffness * frequency,
    )
    sampled = bool(random.integers(0, 2))
    conditions = OperatingConditions(
        controller_period=random.uniform(0.02, 1.0) / frequency if sampled else 0.0,
        control_delay=sampled and bool(random.integers(0, 2)),
    )
    simulation = JointSimulation(joint, gains, position=1.0, sampled=sampled, control_delay=conditions.control_delay)
    period = conditions.controller_period or 0.1 / frequency
    count = math.ceil(200.0 / frequency / period)
    position = simulation.advance(period, np.zeros(count), np.zeros(count)).position
    early, late = np.abs(position[: count // 2]).max(), np.abs(position[-count // 4 :]).max()
    assert loop_is_unstable(joint, gains, conditions) is not bool(late < early)


@pytest.mark.parametrize("options", RUNS_AWAY)
def test_reversal_says_so(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: no following error is told of a motion that grows without end; in JSON neither."""
    given = ["reversal", *GIVEN, "--amplitude", "0.02", "--frequency", "0.05", *options]
    for more in ([], ["--json"]):
        assert main([*given, *more]) == 2
        told = capsys.readouterr()
        assert UNSTABLE in told.err
        assert told.out == ""


def test_margin_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: the exact verdict has no answer then, at a speed as at standstill."""
    for velocity in ("0.0058", "0"):
        given = ["margin", *GIVEN, "--damping", "200", "--integral", "1e9", "--velocity", velocity]
        main(given)
        assert f"no answer, because {UNSTABLE}" in capsys.readouterr().out
        main([*given, "--json"])
        exact = json.loads(capsys.readouterr().out)["exact"]
        assert (exact["smooth"], exact["outcome"], exact["reason"]) == (None, None, f"no answer, because {UNSTABLE}")


def test_what_advice_and_pictures_make_of_it(puma: Joint) -> None:
    """Issue 23: gains that make a loop unstable are never smooth; compensation beside them has no effect to tell."""
    gains = Gains(stiffness=6300.0, damping=200.0, integral=1e9)
    conditions = OperatingConditions()
    for speed in (0.005, 0.0):
        for detail in Detail:
            found = verdict(puma, gains, speed, conditions, detail=detail)
            assert (found.smooth, found.unstable) == (None, True)
    reference = sine(0.02, 0.05, puma, gains)
    with pytest.raises(UnstableLoopError, match=UNSTABLE):
        followed(puma, gains, reference)
    assert reversal_map(puma, gains, [reference]) == [()]
    effect = compensation_effect(puma, gains, 0.005, conditions)
    assert effect.unstable
    assert effect.outcome is None
    assert math.isnan(effect.steady_error)
    assert math.isnan(effect.peak_error)


def test_a_loop_that_friction_holds_is_followed(puma: Joint) -> None:
    """Issue 23: what is unstable without friction, but stays near, has a motion that can be told."""
    gains = Gains(stiffness=630.0, integral=1000.0)
    assert loop_is_unstable(puma, gains, OperatingConditions())
    reference = sine(0.005, 0.1, puma, gains)
    assert np.abs(followed(puma, gains, reference).position).max() < 0.1
