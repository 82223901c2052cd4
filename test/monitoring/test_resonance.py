# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 39: advice on motor and load on a spring; what it reaches, and which gains it refuses."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from model.brute_two_masses import random_joint
from random_joints import random_recording

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint, Transmission
from stickslip_ros.model.loop_modes import least_modal_damping
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop, bounds_at, criterion_for
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.joint_monitor import JointMonitor

pytestmark = pytest.mark.slow

SPRING = Transmission(resonance=12.0, antiresonance=8.0)
CONTROLLERS = {
    "continuous": OperatingConditions(),
    "at 250 Hz, late": OperatingConditions(controller_period=0.004, control_delay=True),
}


def sticking_joint(seed: int, encoder: str, conditions: OperatingConditions) -> tuple[Joint, Gains, float]:
    """A joint of two masses, with a resonance of 5 to 40 Hz, that sticks with its gains at its speed."""
    rng = np.random.default_rng(seed)
    while True:
        drawn = random_joint(rng, encoder)
        joint, gains, velocity = drawn.joint, drawn.gains, drawn.velocity
        if verdict(joint, gains, velocity, conditions, detail=Detail.OUTCOME).outcome is Outcome.STICKS:
            return joint, gains, velocity


CASES = list(itertools.product(range(25), ("motor", "load"), CONTROLLERS))
# The last one's spring would keep too little damping if nothing cared.
BY_DAY = [case for case in CASES if case[0] == 1] + [(8, "load", "continuous")]


@pytest.mark.parametrize(
    ("seed", "encoder", "controller"), [case if case in BY_DAY else nightly(*case) for case in CASES]
)
def test_advice_cures_two_masses_and_makes_none_oscillate(seed: int, encoder: str, controller: str) -> None:
    """With the advised gains the motor slides steadily, and every mode keeps half of the spring's damping ratio.

    Where there are none, the resonance is in the way: of damping by a late encoder or one on the load, or of bandwidth.
    """
    conditions = CONTROLLERS[controller]
    joint, gains, velocity = sticking_joint(seed, encoder, conditions)
    advice = recommend(joint, gains, velocity, loop=ObservedLoop(conditions=conditions))
    for variant in advice.variants:
        if variant.found:
            after = verdict(joint, variant.gains, velocity, conditions, detail=Detail.OUTCOME)
            assert after.outcome is Outcome.STEADY
            assert least_modal_damping(joint, variant.gains, conditions) > 0.49 * SPRING.spring_damping
    first = advice[Kind.LEAST_CHANGE]
    if not first.found:
        assert "resonance" in first.reason
    assert f"{joint.transmission.resonance:.4g} Hz" in advice.resonance  # type: ignore[union-attr]


@pytest.mark.parametrize("period", [0.0, 0.004])
@pytest.mark.parametrize("encoder", ["motor", "load"])
def test_the_limit_is_where_a_mode_has_half_of_the_springs_damping(puma: Joint, encoder: str, period: float) -> None:
    """A little inside the limit every mode has more, a little outside one has less."""
    joint = replace(puma, transmission=replace(SPRING, encoder=encoder), actuation_delay=0.0 if period else 0.003)
    conditions = OperatingConditions(controller_period=period)
    stiffness = np.geomspace(30.0, 3e5, 30)
    limits, loop = AdviceLimits(), ObservedLoop(conditions=conditions)
    bound = bounds_at(stiffness, joint, Gains(stiffness=630.0), limits, loop)["resonance"]
    edges = 0
    for value, least, largest in zip(stiffness, bound.least, bound.largest, strict=True):
        for edge, inwards in ((least, 1.0), (largest, -1.0)):
            if least < largest and 0 < edge < math.inf:
                # The limit at a stiffness is the stricter one of two that are 8 % of it away at most.
                inside, outside = (
                    float(least_modal_damping(joint, Gains(stiffness=value, damping=edge * factor), conditions))
                    for factor in (1.02**inwards, 1.2**-inwards)
                )
                assert outside < 0.5 * SPRING.spring_damping < inside
                edges += 1
    assert edges > 5


