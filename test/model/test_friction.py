# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction law and its parameters' ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.dimensionless import damping_for_ratio, dimensionless_energy, dimensionless_groups
from stickslip_ros.model.friction import Friction, Gains, Joint, static_friction_level, steady_friction, stribeck_shape

POSITIVE = st.floats(1e-3, 1e3)


@pytest.mark.parametrize("name", ["stribeck", "stribeck_velocity", "lag", "rise_time", "viscous", "coulomb"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_bad_parameters_are_named(name: str, value: float) -> None:
    """Issue 2: parameters out of range are refused with the name and the value."""
    with pytest.raises(InvalidParameterError, match=f"'{name}' must be finite and .*: {value}"):
        Friction(**{"stribeck": 1.0, "stribeck_velocity": 0.01, name: value})


@pytest.mark.parametrize("inertia", [0.0, -1.0, math.nan])
def test_inertia_must_be_positive(inertia: float) -> None:
    """Issue 2: inertia out of range is refused."""
    with pytest.raises(InvalidParameterError, match="'inertia' must be finite and > 0"):
        Joint(inertia=inertia, friction=Friction(stribeck=1.0, stribeck_velocity=0.01))


def test_stribeck_shape_falls_from_one_to_half_to_zero() -> None:
    """Issue 2: Ψ of Eq. (5) is 1 at rest, ½ at the Stribeck velocity, and even."""
    assert stribeck_shape(0.0, 0.1) == 1.0
    assert stribeck_shape(0.1, 0.1) == 0.5
    assert stribeck_shape(-0.3, 0.1) == stribeck_shape(0.3, 0.1) == pytest.approx(0.1)


@given(POSITIVE, st.floats(0.0, 1e3), POSITIVE, POSITIVE)
def test_static_friction_rises_to_its_level(level: float, start_share: float, rise_time: float, dwell: float) -> None:
    """Issue 2: Eq. (6) starts at F_s,a, is half way after γ, and never overshoots."""
    start = level * min(start_share, 1.0)
    friction = Friction(stribeck=level, stribeck_velocity=1.0, rise_time=rise_time)
    assert static_friction_level(friction, start, 0.0) == start
    assert static_friction_level(friction, start, rise_time) == pytest.approx(0.5 * (start + level))
    risen = float(static_friction_level(friction, start, dwell))
    assert start <= risen * (1 + 1e-12)
    assert risen <= level * (1 + 1e-12)


def test_without_rise_time_static_friction_is_there_at_once() -> None:
    """Issue 2: γ → 0 of Eq. (6)."""
    friction = Friction(stribeck=2.0, stribeck_velocity=1.0)
    assert static_friction_level(friction, 0.5, 0.0) == 2.0


@given(POSITIVE)
def test_steady_friction_is_odd(velocity: float) -> None:
    """Issue 2: friction opposes motion in both directions alike."""
    friction = Friction(stribeck=1.0, stribeck_velocity=0.1, viscous=2.0, coulomb=3.0)
    assert steady_friction(friction, velocity) == -steady_friction(friction, -velocity)


@given(POSITIVE, POSITIVE, st.floats(0.0, 1.0), POSITIVE)
def test_damping_ratio_and_damping_invert_each_other(
    inertia: float, stiffness: float, viscous: float, damping: float
) -> None:
    """Issue 2: the groups of Eqs (9)-(16) and back."""
    joint = Joint(inertia=inertia, friction=Friction(stribeck=1.0, stribeck_velocity=0.1, viscous=viscous))
    groups = dimensionless_groups(joint, Gains(stiffness=stiffness, damping=damping), -0.2)
    assert damping_for_ratio(joint, stiffness, groups.damping_ratio) == pytest.approx(damping, rel=1e-9, abs=1e-9)
    assert groups.velocity == pytest.approx(2.0)
    assert groups.natural_frequency == pytest.approx(math.sqrt(stiffness / inertia))


def test_energy_of_the_circle() -> None:
    """Issue 2: Eq. (18) is constant on a circle."""
    angle = np.linspace(0.0, 6.0, 20)
    np.testing.assert_allclose(dimensionless_energy(3 * np.cos(angle), 3 * np.sin(angle)), 4.5)
