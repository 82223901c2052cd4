# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact boundary, by integration: the table, the rule for "persists", many points in a call."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import EXACT_CRITICAL_DAMPING

from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.exact import (
    cycle_persists,
    exact_critical_damping_ratio,
    exact_least_smooth_stiffness,
    exact_lowest_smooth_velocity,
)
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.margin import lowest_smooth_velocity
from stickslip_ros.model.simulation import simulate_cycles


def random_groups(count: int, seed: int, *, most_lag: float = 2.0) -> DimensionlessGroups:
    """Joints on every side of the boundary."""
    generator = np.random.default_rng(seed)
    return DimensionlessGroups(
        natural_frequency=np.nan,
        damping_ratio=np.zeros(count),
        stribeck=10 ** generator.uniform(-0.5, 1.3, count),
        velocity=10 ** generator.uniform(-1.0, 0.7, count),
        lag=most_lag * generator.uniform(0.0, 1.0, count),
        rise_time=10 ** generator.uniform(-0.5, 1.3, count),
    )


def with_ratio(groups: DimensionlessGroups, damping_ratio: object) -> DimensionlessGroups:
    """The same joints with another damping."""
    return DimensionlessGroups(**{**vars(groups), "damping_ratio": damping_ratio})


@pytest.mark.parametrize(("stiffness", "velocity", "critical"), EXACT_CRITICAL_DAMPING)
def test_table_of_the_exact_boundary(puma: Joint, stiffness: float, velocity: float, critical: float) -> None:
    """Issue 3 (and 2, item 8): physics.md, section 4, within 0.5 %."""
    groups = dimensionless_groups(puma, Gains(stiffness=stiffness * 6.3), velocity * 0.0058)
    assert exact_critical_damping_ratio(groups) == pytest.approx(critical, rel=0.005)


@pytest.mark.slow
def test_looking_ahead_agrees_with_plain_cycles() -> None:
    """Issue 3: the geometric rule gives what 1,500 plain cycles give, a per cent off the boundary and further."""
    groups = random_groups(120, seed=4)
    critical = np.asarray(exact_critical_damping_ratio(groups, tolerance=1e-3))
    inside = (critical > 1e-3) & np.isfinite(critical)
    assert inside.sum() > 80
    for factor in (0.6, 0.99, 1.01, 1.4):
        tried = with_ratio(groups, np.where(inside, factor * critical, 0.1))
        verdict = np.asarray(cycle_persists(tried))[inside]
        plain = np.isfinite(simulate_cycles(tried, 1500).slip_duration[:, -1])[inside]
        # What decays over more than a thousand cycles is not told by counting either.
        assert (verdict == plain).mean() > 0.99, factor
        assert verdict.mean() == pytest.approx(float(factor < 1), abs=0.01)


def test_a_cycle_that_takes_long_to_die_out() -> None:
    """A cycle that dies out only after hundreds of slips does not persist; without full accuracy it counts as if."""
    groups = DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=0.165, stribeck=9.33, velocity=1.806, lag=5.635, rise_time=7.5
    )
    slips = int(np.isfinite(simulate_cycles(groups, 1000).slip_duration).sum())
    assert 200 < slips < 500
    assert cycle_persists(groups) == 0.0
    assert cycle_persists(groups, full_accuracy=False) == 1.0


def test_many_points_and_threads_are_as_one() -> None:
    """Issue 3: thousands of points in one call, shared by threads, are what each is alone; progress is told."""
    groups = random_groups(200, seed=5)
    told: list[tuple[int, int]] = []
    together = np.asarray(
        exact_critical_damping_ratio(groups, workers=2, progress=lambda done, total: told.append((done, total)))
    )
    assert told[-1] == (200, 200)
    for index in (0, 77, 199):
        one = DimensionlessGroups(
            **{name: np.ravel(value)[index % np.size(value)] for name, value in vars(groups).items()}
        )
        assert exact_critical_damping_ratio(one) == together[index]
    grid = DimensionlessGroups(
        **{name: np.reshape(value, (20, 10)) if np.size(value) > 1 else value for name, value in vars(groups).items()}
    )
    np.testing.assert_array_equal(exact_critical_damping_ratio(grid), together.reshape(20, 10))


def test_tolerance_is_kept() -> None:
    """Issue 3: the boundary to 1 % is within 1 % of the boundary to 1e-5."""
    groups = random_groups(60, seed=6)
    coarse = np.asarray(exact_critical_damping_ratio(groups, tolerance=0.01))
    fine = np.asarray(exact_critical_damping_ratio(groups, tolerance=1e-5))
    np.testing.assert_allclose(coarse, fine, rtol=0.01, atol=1e-5)


