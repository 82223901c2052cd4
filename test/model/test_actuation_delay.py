# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 18: a controller whose force acts late takes damping away, in every verdict and all advice."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import damping_for_ratio, dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.extinction_map import extinction_map
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.loop_modes import loop_is_unstable
from stickslip_ros.model.margin import change_factors, stability_margin
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.settings.known_joints import load_joint

PUMA = load_joint("puma560_joint1").joint
SPEED = 0.005


@pytest.mark.parametrize("value", [-0.001, math.nan, math.inf])
def test_a_delay_that_cannot_be(puma: Joint, value: float) -> None:
    """Refused by its name."""
    with pytest.raises(InvalidParameterError, match="actuation_delay"):
        replace(puma, actuation_delay=value)


def test_every_number_of_a_joint(puma: Joint) -> None:
    """Who compares joints by their numbers leaves none out: a delay that changes is another map."""
    units = [entry.name for kind in (Joint, Friction) for entry in fields(kind) if "unit" in entry.metadata]
    assert set(puma.numbers) == set(units)
    assert replace(puma, actuation_delay=0.004).numbers["actuation_delay"] == 0.004


@given(
    stiffness=st.floats(50.0, 5000.0),
    damping=st.floats(0.0, 200.0),
    delay=st.floats(1e-4, 0.01),
    of_viscous=st.booleans(),
)
def test_a_delay_is_damping_less(stiffness: float, damping: float, delay: float, *, of_viscous: bool) -> None:
    """k_p τ less, whether taken off the controller's damping or off viscous friction."""
    late, gains = replace(PUMA, actuation_delay=delay), Gains(stiffness=stiffness, damping=damping)
    found = stability_margin(late, gains, SPEED)
    taken = stiffness * delay
    if of_viscous and taken < float(PUMA.friction.viscous):
        friction = replace(PUMA.friction, viscous=float(PUMA.friction.viscous) - taken)
        expected = stability_margin(replace(PUMA, friction=friction), gains, SPEED)
    else:
        expected = stability_margin(PUMA, replace(gains, damping=damping - taken), SPEED)
    assert bool(found.applicable) == bool(expected.applicable)
    assert found.damping_ratio == pytest.approx(float(expected.damping_ratio), abs=1e-12, nan_ok=True)
    assert found.energy_margin == pytest.approx(float(expected.energy_margin), rel=1e-9, abs=1e-9, nan_ok=True)
    ratio = float(dimensionless_groups(late, gains, SPEED).damping_ratio)
    assert damping_for_ratio(late, stiffness, ratio) == pytest.approx(damping, abs=1e-9)
    assert loop_is_unstable(late, gains, OperatingConditions()) == (damping + float(PUMA.friction.viscous) < taken)
    factor = float(change_factors(late, gains, SPEED)["damping"])
    if math.isfinite(factor):
        needed = float(change_factors(PUMA, gains, SPEED)["damping"]) * damping + taken
        assert factor * damping == pytest.approx(needed, rel=1e-9)


@pytest.mark.parametrize(("period", "late"), [(0.002, False), (0.002, True), (0.005, True)])
def test_a_delay_beside_a_controller_that_is_sampled(puma: Joint, period: float, late: bool) -> None:
    """What a delay takes off is what holding the effort takes, and sending it a period late, to the first order."""
    delay = (1.5 if late else 0.5) * period
    gains = Gains(stiffness=2000.0, damping=40.0)
    sampled = OperatingConditions(controller_period=period, control_delay=late)
    without = verdict(puma, gains, SPEED, detail=Detail.BOUNDARY)
    true = verdict(puma, gains, SPEED, sampled, detail=Detail.BOUNDARY)
    delayed = replace(puma, actuation_delay=delay)
    found = verdict(delayed, gains, SPEED, detail=Detail.BOUNDARY)
    needed, truly, nothing = (
        float(damping_for_ratio(joint, gains.stiffness, answer.critical_damping_ratio))
        for joint, answer in ((delayed, found), (puma, true), (puma, without))
    )
    assert needed - nothing == pytest.approx(gains.stiffness * delay, abs=0.1)
    assert truly - nothing == pytest.approx(needed - nothing, rel=0.2)
    # A stated period is that delay; it does not count twice.
    once = verdict(delayed, gains, SPEED, sampled, detail=Detail.BOUNDARY)
    # In words, as fields that are NaN make it unequal to itself from Python 3.13 on.
    assert repr(once) == repr(true)


def test_a_simulation_with_a_delay(puma: Joint) -> None:
    """Continuous control has the damping less; sampled control has its own delay."""
    references, speeds = SPEED * 0.002 * np.arange(2000), np.full(2000, SPEED)
    gains, late = Gains(stiffness=630.0, damping=10.0), replace(puma, actuation_delay=0.004)
    less = replace(gains, damping=10.0 - 630.0 * 0.004)
    for sampled, other in ((False, less), (True, gains)):
        one = JointSimulation(late, gains, sampled=sampled).advance(0.002, references, speeds)
        expected = JointSimulation(puma, other, sampled=sampled).advance(0.002, references, speeds)
        assert np.allclose(one.position, expected.position, atol=1e-12)


@pytest.mark.parametrize("condition", list(Criterion))
@pytest.mark.parametrize("damping", [10.0, 0.0])
def test_advice_gives_back_what_the_delay_takes(puma: Joint, condition: Criterion, damping: float) -> None:
    """At the same stiffness k_p τ more damping, also where the present gains have less than none in all."""
    delay, gains = 0.008, Gains(stiffness=630.0, damping=damping)
    late, limits = replace(puma, actuation_delay=delay), AdviceLimits(condition=condition, steady_sliding=False)
    plain = recommend(puma, gains, SPEED, limits)[Kind.DAMPING_ONLY]
    answer = recommend(late, gains, SPEED, limits)
    found = answer[Kind.DAMPING_ONLY]
    assert found.damping == pytest.approx(plain.damping + 630.0 * delay, rel=0.02)
    least = answer[Kind.LEAST_CHANGE]
    assert least.found
    assert verdict(late, least.gains, SPEED, detail=Detail.BOUNDARY).smooth
    if condition is Criterion.EXACT:
        groups = dimensionless_groups(late, least.gains, SPEED)
        assert float(groups.damping_ratio) >= 1.19 * float(exact_critical_damping_ratio(groups))


def test_a_map_with_a_delay(puma: Joint) -> None:
    """The stiffer the controller, the less is left of the damping: at each stiffness what its verdicts have."""
    late = replace(puma, actuation_delay=0.004)
    stiffness, velocity = np.array([300.0, 3000.0]), np.array([0.002, 0.01])
    found = extinction_map(late, velocity, stiffness)
    total = found.total_damping(20.0)
    assert total.ravel() == pytest.approx(20.0 + 4.94 - 0.004 * stiffness)
    for row, column in np.ndindex(found.exact_damping.shape):
        needed = found.exact_damping[row, column] - (total[row, 0] - 20.0)
        for share in (0.95, 1.05):
            gains = Gains(stiffness=stiffness[row], damping=share * needed)
            assert verdict(late, gains, velocity[column], detail=Detail.BOUNDARY).smooth == (share > 1.0)
