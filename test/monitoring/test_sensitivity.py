# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What lubricant and mechanics could do."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.model.verdict import verdict
from stickslip_ros.monitoring.advice.limits import Criterion
from stickslip_ros.monitoring.advice.sensitivity import PARAMETERS, in_words, sensitivities

GAINS, SPEED = Gains(stiffness=2016.0), 0.00493


def changed(joint: Joint, parameter: str, factor: float) -> Joint:
    return replace(joint, friction=replace(joint.friction, **{parameter: getattr(joint.friction, parameter) * factor}))


def ratio(joint: Joint, condition: Criterion) -> float:
    if condition is Criterion.PAPER:
        margin = stability_margin(joint, GAINS, SPEED)
        return float(margin.damping_ratio / margin.critical_damping_ratio)
    groups = dimensionless_groups(joint, GAINS, SPEED)
    return float(groups.damping_ratio / exact_critical_damping_ratio(groups, tolerance=1e-5))


@pytest.mark.parametrize("condition", list(Criterion))
def test_elasticities_are_derivatives_and_factors_reach_the_margin(puma: Joint, condition: Criterion) -> None:
    """Issue 5, item 1: the margin's sensitivity to each friction parameter, against differences; factors do cure."""
    found = sensitivities(puma, GAINS, SPEED, condition=condition)
    assert tuple(one.parameter for one in found) == PARAMETERS
    for one in found:
        step = 1.02
        slope = math.log(
            ratio(changed(puma, one.parameter, step), condition)
            / ratio(changed(puma, one.parameter, 1 / step), condition)
        ) / (2 * math.log(step))
        assert one.elasticity == pytest.approx(slope, abs=0.05, rel=0.05)
        if math.isfinite(one.factor):
            cured = changed(puma, one.parameter, one.factor)
            margin = stability_margin(cured, GAINS, SPEED)
            if condition is Criterion.EXACT or margin.critical_damping_ratio > 0:
                assert ratio(cured, condition) >= 1.2 * (1 - 1e-3)
            # Half as large a change of it is not enough.
            assert ratio(changed(puma, one.parameter, math.sqrt(one.factor)), condition) < 1.2
    by_name = {one.parameter: one for one in found}
    # The paper's conclusion: less static friction in excess, more lag.
    assert by_name["stribeck"].elasticity < 0 < by_name["lag"].elasticity
    assert by_name["viscous"].elasticity == pytest.approx(1.0)
    assert "stribeck × 0." in in_words(found)


def test_nothing_is_needed_where_the_margin_is_there(puma: Joint) -> None:
    """Issue 5, item 1: a joint with the wanted margin needs no other friction; without stiffness there is no answer."""
    found = sensitivities(puma, Gains(stiffness=2016.0, damping=300.0), SPEED)
    assert {one.factor for one in found} == {1.0}
    assert in_words(found) == ""
    assert all(math.isnan(one.elasticity) for one in sensitivities(puma, Gains(stiffness=0.0), SPEED))


@pytest.mark.parametrize(
    ("integral", "conditions"),
    [(1500.0, OperatingConditions()), (0.0, OperatingConditions(controller_period=0.02, control_delay=True))],
    ids=["integral", "late"],
)
def test_none_is_claimed_where_the_joint_would_stick_on(
    puma: Joint, integral: float, conditions: OperatingConditions
) -> None:
    """Four times the lag ends stick-slip under PD control; with integral action or late control it does not."""
    gains = Gains(stiffness=630.0, integral=integral)
    laggard = replace(puma, friction=replace(puma.friction, lag=4.6 * float(puma.friction.lag)))
    assert verdict(laggard, replace(gains, integral=0.0), 0.0058).smooth is True
    assert verdict(laggard, gains, 0.0058, conditions).smooth is False
    assert sensitivities(puma, gains, 0.0058, conditions, condition=Criterion.EXACT) == ()
