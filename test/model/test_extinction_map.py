# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The map of a joint over speed and stiffness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.extinction_map import extinction_map, map_axes
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.margin import stability_margin


def test_map_holds_both_boundaries(puma: Joint) -> None:
    """Issue 3: each point is the total damping at which stick-slip ends, by Eq. (43) and by integration."""
    velocity, stiffness = map_axes(puma, points=120)
    computed = extinction_map(puma, velocity, stiffness, workers=2)
    assert computed.paper_damping.shape == computed.exact_damping.shape == (len(stiffness), len(velocity))
    row, column = 5, 6
    gains = Gains(stiffness=stiffness[row])
    unit = 2.0 * math.sqrt(stiffness[row] * 6.3)
    groups = dimensionless_groups(puma, gains, velocity[column])
    assert computed.exact_damping[row, column] == pytest.approx(
        unit * float(exact_critical_damping_ratio(groups)), rel=0.01
    )
    margin = stability_margin(puma, gains, velocity[column])
    assert computed.paper_damping[row, column] == pytest.approx(unit * float(margin.critical_damping_ratio), rel=1e-9)


def test_eq_43_is_mostly_conservative(puma: Joint) -> None:
    """Issue 3: at nine in ten points of Fig. 13's plane the damping that (43) asks for is enough."""
    velocity, stiffness = 0.0058 * np.linspace(0.05, 3.0, 24), 6.3 * np.linspace(15.0, 1200.0, 20)
    assert 0.9 < extinction_map(puma, velocity, stiffness).conservative < 1.0


def test_axes_hold_the_operating_point(puma: Joint) -> None:
    """Issue 3: the map is never drawn without the present operating point, and of about as many points as asked for."""
    for velocity, stiffness in ((1e-6, 1e-3), (1.0, 1e7), (-0.005, 2016.0)):
        speeds, stiffnesses = map_axes(puma, velocity=velocity, stiffnesses=[stiffness], points=2000)
        assert speeds[0] < abs(velocity) < speeds[-1]
        assert stiffnesses[0] < stiffness < stiffnesses[-1]
        assert len(speeds) * len(stiffnesses) == pytest.approx(2000, rel=0.05)
    without_lag = Joint(inertia=0.01, friction=Friction(stribeck=0.0, stribeck_velocity=1.0))
    speeds, stiffnesses = map_axes(without_lag)
    assert (np.diff(speeds) > 0).all()
    assert (np.diff(stiffnesses) > 0).all()


def test_bad_axes_are_refused(puma: Joint) -> None:
    """Issue 3: a speed of zero has no place on the map."""
    with pytest.raises(InvalidParameterError, match="'velocity'"):
        extinction_map(puma, np.array([0.0, 0.01]), np.array([100.0]))
