# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Commanded stops are no sticks, with and without a reference; stick-slip of joints drawn at random is found."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from conftest import RECORDINGS, nightly
from random_motions import (
    HAND_GUIDING,
    TELEOPERATION,
    arriving,
    followed,
    measured,
    random_motion,
    random_stick_slip,
    without_reference,
)
from support import cycles_of

from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.detection.status import StampsInBursts, Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow

_MINUTE = 60.0
_KINDS = (
    "constant speed", "sine", "minimum-jerk moves, at random", "trapezoids, at random", "commanded steps, at random",
    TELEOPERATION,
)  # fmt: skip
_LEADER, _FOLLOWER = "prismax_0_arm_left_lead", "prismax_0_arm_left_follow"
_JOINTS = 7


@pytest.mark.parametrize(
    ("kind", "seed"), [*itertools.product(_KINDS, (0,)), *itertools.starmap(nightly, itertools.product(_KINDS, (1, 3)))]
)
def test_commanded_motion_is_no_stick_slip(kind: str, seed: int) -> None:
    """Issue 17: what follows its reference has no cycles, with the reference or without."""
    batch = random_motion(kind, np.random.default_rng(seed), duration=_MINUTE)
    assert cycles_of(batch) == []
    assert cycles_of(without_reference(batch)) == []


def test_long_moves_without_noise_are_no_stick_slip() -> None:
    """Issue 17: likewise where a move has more counts than are kept."""
    batch = random_motion("trapezoids, at random", np.random.default_rng(2), duration=_MINUTE)
    assert cycles_of(batch) == []


@pytest.mark.parametrize("seed", range(3))
def test_small_commanded_steps_are_no_stick_slip(seed: int) -> None:
    """Issue 17: steps of 6e-3 rad, hardly above the noise, at regular intervals."""
    time, generator = np.arange(0.0, _MINUTE, 0.01), np.random.default_rng(seed)
    references = 6e-3 * np.floor(time / 1.5)
    places = followed(time, references, frequency=4.0, damping_ratio=0.9)
    position = measured(generator, places, noise=2e-4, resolution=1.2e-4)
    assert cycles_of(Batch(time=time, position=position, reference_position=references)) == []


@pytest.mark.parametrize("seed", range(3))
def test_hand_guiding_is_no_stick_slip(seed: int) -> None:
    """Issue 17: a controller that publishes what it measures as its reference has none that would count."""
    monitor = JointMonitor()
    batch = random_motion(HAND_GUIDING, np.random.default_rng(seed), duration=_MINUTE)
    assert monitor.process(batch) + monitor.finish() == []
    assert monitor.assessment().reference_follows


def test_stick_slip_is_found_without_a_reference() -> None:
    """Issue 17: of joints drawn at random, most recordings; docs/detection.md has how many of many."""
    found = [bool(cycles_of(without_reference(random_stick_slip(seed).batch))) for seed in range(12)]
    assert sum(found) >= 9


