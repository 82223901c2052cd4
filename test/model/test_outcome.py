# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What becomes of a joint from every start, against brute force; `python test/model/random_points.py` asks 1000."""

from __future__ import annotations

import time

import brute_force
import numpy as np
import pytest
from brute_force import FROM_REST
from conftest import nightly
from random_points import at, groups_of, judge, random_joints
from test_brute_force import ISSUE

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.outcome import Outcome, outcomes, steady_damping_ratio
from stickslip_ros.model.steady_sliding import sliding_damping_ratio
from stickslip_ros.model.verdict import verdict

LEAST = 0.01  # damping ratios below this are none
JOINTS, JOINTS_JUDGED = 60, 40


@pytest.mark.parametrize("point", ISSUE)
def test_the_joints_of_the_issue_stick(point: np.ndarray) -> None:
    """Issue 19, item 1: with a long lag dips come and go, and the joint stops again some swings later."""
    found = outcomes(_groups(point))
    assert found.worst is Outcome.STICKS
    assert not found.depends_on_start


def _groups(point: np.ndarray) -> DimensionlessGroups:
    ratio, stribeck, velocity, lag, rise_time = map(float, point)
    return DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=ratio, stribeck=stribeck, velocity=velocity, lag=lag, rise_time=rise_time
    )


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.94, 1.06])
@pytest.mark.parametrize("boundary", [nightly("critical"), "steady"])
def test_random_joints_at_their_boundaries(boundary: str, share: float) -> None:
    """Issue 19, what shows it: what is called steady is, what is called smooth does not stick, by brute force."""
    points = random_joints(JOINTS_JUDGED, seed=19).points(0.1)
    groups = groups_of(points)
    ratios = np.asarray(
        exact_critical_damping_ratio(groups) if boundary == "critical" else steady_damping_ratio(groups)
    )
    near = np.isfinite(ratios) & (ratios > LEAST)
    judged = judge(at(points, np.where(near, share * ratios, 0.1))[near])
    assert len(judged.said) > 12
    errors = judged.errors()
    for kind in ("steady, is not", "smooth, sticks", "no answer"):
        assert not errors[kind].any(), kind
    assert errors["sticks, does not"].mean() < 0.1
    if boundary == "steady":
        steady = outcomes(groups_of(judged.points)).steady
        assert steady.mean() > 0.9 if share > 1 else steady.mean() < 0.2


def test_boundaries_are_in_order() -> None:
    """A joint that is steady from every start does not stick, and small disturbances of it decay."""
    points = random_joints(12, seed=3).points(0.1)
    groups = groups_of(points)
    steady = np.asarray(steady_damping_ratio(groups))
    known = steady > 0
    assert np.count_nonzero(known) > 6
    assert np.all(steady[known] > 0.95 * np.asarray(exact_critical_damping_ratio(groups))[known])
    # A swing of less than 10 % of the speed is steady, though small disturbances grow to it.
    assert np.all(steady[known] > 0.9 * np.asarray(sliding_damping_ratio(groups))[known])


def test_the_outcome_depends_on_the_start() -> None:
    """Issue 19, item 3: a large swing and steady sliding are both possible, and then the worse counts."""
    groups = DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=0.609, stribeck=4.877, velocity=1.647, lag=0.256, rise_time=2.6
    )
    point = [float(getattr(groups, name)) for name in brute_force.POINT]
    assert [brute_force.OUTCOMES[brute_force.outcomes(point, factor)[0]] for factor in (FROM_REST, 1.15)] == [
        "swings",
        "steady",
    ]
    found = outcomes(groups)
    assert found.disturbances_decay
    assert found.depends_on_start
    assert found.worst is Outcome.SWINGS


def test_the_papers_joint_swings_where_it_is_said_to_be_cured(puma: Joint) -> None:
    """Issue 19, item 2: just beyond the critical damping the joint does not stop, and does not move steadily either."""
    velocity, stiffness = 0.00493, 2241.0
    verdicts = {
        damping: verdict(puma, Gains(stiffness=stiffness, damping=damping), velocity) for damping in (15.0, 30.0, 140.0)
    }
    assert [one.outcome for one in verdicts.values()] == [Outcome.STICKS, Outcome.SWINGS, Outcome.STEADY]
    assert [one.smooth for one in verdicts.values()] == [False, True, True]
    groups = dimensionless_groups(puma, Gains(stiffness=stiffness, damping=140.0), velocity)
    assert 0 < verdicts[140.0].steady_damping_ratio < float(groups.damping_ratio)


def test_a_sampled_controller_has_an_outcome_too(puma: Joint) -> None:
    """A joint that slides under sampled control is followed until it settles, or goes on swinging."""
    conditions = OperatingConditions(controller_period=0.005)
    found = [
        verdict(puma, Gains(stiffness=2241.0, damping=damping), 0.00493, conditions).outcome
        for damping in (5.0, 35.0, 150.0)
    ]
    assert found == [Outcome.STICKS, Outcome.SWINGS, Outcome.STEADY]


def test_what_cannot_be_decided_is_not_called_smooth() -> None:
    """A point beyond what is integrated has no outcome."""
    groups = DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=0.1, stribeck=1e5, velocity=1.0, lag=0.1, rise_time=1.0
    )
    assert outcomes(groups).worst is None
    assert not outcomes(groups).steady
    assert np.isnan(steady_damping_ratio(groups))


def test_it_takes_a_bounded_time() -> None:
    """The slowest of sixty random joints takes less than a second, whatever its lag."""
    for point in random_joints(JOINTS, seed=5).points(0.05):
        begin = time.process_time()
        outcomes(_groups(point))
        assert time.process_time() - begin < 1.0, point
