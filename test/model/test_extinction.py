# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Eqs (27)-(43) against quadrature, limits and the paper's numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.extinction import (
    approximate_reduction_factor,
    critical_damping_ratio,
    energy_margin,
    reduction_factor,
    steady_stribeck,
    stiffness_velocity_product,
    work_integral,
)
from stickslip_ros.model.friction import Friction, Gains, Joint

LOG_VELOCITY = st.floats(-4.0, 3.0)
LAG = st.floats(0.0, 2.0 * math.pi)


def quadrature(velocity: float, lag: float) -> float:
    """Eq. (27) as printed, by adaptive quadrature; the peak of width 1/√velocity at t = τ* is pointed out."""
    width = 1.0 / math.sqrt(velocity)
    marks = [lag + factor * width for factor in (0.1, 1.0, 3.0, 10.0)] + [2 * math.pi - 0.1 * width]
    value, _ = quad(
        lambda t: math.cos(t) / (velocity**2 * (1.0 - math.cos(t - lag)) ** 2 + 1.0),
        lag,
        2.0 * math.pi,
        points=[mark for mark in marks if lag < mark < 2.0 * math.pi] or None,
        epsabs=1e-14,
        epsrel=1e-13,
        limit=1000,
    )
    return math.sin(lag) + value


@settings(max_examples=400, deadline=None)
@given(LOG_VELOCITY, LAG)
@example(0.0, math.pi)
@example(3.0, math.pi)
@example(-4.0, math.pi)
@example(math.log10(0.05), 1.0)
@example(2.0, 2.0 * math.pi)
def test_closed_form_agrees_with_quadrature(log_velocity: float, lag: float) -> None:
    """Issue 2: (27) in closed form to 1e-12 over 1e-4 <= velocity <= 1e3, 0 <= lag <= 2π, π included."""
    velocity = 10.0**log_velocity
    assert work_integral(velocity, lag) == pytest.approx(quadrature(velocity, lag), abs=1e-12)


@settings(max_examples=200, deadline=None)
@given(LAG)
def test_no_velocity_no_work(lag: float) -> None:
    """Issue 2: the limit of (27) for vanishing velocity is 0, approached quadratically."""
    assert work_integral(0.0, lag) == pytest.approx(0.0, abs=1e-15)
    assert abs(work_integral(1e-6, lag)) < 1e-10


@pytest.mark.parametrize("velocity", [1e-3, 0.3, 1.0, 30.0])
def test_limits_of_lag(velocity: float) -> None:
    """Issue 2: (27) is continuous at τ* → 0 and π, and vanishes at 2π (constant friction)."""
    for lag in (0.0, math.pi):
        near = work_integral(velocity, lag + 1e-9)
        assert work_integral(velocity, lag) == pytest.approx(near, abs=1e-7)
    assert work_integral(velocity, math.pi - 1e-12) == pytest.approx(
        work_integral(velocity, math.pi + 1e-12), abs=1e-10
    )
    assert work_integral(velocity, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_known_value() -> None:
    """Issue 2: I(0.75, 1) of physics.md to all printed digits."""
    assert work_integral(0.75, 1.0) == pytest.approx(0.6613186621493, abs=5e-14)


@pytest.mark.parametrize(("velocity", "lag"), [(-1.0, 1.0), (1.0, -0.1), (1.0, 6.3), (math.nan, 1.0), (math.inf, 1.0)])
def test_outside_the_domain_is_never_a_number(velocity: float, lag: float) -> None:
    """Issue 2: outside its domain (27) has no value."""
    assert math.isnan(work_integral(velocity, lag))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(LOG_VELOCITY, LAG), min_size=1, max_size=20))
def test_arrays_and_scalars_agree(points: list[tuple[float, float]]) -> None:
    """Issue 2: scalars and arrays go through the same functions."""
    velocities, lags = 10.0 ** np.array(points)[:, 0], np.array(points)[:, 1]
    together = work_integral(velocities, lags)
    assert isinstance(together, np.ndarray)
    singly = [work_integral(float(v), float(lag)) for v, lag in zip(velocities, lags, strict=True)]
    # Vectorised and scalar trigonometry may differ in the last digits.
    np.testing.assert_allclose(together, singly, rtol=0, atol=1e-13)


