# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction compensation in the loop: limits, known answers, what it cures and what it does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.compensation_effect import CompensationEffect, compensation_effect, largest_harmless_share
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.compensations import compensations

pytestmark = pytest.mark.slow

STIFFNESS, SPEED = 2016.0, 0.005
STICKS, CALM = Gains(stiffness=STIFFNESS), Gains(stiffness=STIFFNESS, damping=150.0)


def effect(joint: Joint, gains: Gains, **shares: float) -> CompensationEffect:
    """Of a controller that knows the friction."""
    compensation = Compensation(friction=joint.friction, **shares)
    return compensation_effect(joint, gains, SPEED, OperatingConditions(compensation=compensation))


def test_no_compensation_changes_nothing(puma: Joint) -> None:
    """Issue 23: at c = 0 verdict and ρ_c are those of the same joint simulated without."""
    found = effect(puma, STICKS)
    rigid = verdict(puma, STICKS, SPEED, detail=Detail.BOUNDARY)
    assert found.outcome is rigid.outcome is Outcome.STICKS
    assert found.critical_damping_ratio == pytest.approx(rigid.critical_damping_ratio, rel=0.02)


def test_feedforward_takes_the_error_and_not_the_stick_slip(puma: Joint) -> None:
    """Issue 23: a constant torque at constant speed: ρ_c stays, the steady error goes, the reversal gets better."""
    without, exact = effect(puma, CALM), effect(puma, CALM, feedforward=1.0)
    assert exact.critical_damping_ratio == pytest.approx(without.critical_damping_ratio, rel=0.02)
    expected = (8.43 + 1.6 / (1 + (SPEED / 0.0058) ** 2) + 4.94 * SPEED) / STIFFNESS
    assert without.steady_error == pytest.approx(expected, rel=0.01)
    assert abs(exact.steady_error) < 1e-3 * expected
    assert exact.peak_error < 0.2 * without.peak_error
    assert effect(puma, STICKS, feedforward=1.0).outcome is Outcome.STICKS


def test_too_much_feedforward_is_an_error_of_the_other_sign(puma: Joint) -> None:
    """Issue 23: 20 % too much leaves a fifth of the error, the other way round."""
    without, much = effect(puma, CALM), effect(puma, CALM, feedforward=1.2)
    assert much.steady_error == pytest.approx(-0.2 * without.steady_error, rel=0.02)
    assert much.peak_error > effect(puma, CALM, feedforward=1.0).peak_error


def test_feedback_takes_damping_away_and_hunts_when_too_much(puma: Joint) -> None:
    """Issue 23: tanh of the measured speed is negative damping c F_k/ε; beyond c = 1 the joint swings at standstill."""
    shares = {"width": 0.02, "resolution": 2.5e-5, "speed_filter": 0.01}
    without, half = effect(puma, STICKS), effect(puma, STICKS, feedback=0.5, **shares)
    assert half.critical_damping_ratio > 2.0 * without.critical_damping_ratio
    assert half.standing_swing < 1e-4
    assert effect(puma, STICKS, feedback=1.2, **shares).standing_swing > 0.01


def test_a_push_that_fades_is_damping(puma: Joint) -> None:
    """Issue 23: a push along the error, less the faster the joint: stick-slip ends, and the error gets smaller."""
    push = effect(puma, STICKS, push=0.5, fade=0.01, resolution=2.5e-5, speed_filter=0.01)
    assert push.outcome is Outcome.STEADY
    assert 0 < push.steady_error < effect(puma, STICKS).steady_error


def test_dither_leaves_a_small_swing(puma: Joint) -> None:
    """Issue 23: half the Coulomb friction at 30 Hz ends the slips; what is left is the dither's own swing."""
    without = effect(puma, STICKS)
    dither = effect(puma, STICKS, dither=0.5 * 8.43, dither_frequency=30.0)
    assert dither.swing < 0.1 * without.swing


def test_how_wrong_friction_may_be_known(puma: Joint) -> None:
    """Issue 23: feed-forward hurts from twice the friction on, when the error is as large as before, the other way."""
    share = largest_harmless_share(
        puma, CALM, SPEED, OperatingConditions(), lambda c: Compensation(friction=puma.friction, feedforward=c)
    )
    assert share == pytest.approx(2.0, abs=0.1)


