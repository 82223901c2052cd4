# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A monitor of a joint that is configured with another friction law than the paper's, which nobody learns."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support import record

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.limits import Criterion
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.slip_windows import slip_window
from stickslip_ros.monitoring.identification import identify
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.nodes.kept_state import from_plain, to_plain

GAINS = Gains(stiffness=2016.0, damping=5.0)


@pytest.fixture
def exponential(puma: Joint) -> Joint:
    """The paper's joint as if its friction fell exponentially."""
    return replace(puma, friction=replace(puma.friction, law="exponential"))


def test_nothing_is_learnt_and_the_configuration_counts(exponential: Joint) -> None:
    """Margin, advice and what they rest on are of the configured law, and say so."""
    monitor = JointMonitor(exponential, GAINS)
    monitor.process(record(exponential, GAINS, 0.00493, duration=12.0).batch)
    monitor.finish()
    monitor.learn()
    state = monitor.assessment()
    assert state.cycles > 10
    assert state.estimate is None
    assert state.joint == exponential
    assert state.rests_on == "the configured friction; friction of the law exponential is not estimated"
    assert state.margin is not None
    assert not state.margin.applicable
    assert state.margin_reason.startswith("not applicable, because it is of the paper's friction law")
    assert state.recommendation is not None
    assert state.recommendation.condition is Criterion.EXACT
    assert state.recommended is not None
    assert state.recommended.exactly_smooth


def test_what_was_learnt_before_does_not_count(puma: Joint, exponential: Joint) -> None:
    """A joint configured with another law while the monitor runs is believed at once."""
    monitor = JointMonitor(puma, GAINS)
    monitor.process(record(puma, GAINS, 0.00493, duration=12.0).batch)
    monitor.finish()
    monitor.learn()
    assert monitor.assessment().estimate is not None
    assert monitor.assessment().joint != puma
    monitor.joint = exponential
    assert monitor.assessment().joint == exponential


def test_a_prior_of_another_law_is_refused(puma: Joint, exponential: Joint) -> None:
    """Its values would be taken for those of the law that is fitted."""
    motion = record(puma, GAINS, 0.00493, duration=12.0)
    with pytest.raises(InvalidParameterError, match="a joint of the law that is fitted, hess_soom: exponential"):
        identify(motion.batch, GAINS, exponential)
    monitor = JointMonitor(None, GAINS, studies_at_once=False)
    cycles = monitor.process(motion.batch)
    windows = [slip_window(motion.batch, cycle, GAINS, resolution=2.5e-5, noise=0.0) for cycle in cycles]
    with pytest.raises(InvalidParameterError, match="a joint of the law that is fitted, hess_soom: exponential"):
        estimate_friction([window for window in windows if window is not None], exponential)


def test_state_files_keep_the_law(puma: Joint, exponential: Joint) -> None:
    """Those written before there were laws are of the paper's."""
    assert from_plain(Joint, to_plain(exponential)) == exponential
    earlier = to_plain(puma)
    del earlier["friction"]["law"]
    assert from_plain(Joint, earlier) == puma
