# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Which slips are kept for studies: what tells most, not what is latest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from random_joints import cut_slips, later
from support import record

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.friction.kept_slips import MOST_SLIPS, KeptSlips
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.settings.known_joints import load_joint

GAINS = Gains(stiffness=630.0)
SPEED = 0.0058


@pytest.fixture(scope="module")
def slips() -> list[SlipWindow]:
    """Some slips from a start at rest: the first follows a rest much longer than the others."""
    return cut_slips(record(load_joint("puma560_joint1").joint, GAINS, SPEED, duration=30.0).batch, GAINS)[0]


def an_hour_of(slips: list[SlipWindow]) -> list[SlipWindow]:
    """The slips, then the settled ones of them again and again."""
    settled = slips[5:15]
    span = slips[15].breakaway - settled[0].breakaway
    return slips + [later(window, 60.0 + span * turn) for turn in range(60) for window in settled]


def test_the_only_slip_after_a_long_rest_is_kept(slips: list[SlipWindow]) -> None:
    """Issue 18, found wrong 1: the look-back forgot the one breakaway that told the most."""
    kept = KeptSlips(an_hour_of(slips))
    assert MOST_SLIPS - 8 <= len(kept) <= MOST_SLIPS
    assert kept.windows[0] is slips[0]


def test_order_and_the_latest(slips: list[SlipWindow]) -> None:
    """Kept slips stand in order of time, and the latest is among them."""
    hour = an_hour_of(slips)
    kept = KeptSlips(hour).windows
    times = [window.breakaway for window in kept]
    assert times == sorted(times)
    assert kept[-1] is hour[-1]


@pytest.mark.parametrize("how", ["direction", "gains", "place", "speed"])
def test_what_is_seldom_is_kept(slips: list[SlipWindow], how: str) -> None:
    """A few slips of the other direction, with other gains, elsewhere or of another speed outlast hundreds alike."""
    window = slips[6]
    spread = {
        "direction": replace(window, direction=-window.direction),
        "gains": replace(window, gains=Gains(stiffness=2000.0)),
        "place": replace(window, rest_position=window.rest_position + 3.0),
        "speed": replace(window, rest_begin=window.breakaway - 4.0 * (window.breakaway - window.rest_begin)),
    }
    # After the first ones, and before an hour of others.
    seldom = later(spread[how], 30.0)
    assert any(one is seldom for one in KeptSlips([*slips, seldom, *an_hour_of(slips)[len(slips) :]]).windows)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [20.0, nightly(40.0), 60.0, nightly(90.0)])
def test_more_of_the_same_does_no_harm(puma: Joint, seconds: float) -> None:
    """Issue 18, found wrong 1: README's own joint, right after 20 s, was 67 % off in rise time after 60 s."""
    batch = record(puma, GAINS, SPEED, duration=90.0).batch
    monitor = JointMonitor(gains=GAINS, studies_at_once=True)
    monitor.process(batch.where(batch.time <= seconds))
    monitor.finish()
    estimate = monitor.learner.estimate
    assert estimate is not None
    # Of so few slips viscous friction may be a curve as well.
    open_still = {"viscous"} if seconds < 30.0 else set()
    assert set(estimate.unidentified) <= open_still, (seconds, estimate.summary())
    assert estimate["stribeck"].value == pytest.approx(1.6, rel=0.02)
    assert estimate["rise_time"].value == pytest.approx(0.264, rel=0.1)
    assert np.isnan(estimate.load.value)