def test_a_motor_that_is_measured_in_time_excites_nothing(puma: Joint) -> None:
    """Its damping goes to the resonance too; a rigid joint has no such limit."""
    joint, stiffness = replace(puma, transmission=SPRING), np.geomspace(100.0, 1e5, 10)
    bounds = bounds_at(stiffness, joint, Gains(stiffness=630.0), AdviceLimits(), ObservedLoop())
    assert (bounds["resonance"].largest > 100.0 * np.sqrt(stiffness * 6.3)).all() or np.isinf(
        bounds["resonance"].largest
    ).any()
    assert "which no damping excites" in recommend(joint, Gains(stiffness=630.0), 0.0058).resonance
    assert "resonance" not in bounds_at(stiffness, puma, Gains(stiffness=630.0), AdviceLimits(), ObservedLoop())


def test_the_bandwidth_follows_from_the_resonance(puma: Joint) -> None:
    """Unless a user gives another, or the present gains have more."""
    joint, stiffness = replace(puma, transmission=SPRING), np.array([630.0])

    def text(limits: AdviceLimits, present: float = 630.0) -> str:
        return bounds_at(stiffness, joint, Gains(stiffness=present), limits, ObservedLoop())["bandwidth"].text

    assert text(AdviceLimits()) == "75.4 rad/s, of the resonance at 12 Hz"
    assert text(AdviceLimits(bandwidth=200.0)) == "200 rad/s"
    assert text(AdviceLimits(), 6.3 * 100.0**2).startswith("100")


def test_the_reason_names_resonance_and_gains(puma: Joint) -> None:
    """What an encoder on the load leaves of the damping is not enough, and the advice says at which gains it rings."""
    joint = replace(puma, transmission=replace(SPRING, encoder="load"))
    advice = recommend(joint, Gains(stiffness=630.0), 0.0058)
    reason = advice[Kind.LEAST_CHANGE].reason
    assert "resonance (at 12 Hz, which damping above " in reason
    assert "N·m·s/rad excites at a stiffness of 630 N·m/rad" in reason
    limit = float(reason.partition("damping above ")[2].partition(" ")[0])
    for factor, damped in ((0.98, True), (1.1, False)):
        modes = least_modal_damping(joint, Gains(stiffness=630.0, damping=factor * limit), OperatingConditions())
        assert bool(modes > 0.01) is damped


def test_eq_43_is_not_of_two_masses(puma: Joint) -> None:
    """Advice by the paper's condition is by integration there."""
    assert criterion_for(replace(puma, transmission=SPRING), Criterion.PAPER) is Criterion.EXACT
    assert criterion_for(puma, Criterion.PAPER) is Criterion.PAPER


def test_a_learnt_joint_keeps_the_configured_spring() -> None:
    """No slip shows it; the monitor's advice takes it from the joint's file."""
    recording = random_recording(3)
    spring = Transmission(resonance=30.0, antiresonance=20.0, encoder="load")
    monitor = JointMonitor(replace(recording.joint, transmission=spring), recording.gains, studies_at_once=True)
    monitor.process(recording.batch)
    monitor.finish()
    found = monitor.assessment()
    assert found.joint is not None
    assert found.uncertainty is not None
    assert found.joint.transmission == spring
    assert found.recommendation is not None
    assert "resonance at 30 Hz, which damping above" in found.recommendation.resonance


def test_advice_says_that_a_resonance_is_not_known(puma: Joint) -> None:
    """With the encoder on the load, damping × 61 made a resonance unstable, and nothing had been said of it."""
    present = Gains(stiffness=630.0)
    advised = recommend(puma, present, 0.0058)
    assert advised.resonance.startswith("unknown resonance, which these gains may excite: they raise the bandwidth")
    # What the user has bounded is not warned of, nor gains that change little.
    assert not recommend(puma, present, 0.0058, AdviceLimits(bandwidth=100.0)).resonance
    assert not recommend(puma, Gains(stiffness=630.0, damping=100.0), 0.0058).resonance
