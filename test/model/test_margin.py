# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The verdict of Eq. (43): the paper's boundary, reasons, and what would change it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.margin import change_factors, least_smooth_stiffness, lowest_smooth_velocity, stability_margin

ROWS = [(0.1, 947.92), (0.2, 1030.92), (0.5, 1106.14), (0.85, 871.97), (1.0, 745.58), (2.0, 359.47), (5.0, 130.19)]


@pytest.mark.parametrize(("velocity", "boundary"), ROWS)
def test_stiffness_boundary_of_the_paper_joint(puma: Joint, velocity: float, boundary: float) -> None:
    """Issue 2: the rows of physics.md, to all printed digits, scalar by scalar."""
    assert least_smooth_stiffness(puma, velocity * 0.0058) / 6.3 == pytest.approx(boundary, abs=0.0051)


def test_stiffness_boundary_as_an_array(puma: Joint) -> None:
    """Issue 2: the same rows in one call."""
    velocities, boundaries = np.array(ROWS).T
    np.testing.assert_allclose(least_smooth_stiffness(puma, velocities * 0.0058) / 6.3, boundaries, rtol=0, atol=0.0051)


@pytest.mark.parametrize(("velocity", "boundary"), ROWS[3:])
def test_lowest_smooth_velocity_inverts_the_boundary(puma: Joint, velocity: float, boundary: float) -> None:
    """Issue 2: at a boundary stiffness (beyond its maximum) the lowest smooth velocity is the row's."""
    stiffness = float(least_smooth_stiffness(puma, velocity * 0.0058))
    assert lowest_smooth_velocity(puma, Gains(stiffness=stiffness)) == pytest.approx(velocity * 0.0058, rel=1e-9)


@pytest.mark.parametrize(
    ("gains", "velocity", "reason"),
    [
        (Gains(stiffness=0.0), 0.01, "stiffness is not positive"),
        (Gains(stiffness=-5.0), 0.01, "stiffness is not positive"),
        (Gains(stiffness=100.0), 0.0, "velocity is zero"),
        (Gains(stiffness=100.0, integral=1.0), 0.01, "integral action"),
        # τ* = 2π at M (2π/τ_L)² = 99,480 N·m/rad; at 1.02 of it the lag is the longer.
        (Gains(stiffness=1.02 * 6.3 * (2.0 * math.pi / 0.05) ** 2), 0.01, "longer than one natural period"),
        (Gains(stiffness=math.nan), 0.01, "not a finite number"),
        (Gains(stiffness=100.0), math.inf, "not a finite number"),
        (Gains(stiffness=100.0, damping=-50.0), 0.01, "total damping is negative"),
    ],
)
def test_outside_the_domain_the_reason_is_given(puma: Joint, gains: Gains, velocity: float, reason: str) -> None:
    """Issue 2: domain violations are answered "not applicable, because …", never by a number."""
    margin = stability_margin(puma, gains, velocity)
    assert margin.applicable is False
    assert margin.reason is not None
    assert margin.reason.startswith("not applicable, because ")
    assert reason in margin.reason
    assert margin.smooth is False
    for name in ("energy_margin", "damping_ratio", "critical_damping_ratio", "reduction_factor", "steady_stribeck"):
        assert math.isnan(getattr(margin, name))


def test_up_to_a_lag_of_one_natural_period_the_margin_applies(puma: Joint) -> None:
    """The other side of that boundary."""
    stiffness = 0.98 * float(puma.inertia) * (2.0 * math.pi / float(puma.friction.lag)) ** 2
    assert stability_margin(puma, Gains(stiffness=stiffness), 0.01).applicable is True


def test_arrays_mix_applicable_and_not(puma: Joint) -> None:
    """Issue 2: in arrays every element gets its own verdict or reason."""
    margin = stability_margin(puma, Gains(stiffness=np.array([2016.0, 0.0, 8000.0])), 0.00493)
    assert margin.applicable.tolist() == [True, False, True]
    assert margin.smooth.tolist() == [False, False, True]
    assert margin.reason[0] is None
    assert "stiffness" in margin.reason[1]
    assert margin.energy_margin[0] == stability_margin(puma, Gains(stiffness=2016.0), 0.00493).energy_margin


@given(
    st.floats(0.01, 50.0), st.floats(2.0, 60.0), st.floats(0.0, 0.5), st.floats(0.1, 20.0), st.floats(1e-4, 0.1),
    st.floats(0.3, 5.0), st.floats(0.0, 0.1), st.floats(0.0, 2.0), st.sampled_from([-1.0, 1.0]),
)  # fmt: skip
def test_factors_lead_to_the_boundary(
    inertia: float, frequency: float, ratio: float, level: float, stribeck_velocity: float,
    speed: float, lag: float, rise_time: float, sign: float,
) -> None:  # fmt: skip
    """Issue 2: each factor alone brings the margin to zero; direction does not matter."""
    momentum = inertia * frequency
    friction = Friction(
        stribeck=level * momentum * stribeck_velocity, stribeck_velocity=stribeck_velocity, lag=lag, rise_time=rise_time
    )
    joint = Joint(inertia=inertia, friction=friction)
    gains = Gains(stiffness=inertia * frequency**2, damping=2 * ratio * momentum)
    velocity = sign * speed * stribeck_velocity
    margin = stability_margin(joint, gains, velocity)
    assert margin.energy_margin == stability_margin(joint, gains, -velocity).energy_margin
    factors = change_factors(joint, gains, velocity)

    def at(stiffness: float = 1.0, damping: float = 1.0, speed: float = 1.0) -> float:
        changed = Gains(stiffness=gains.stiffness * stiffness, damping=gains.damping * damping)
        return float(stability_margin(joint, changed, velocity * speed).energy_margin)

    if math.isfinite(factors["damping"]) and factors["damping"] > 0 and margin.critical_damping_ratio > 0:
        assert at(damping=factors["damping"]) == pytest.approx(0.0, abs=1e-8 * (1 + abs(margin.energy_margin)))
    for name, key in (("stiffness", "stiffness"), ("velocity", "speed")):
        factor = float(factors[name])
        if 0 < factor < math.inf:
            assert at(**{key: factor * 1.001}) >= 0 or at(**{key: factor * (1 + 1e-9)}) > 0
            assert at(**{key: factor * (1 - 1e-6)}) <= 0


def test_direction_changes_no_factor(puma: Joint) -> None:
    """The sign of the commanded velocity does not matter to what would bring a joint to the boundary."""
    gains = Gains(stiffness=630.0, damping=20.0)
    forward, backward = (change_factors(puma, gains, velocity) for velocity in (0.005, -0.005))
    assert forward["velocity"] > 0
    assert backward == forward


def test_damping_reserve(puma: Joint) -> None:
    """Issue 8: 0 on the boundary, −1 without damping, ∞ where none is needed, NaN where the equation does not apply."""
    speeds = np.array([0.005, 0.005, 0.5, 0.0])
    plain = stability_margin(puma, Gains(stiffness=630.0), 0.005)
    needed = plain.critical_damping_ratio * 2 * np.sqrt(630.0 * puma.inertia) - puma.friction.viscous
    dampings = np.array([needed, -puma.friction.viscous, 0.0, 0.0])
    found = stability_margin(puma, Gains(stiffness=np.array([630.0, 630.0, 6300.0, 630.0]), damping=dampings), speeds)
    assert found.damping_reserve == pytest.approx([0.0, -1.0, np.inf, np.nan], abs=1e-12, nan_ok=True)
    assert isinstance(plain.damping_reserve, float)