def test_direction_and_units_make_no_difference(puma: Joint) -> None:
    """Issue 3: the verdict depends on the dimensionless numbers alone."""
    slow = Joint(
        inertia=6.3e-3,
        friction=Friction(stribeck=1.6e-6, stribeck_velocity=0.0058e-2, lag=0.5, rise_time=2.64, viscous=4.94e-4),
    )
    ratios = [
        exact_critical_damping_ratio(dimensionless_groups(joint, Gains(stiffness=stiffness), velocity))
        for joint, stiffness, velocity in (
            (puma, 2016.0, 0.00493), (puma, 2016.0, -0.00493), (slow, 2016.0e-5, 0.00493e-2)
        )
    ]  # fmt: skip
    assert ratios == pytest.approx([ratios[0]] * 3, rel=1e-3)


def test_without_excess_friction_nothing_persists() -> None:
    """Issue 3: Coulomb friction alone gives no stick-slip once there is any damping."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1e-9, stribeck_velocity=0.01, viscous=0.5))
    assert cycle_persists(dimensionless_groups(joint, Gains(stiffness=100.0), 0.02)) == 0.0


def test_lowest_smooth_velocity_is_a_boundary(puma: Joint) -> None:
    """Issue 3: just below it the cycle persists, at it and at every speed tried above it dies; below the paper's."""
    gains = Gains(stiffness=2016.0)
    lowest = exact_lowest_smooth_velocity(puma, gains)
    assert lowest < float(lowest_smooth_velocity(puma, gains))
    assert cycle_persists(dimensionless_groups(puma, gains, 0.998 * lowest)) == 1.0
    assert not np.any(cycle_persists(dimensionless_groups(puma, gains, lowest * np.geomspace(1.0, 1000.0, 50))))


def test_least_smooth_stiffness_is_a_boundary(puma: Joint) -> None:
    """Issue 3: just below it the cycle persists, just above it dies, at the damping asked for."""
    stiffness = exact_least_smooth_stiffness(puma, 0.00493, damping=40.0)
    for factor, expected in ((0.998, 1.0), (1.002, 0.0)):
        gains = Gains(stiffness=factor * stiffness, damping=40.0)
        assert cycle_persists(dimensionless_groups(puma, gains, 0.00493)) == expected


def test_limits_of_the_boundaries(puma: Joint) -> None:
    """Issue 3: 0 where everything is smooth, infinite where nothing is."""
    slippery = Joint(inertia=6.3, friction=Friction(stribeck=1e-6, stribeck_velocity=0.0058, viscous=50.0))
    assert exact_lowest_smooth_velocity(slippery, Gains(stiffness=630.0)) == 0.0
    assert exact_least_smooth_stiffness(slippery, 0.005) == 0.0
    undamped = Joint(inertia=6.3, friction=Friction(stribeck=1.6, stribeck_velocity=0.0058))
    assert exact_least_smooth_stiffness(undamped, 0.0058) == math.inf
    assert exact_critical_damping_ratio(random_groups(1, seed=7)) != 0.0


def test_a_lag_too_long_to_keep_has_no_answer() -> None:
    """Issue 18: lags of thousands of radians, as open estimates have them, ended the process."""
    groups = DimensionlessGroups(
        natural_frequency=75.6, damping_ratio=3.06, stribeck=33.3, velocity=0.064, lag=1400.0, rise_time=6074.0
    )
    assert np.isnan(cycle_persists(groups))
    assert np.isnan(exact_critical_damping_ratio(groups))
    assert np.isnan(simulate_cycles(groups, 2).slip_duration).all()


def test_what_is_too_sharp_has_no_answer() -> None:
    """Issue 3: a point whose integration would not end in time is answered NaN, at once."""
    groups = with_ratio(random_groups(3, seed=8), [0.1, 1e6, 0.1])
    answers = np.asarray(cycle_persists(DimensionlessGroups(**{**vars(groups), "stribeck": np.array([1e7, 1.0, 1.0])})))
    assert np.isnan(answers).tolist() == [True, True, False]


@pytest.mark.parametrize("lag", [5e-324, 4.8e-312, 1e-300, 1e-30])
def test_a_lag_too_short_to_count_is_none(lag: float) -> None:
    """Issue 15: a lag near the smallest number there is had the integration go on without end."""
    point = {"natural_frequency": np.nan, "damping_ratio": 0.42, "stribeck": 1.3, "velocity": 1.67, "rise_time": 20.7}
    assert cycle_persists(DimensionlessGroups(**point, lag=lag)) == cycle_persists(
        DimensionlessGroups(**point, lag=0.0)
    )