def test_numbers_of_the_paper_at_320(puma: Joint) -> None:
    """Issue 2: k_p/M = 320, velocity 0.85 of physics.md to all printed digits."""
    groups = dimensionless_groups(puma, Gains(stiffness=320 * 6.3), 0.85 * 0.0058)
    assert groups.damping_ratio == pytest.approx(0.0219170, abs=5e-8)
    assert critical_damping_ratio(groups) == pytest.approx(0.4437245, abs=5e-8)
    assert reduction_factor(groups.velocity, groups.lag) == pytest.approx(0.0917999, abs=5.1e-8)
    unit = 6.3 * groups.natural_frequency * 0.0058
    assert steady_stribeck(groups) * unit == pytest.approx(1.4795647, abs=5e-8)


groups_strategy = st.builds(
    DimensionlessGroups,
    natural_frequency=st.just(10.0),
    damping_ratio=st.floats(0.0, 2.0),
    stribeck=st.floats(0.0, 50.0),
    velocity=st.floats(1e-3, 50.0),
    lag=LAG,
    rise_time=st.floats(0.0, 50.0),
)


@settings(max_examples=300, deadline=None)
@given(groups_strategy)
def test_margin_vanishes_at_the_critical_damping(groups: DimensionlessGroups) -> None:
    """Issue 2: the margin is zero at ρ_c, and grows by 2π ξ˙_d² per unit of damping ratio."""
    critical = critical_damping_ratio(groups)
    excess = 2.0 * math.pi * groups.velocity**2 * (groups.damping_ratio - critical)
    scale = 1.0 + 2.0 * math.pi * groups.velocity**2 * (groups.damping_ratio + critical)
    if critical > 0:
        assert energy_margin(groups) == pytest.approx(excess, abs=1e-12 * scale)
    else:
        assert energy_margin(groups) >= excess - 1e-12 * scale


@settings(max_examples=100, deadline=None)
@given(groups_strategy)
def test_no_time_to_rise_leaves_damping_alone(groups: DimensionlessGroups) -> None:
    """Issue 2: where F_s,ss <= 0, Eq. (40), the margin is 2πρ ξ˙_d²."""
    if steady_stribeck(groups) <= 0:
        assert energy_margin(groups) == pytest.approx(2.0 * math.pi * groups.damping_ratio * groups.velocity**2)
        assert critical_damping_ratio(groups) == 0.0


def test_rising_from_coulomb_is_an_explicit_choice() -> None:
    """Issue 2: without lag h is 0; Fig. 12's assumption h = 1 is asked for by name."""
    groups = DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=0.1, stribeck=2.0, velocity=1.0, lag=0.0, rise_time=1.0
    )
    assert steady_stribeck(groups) == 2.0
    assert steady_stribeck(groups, rises_from_coulomb=True) == 1.5


@settings(max_examples=100, deadline=None)
@given(st.floats(1e-3, 0.3), st.floats(1e-3, 0.3))
def test_short_lag_approximation(velocity: float, lag: float) -> None:
    """Issue 2: Eq. (34) is the limit of (32)."""
    exact = reduction_factor(velocity, lag)
    assert approximate_reduction_factor(velocity, lag) == pytest.approx(exact, rel=0.05)
    assert approximate_reduction_factor(1e9, 1.0) == 1.0


def test_stiffness_velocity_product_is_continuous_and_sufficient() -> None:
    """Issue 2: Eq. (41) joins its two cases, and (39) is zero there with h of (34)."""
    for lag in (0.02, 0.05, 0.2, 1.0):
        friction = Friction(stribeck=1.6, stribeck_velocity=0.0058, lag=lag, rise_time=0.264)
        joint = Joint(inertia=6.3, friction=friction)
        product = float(stiffness_velocity_product(joint))
        factor = min((product * lag**2 / (2 * 6.3 * 0.0058)) ** 2, 1.0)
        assert 1.6 - 0.5 * factor * product * 0.264 == pytest.approx(0.0, abs=1e-12)
    lag = math.sqrt(6.3 * 0.0058 * 0.264 / 1.6)
    below, above = (
        stiffness_velocity_product(
            Joint(inertia=6.3, friction=Friction(stribeck=1.6, stribeck_velocity=0.0058, lag=lag * f, rise_time=0.264))
        )
        for f in (1 - 1e-9, 1 + 1e-9)
    )
    assert below == pytest.approx(above, rel=1e-7)
