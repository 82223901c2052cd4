# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Encoders of few counts a slip: slips are found, or it is said that the encoder is too coarse to count them."""

from __future__ import annotations

import numpy as np
import pytest
from support import record

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.detection.status import Finding, Status, TooCoarse
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

NOISE = 0.3  # counts


def watch(puma: Joint, counts: float, *, noise: float, every: int = 4) -> tuple[float, Finding, set[Status]]:
    """Cycles found over slips there were, the finding at the end, and the words for what was before."""
    recording = record(puma, Gains(stiffness=630.0), 0.0058, resolution=1e-9, every=every)
    positions = np.array([event.position for event in recording.trajectory.events])
    count = float(np.median(np.abs(np.diff(positions)[::2]))) / counts
    readings = recording.batch.position / count + 0.37
    readings += np.random.default_rng(1).normal(0, noise, len(readings))
    batch = Batch(
        time=recording.batch.time,
        position=count * np.round(readings),
        reference_position=recording.batch.reference_position,
        reference_velocity=recording.batch.reference_velocity,
    )
    monitor = JointMonitor()
    cycles = monitor.process(batch)
    finding = monitor.finding()
    return len(cycles) / len(recording.sticks), finding, {segment.status for segment in monitor.segments}


@pytest.mark.parametrize(("counts", "noise"), [(7, 0.0), (15, NOISE), (30, NOISE)])
def test_slips_of_few_counts_are_found(puma: Joint, counts: float, noise: float) -> None:
    """Seven counts a slip are enough without noise, fifteen with noise of 0.3 counts."""
    share, _, _ = watch(puma, counts, noise=noise)
    assert 0.95 <= share <= 1.1


@pytest.mark.parametrize("counts", [5, 6])
def test_it_is_said_that_an_encoder_is_too_coarse(puma: Joint, counts: float) -> None:
    """With noise of 0.3 counts the band is two: slips of two bands were called smooth motion."""
    _, finding, words = watch(puma, counts, noise=NOISE)
    assert finding.status is Status.NOT_JUDGED
    assert isinstance(finding.reason, TooCoarse)
    assert abs(finding.reason.counts - counts) <= 0.35 * counts
    assert Status.SMOOTH not in words


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("interval", [0.001, 0.01, 0.02])
def test_steady_motion_on_a_coarse_encoder_is_smooth(interval: float, noise: float) -> None:
    """Counts come evenly, but for noise and whole samples; a slowly changing speed makes no steps."""
    time = np.arange(0.0, 30.0, interval)
    counts = 12.0 * time + 6.0 * np.cos(0.5 * time) + np.random.default_rng(2).normal(0, noise, len(time))
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=1e-3 * np.round(counts)))
    assert monitor.finding().status is Status.SMOOTH
    assert not [segment for segment in monitor.segments if segment.start > 6.0 and segment.status is not Status.SMOOTH]


@pytest.mark.parametrize("counts", [25, 40])
def test_short_stops_between_slips_of_few_counts_are_not_smooth(counts: float) -> None:
    """To few counts a slip a short stop is one long gap; averaged over three gaps the speed fell to a third only."""
    time = np.arange(0.0, 30.0, 0.004)
    number, phase = np.divmod(time, 0.6)
    way = number + 0.5 - 0.5 * np.cos(np.pi * np.minimum(phase / 0.55, 1.0))
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=1e-3 * np.round(counts * way)))
    assert Status.SMOOTH not in {segment.status for segment in monitor.segments if segment.start > 2.0}
