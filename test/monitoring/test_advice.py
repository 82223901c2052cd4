# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Advice reaches the wanted margin, with the least change, within its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.monitoring.advice import AdviceLimits, recommend


def reserve(joint: Joint, gains: Gains, velocity: float) -> float:
    margin = stability_margin(joint, gains, velocity)
    if margin.critical_damping_ratio == 0:
        return math.inf
    return float(margin.damping_ratio / margin.critical_damping_ratio - 1)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.01, 50.0), st.floats(3.0, 50.0), st.floats(0.0, 0.3), st.floats(0.3, 20.0), st.floats(0.3, 4.0),
    st.floats(0.0, 0.08), st.floats(0.0, 1.0), st.sampled_from([0.0, 0.2, 1.0]),
)  # fmt: skip
def test_advice_reaches_the_wanted_margin(
    inertia: float, frequency: float, ratio: float, level: float, speed: float,
    lag: float, rise_time: float, wanted: float,
) -> None:  # fmt: skip
    """Issue 2: the advised gains have the wanted margin, and change one gain only."""
    momentum = inertia * frequency
    friction = Friction(
        stribeck=level * momentum * 0.01, stribeck_velocity=0.01, lag=lag, rise_time=rise_time, viscous=0.02 * momentum
    )
    joint, gains = (
        Joint(inertia=inertia, friction=friction),
        Gains(stiffness=momentum * frequency, damping=2 * ratio * momentum),
    )
    advice = recommend(joint, gains, 0.01 * speed, AdviceLimits(wanted_margin=wanted))
    assert advice.found
    advised = Gains(stiffness=advice.stiffness, damping=advice.damping)
    assert reserve(joint, advised, 0.01 * speed) >= wanted * (1 - 1e-6) - 1e-8
    assert advised.stiffness == gains.stiffness or advised.damping == gains.damping
    if reserve(joint, gains, 0.01 * speed) >= wanted and stability_margin(joint, gains, 0.01 * speed).smooth:
        assert advised == gains


def test_it_is_the_least_change(puma: Joint) -> None:
    """Issue 2: no smaller change of either gain alone reaches the wanted margin (brute force on a grid)."""
    gains, velocity, limits = Gains(stiffness=2016.0, damping=5.0), 0.00493, AdviceLimits(wanted_margin=0.2)
    advice = recommend(puma, gains, velocity, limits)
    change = max(abs(math.log(advice.stiffness / 2016.0)), abs(math.log((advice.damping + 4.94) / (5.0 + 4.94))))
    for factor in np.exp(np.linspace(-change, change, 401) * 0.98):
        stiffer = Gains(stiffness=2016.0 * factor, damping=5.0)
        damped = Gains(stiffness=2016.0, damping=(5.0 + 4.94) * factor - 4.94)
        assert reserve(puma, stiffer, velocity) < 0.2
        assert reserve(puma, damped, velocity) < 0.2


def test_limits_are_kept_and_named(puma: Joint) -> None:
    """Issue 2: a bound sends the advice to the other gain; two bounds leave none, with the reason."""
    gains = Gains(stiffness=630.0)
    free = recommend(puma, gains, 0.0058)
    assert "stiffness" in free.reason
    bound = recommend(puma, gains, 0.0058, AdviceLimits(stiffness_range=(0.0, 2000.0)))
    assert bound.stiffness == 630.0
    assert bound.damping > 100.0
    none = recommend(puma, gains, 0.0058, AdviceLimits(stiffness_range=(0.0, 2000.0), damping_range=(0.0, 10.0)))
    assert not none.found
    assert "0 to 2000 N·m/rad" in none.reason
    with pytest.raises(InvalidParameterError, match="stiffness_range"):
        AdviceLimits(stiffness_range=(5.0, 1.0))


def test_where_the_equation_does_not_apply_there_is_no_advice(puma: Joint) -> None:
    """Issue 2: no advice where Eq. (43) does not apply, and why."""
    advice = recommend(puma, Gains(stiffness=630.0), 0.0)
    assert not advice.found
    assert "velocity is zero" in advice.reason
