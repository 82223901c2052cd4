# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact boundary, by integration."""

from __future__ import annotations

import math
import time

import pytest
from conftest import EXACT_CRITICAL_DAMPING

from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio, exact_verdict
from stickslip_ros.model.friction import Friction, Gains, Joint


@pytest.mark.parametrize(("stiffness", "velocity", "critical"), EXACT_CRITICAL_DAMPING)
def test_table_of_the_exact_boundary(puma: Joint, stiffness: float, velocity: float, critical: float) -> None:
    """Issue 2, item 8 (`exact`): physics.md, section 4, within 0.5 %."""
    gains = Gains(stiffness=stiffness * 6.3)
    assert exact_critical_damping_ratio(puma, gains, velocity * 0.0058) == pytest.approx(critical, rel=0.005)


def test_direction_and_units_make_no_difference(puma: Joint) -> None:
    """Issue 2, item 8 (`exact`): the verdict depends on the dimensionless numbers alone."""
    gains = Gains(stiffness=2016.0, damping=20.0)
    critical = exact_verdict(puma, gains, 0.00493).critical_damping_ratio
    assert exact_verdict(puma, gains, -0.00493).critical_damping_ratio == critical
    slow = Joint(
        inertia=6.3e-3,
        friction=Friction(stribeck=1.6e-6, stribeck_velocity=0.0058e-2, lag=0.5, rise_time=2.64, viscous=4.94e-4),
    )
    scaled = exact_verdict(slow, Gains(stiffness=2016.0e-5, damping=20.0e-4), 0.00493e-2).critical_damping_ratio
    assert scaled == pytest.approx(critical, rel=2e-3)


def test_without_excess_friction_nothing_persists() -> None:
    """Issue 2, item 8 (`exact`): Coulomb friction alone gives no stick slip once there is any damping."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1e-9, stribeck_velocity=0.01, viscous=0.5))
    assert not cycle_persists(joint, Gains(stiffness=100.0), 0.02)


@pytest.mark.parametrize(
    ("gains", "velocity"),
    [
        (Gains(stiffness=0.0), 0.01),
        (Gains(stiffness=100.0), 0.0),
        (Gains(stiffness=100.0, integral=1.0), 0.01),
        (Gains(stiffness=math.nan), 0.01),
        (Gains(stiffness=5e-324), 0.01),
        (Gains(stiffness=100.0, damping=1e9), 0.01),
    ],
)
def test_meaningless_questions_have_no_answer(puma: Joint, gains: Gains, velocity: float) -> None:
    """Issue 2, item 8 (`exact`): no number where the question has no meaning."""
    verdict = exact_verdict(puma, gains, velocity)
    assert verdict.smooth is None
    assert math.isnan(verdict.critical_damping_ratio)


@pytest.mark.parametrize("stiffness", [1e-6, 1e-3, 1e6, 1e9])
@pytest.mark.parametrize("velocity", [1e-9, 1e-3, 10.0])
def test_extreme_joints_are_answered_in_time(puma: Joint, stiffness: float, velocity: float) -> None:
    """Issue 2, item 8 (`exact`): no gain or speed makes the integration run away."""
    begin = time.perf_counter()
    exact_verdict(puma, Gains(stiffness=stiffness), velocity)
    assert time.perf_counter() - begin < 30.0