def real_joint(name: str, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and position [rad] of one joint of a real arm; the test is skipped where it is not at hand."""
    path = RECORDINGS / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"recording {name} is not in {RECORDINGS} (set STICKSLIP_RECORDINGS)")
    with np.load(path) as archive:
        return archive["time_s"].astype(float), archive["position_rad"][:, joint].astype(float)


def time_in_stick_slip(batch: Batch) -> float:
    """[s]."""
    monitor = JointMonitor(options=MonitorOptions(learn=False), segments_kept=None)
    monitor.process(batch)
    monitor.finish()
    return sum(one.end - one.start for one in monitor.segments if one.status is Status.STICK_SLIP)


@pytest.mark.parametrize("joint", [0, 1, *map(nightly, range(2, _JOINTS))])
def test_a_real_leader_does_not_stick(joint: int) -> None:
    """Issue 17: an arm that a person moves, less than 1 % of the time."""
    time, position = real_joint(_LEADER, joint)
    assert time_in_stick_slip(Batch(time=time, position=position)) < 0.01 * (time[-1] - time[0])


def test_a_real_follower_does_not_stick() -> None:
    """Issue 17: the arm that follows it, less than 1 % of the time of all joints."""
    spent = watched = 0.0
    for joint in range(_JOINTS):
        leader_time, leader = real_joint(_LEADER, joint)
        time, position = real_joint(_FOLLOWER, joint)
        spent += time_in_stick_slip(
            Batch(time=time, position=position, reference_position=np.interp(time, leader_time, leader))
        )
        watched += time[-1] - time[0]
    assert spent < 0.01 * watched


@pytest.mark.parametrize("seed", range(3))
def test_a_turn_is_no_dip(seed: int) -> None:
    """A noisy reading stands where a smooth joint turns; that the joint did not rest there made it slow on its way."""
    time = np.arange(0.0, 30.0, 1.0 / 1024.0)
    noise = 1.6e-6 * np.random.default_rng(seed).standard_normal(len(time))
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=0.0128 * np.sin(2.0 * np.pi * time / 4.0) + noise))
    found = {segment.status for segment in monitor.segments}
    assert Status.SMOOTH in found
    assert Status.AT_RISK not in found


@pytest.mark.parametrize("referred", [False, True])
@pytest.mark.parametrize(("rate", "wait"), [(200.0, 0.025), (200.0, 0.1), (1000.0, 0.025)])
@pytest.mark.parametrize("count", [1e-5, 1e-3])
@pytest.mark.parametrize("swing", [0.0, 0.05])
def test_samples_that_come_together_show_no_stands(
    referred: bool, rate: float, wait: float, count: float, swing: float
) -> None:
    """By the stamps of arrival a smooth joint stops and goes, by the number of samples it does not: so it is said."""
    time = np.arange(0.0, 20.0, 1.0 / rate)
    position = 0.1 * time + swing * np.sin(time)
    stamps = arriving(time, np.random.default_rng(1), wait)
    monitor = JointMonitor(segments_kept=None)
    reference = position if referred else np.full(len(time), np.nan)
    batch = Batch(time=stamps, position=count * np.round(position / count), reference_position=reference)
    assert monitor.process(batch) + monitor.finish() == []
    assert not {segment.status for segment in monitor.segments} & {Status.AT_RISK, Status.STICK_SLIP}
    assert monitor.why_not_judged() == StampsInBursts()


@pytest.mark.parametrize(("seed", "wait"), [(1, 0.025), (4, 0.1), (6, 0.025), (9, 0.1)])
def test_stick_slip_is_found_though_samples_come_together(seed: int, wait: float) -> None:
    """A joint at rest stands for many samples, whatever their stamps say; it is never called smooth."""
    batch = random_stick_slip(seed).batch
    monitor = JointMonitor(segments_kept=None)
    stamps = arriving(batch.time, np.random.default_rng(5), wait)
    together = Batch(time=stamps, position=batch.position, reference_position=batch.reference_position)
    assert len(monitor.process(together) + monitor.finish()) >= 0.6 * len(cycles_of(batch))
    assert Status.SMOOTH not in {segment.status for segment in monitor.segments}


@pytest.mark.parametrize("count", [1e-5, 1e-3])
@pytest.mark.parametrize(("wait", "scatter"), [(0.02, 0.0), (0.05, 0.0), (0.05, 0.3)])
def test_a_sensor_that_is_read_seldom_shows_no_sticks(count: float, wait: float, scatter: float) -> None:
    """A drive tells its position 20 or 50 times a second, and a controller publishes it at 1 kHz: a sine has no cycle.

    How often it tells it was learnt from the first turn on, when the resolution was known, and in seconds.
    """
    time, generator = np.arange(0.0, 20.0, 0.001), np.random.default_rng(2)
    told = np.cumsum(wait * generator.uniform(1.0 - scatter, 1.0 + scatter, int(30.0 / wait)))
    held = np.concatenate([[0.0], told])[np.searchsorted(told, time, side="right")]
    position, reference = (0.3 * np.sin(0.5 * at) for at in (held, time))
    monitor = JointMonitor(segments_kept=None)
    batch = Batch(time=time, position=count * np.round(position / count), reference_position=reference)
    assert monitor.process(batch) + monitor.finish() == []
    lasted = dict.fromkeys(Status, 0.0)
    for segment in monitor.segments:
        lasted[segment.status] += segment.end - segment.start
    assert lasted[Status.SMOOTH] > 10.0
    assert lasted[Status.AT_RISK] < 1.0


@pytest.mark.parametrize("count", [1e-5, 1e-3])
@pytest.mark.parametrize("wait", [0.02, 0.05])
def test_a_reading_that_waits_now_and_then_is_no_stop(count: float, wait: float) -> None:
    """Of 3 % of its readings each stands for five: a joint of varying speed was at risk for 7 to 31 % of its time.

    No joint is at once where it would have been without a stop.
    """
    time, generator = np.arange(0.0, 30.0, 0.001), np.random.default_rng(2)
    told = np.cumsum(wait * np.where(generator.random(int(40.0 / wait)) < 0.03, 5.0, 1.0))
    held = np.concatenate([[0.0], told])[np.searchsorted(told, time, side="right")]
    position, reference = (0.1 * at + 0.05 * np.sin(at) for at in (held, time))
    for led in ({}, {"reference_position": reference}):
        monitor = JointMonitor(segments_kept=None)
        assert monitor.process(Batch(time=time, position=count * np.round(position / count), **led)) == []
        at_risk = sum(one.end - one.start for one in monitor.segments if one.status is Status.AT_RISK)
        assert at_risk < 0.04 * time[-1]