def usual(joint: Joint, gains: Gains, speed: float, kind: str, share: float) -> CompensationEffect:
    """One row of the table of `recommend --compensation`."""
    kinds = compensations(joint, gains, OperatingConditions(), resolution=0.0)
    return compensation_effect(joint, gains, speed, OperatingConditions(compensation=kinds[kind](share)))


def test_a_constant_torque_changes_no_verdict(puma: Joint) -> None:
    """Issue 23: ρ_c was 0.93 without and 0.90 with feed-forward: of another integration, to a coarser tolerance."""
    soft = Gains(stiffness=630.0)
    alone = compensation_effect(puma, soft, 0.002, OperatingConditions())
    for share in (0.5, 1.2):
        found = usual(puma, soft, 0.002, "feed-forward", share)
        assert (found.outcome, found.critical_damping_ratio) == (alone.outcome, alone.critical_damping_ratio)


def test_worse_stick_slip_is_harm(puma: Joint) -> None:
    """Issue 23: full feedback multiplies ρ_c and swing of a joint that sticks by seven; it "did no harm up to 1.1"."""
    soft = Gains(stiffness=630.0)
    kinds = compensations(puma, soft, OperatingConditions(), resolution=0.0)
    assert largest_harmless_share(puma, soft, 0.002, OperatingConditions(), kinds["feedback"]) < 0.1
    alone, full = (usual(puma, soft, 0.002, "feedback", share) for share in (0.0, 1.0))
    assert full.critical_damping_ratio > 5.0 * alone.critical_damping_ratio
    assert full.swing > 5.0 * alone.swing


@pytest.mark.parametrize("share", [0.5, 0.8, 1.0, 1.2])
@pytest.mark.parametrize("kind", ["push", "dither"])
def test_push_and_dither_have_a_verdict(puma: Joint, kind: str, share: float) -> None:
    """Issue 23: of both there was none; under dither it is that of the motion between like phases."""
    for stiffness, speed in ((630.0, 0.002), (2016.0, 0.005)):
        found = usual(puma, Gains(stiffness=stiffness), speed, kind, share)
        assert found.outcome is not None, found.reason
        assert math.isfinite(found.critical_damping_ratio)


def test_dither_that_is_too_little_sticks(puma: Joint) -> None:
    """Issue 23: next to no dither leaves verdict and ρ_c as they are; enough of it ends stick-slip."""
    soft = Gains(stiffness=630.0)
    little = usual(puma, soft, 0.002, "dither", 1e-3)
    alone = verdict(puma, soft, 0.002, detail=Detail.BOUNDARY)
    assert little.outcome is alone.outcome is Outcome.STICKS
    assert little.critical_damping_ratio == pytest.approx(alone.critical_damping_ratio, rel=0.1)
    assert usual(puma, soft, 0.002, "dither", 0.5).outcome is Outcome.STEADY


def test_the_speed_is_filtered_and_quantized(puma: Joint) -> None:
    """Issue 23: the feedback sees counts a period through a filter of one time constant."""
    compensation = Compensation(
        friction=puma.friction, feedback=1.0, width=1e9, resolution=0.01, speed_filter=0.05, period=0.01
    )
    simulation = JointSimulation(puma, Gains(stiffness=6300.0), compensation=compensation)
    # Linear as the tanh is here, the torque is F_k/ε times the filtered speed.
    times = 0.01 * np.arange(400.0)
    motion = simulation.advance(0.01, 0.5 * times, np.full(400, 0.5))
    seen = np.concatenate([[0.0, 0.0], 0.01 * np.round(motion.position / 0.01)])[:-1]
    speed, expected = 0.0, []
    for step in np.diff(seen).tolist():
        speed += (step / 0.01 - speed) * -math.expm1(-0.2)
        expected.append(8.43 / 1e9 * speed)
    held = simulation.gains.stiffness * (0.5 * (times + 0.01) - motion.position)
    np.testing.assert_allclose(motion.effort - held, expected, atol=1e-10)


def test_what_cannot_be_is_refused(puma: Joint) -> None:
    """Issue 23: with the name of the value; dither beyond half the controller's rate is no dither."""
    for wrong in ({"feedforward": -0.1}, {"width": 0.0}, {"fade": math.nan}, {"period": 0.0}):
        with pytest.raises(InvalidParameterError, match=next(iter(wrong))):
            Compensation(friction=puma.friction, **wrong)
    with pytest.raises(InvalidParameterError, match="half the controller's rate"):
        Compensation(friction=puma.friction, dither=1.0, dither_frequency=600.0)
