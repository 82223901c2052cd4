# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reversals that are seen in samples, against what the model predicts of the same joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.reversal import ReferenceMotion, followed, reversals, sine, triangle
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.detection.reversals import ReversalRecord
from stickslip_ros.monitoring.detection.status import Reversing, Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output.wording import reason_text

PERIOD, COUNTS = 1e-3, 2.5e-5
GAINS = Gains(stiffness=6300.0, damping=200.0)


def recorded(joint: Joint, reference: ReferenceMotion, duration: float, seed: int = 1) -> Batch:
    """What an encoder sees of a joint that follows a reference again and again."""
    times = PERIOD * np.arange(round(duration / PERIOD) + 1)
    length = reference.period * (len(reference.position) - 1)
    position = np.interp(times % length, reference.period * np.arange(len(reference.position)), reference.position)
    motion = followed(joint, GAINS, ReferenceMotion(period=PERIOD, position=position))
    noise = 0.04 * COUNTS * np.random.default_rng(seed).standard_normal(len(motion.time))
    return Batch(
        time=motion.time,
        position=COUNTS * np.round((motion.position + noise) / COUNTS),
        effort=motion.effort,
        reference_position=position[1:],
    )


def seen(batch: Batch) -> ReversalRecord | None:
    """What the monitor finds."""
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    monitor.process(batch)
    monitor.finish()
    return monitor.assessment().reversals


@pytest.mark.parametrize(("amplitude", "frequency", "count"), [(0.2, 0.1, 11), (0.05, 0.1, 11), (0.02, 0.05, 5)])
def test_what_is_seen_is_what_was_predicted(puma: Joint, amplitude: float, frequency: float, count: int) -> None:
    """Issue 23: standing, lost motion and peak error of a recording are those of the model within 5 %."""
    reference = sine(amplitude, frequency, puma, GAINS)
    predicted = reversals(puma, GAINS, reference)[-1]
    record = seen(recorded(puma, reference, 60.0))
    assert record is not None
    assert record.count == count
    assert record.standing == pytest.approx(predicted.standing, rel=0.05)
    assert record.lost_motion == pytest.approx(predicted.lost_motion, rel=0.08)
    assert record.peak_error == pytest.approx(predicted.peak_error, rel=0.03)
    assert record.last.running_error == pytest.approx(predicted.running_error, rel=0.1)


@pytest.mark.parametrize("contact", ["elasto_plastic", "lugre"])
def test_a_contact_that_gives_way(puma: Joint, contact: str) -> None:
    """Issue 23: the peak error is seen as predicted; the joint is seen to move before it breaks away."""
    friction = replace(puma.friction, presliding_stiffness=2e4, presliding_damping=300.0, contact=contact)
    joint = replace(puma, friction=friction)
    reference = sine(0.2, 0.1, joint, GAINS)
    predicted, record = reversals(joint, GAINS, reference)[-1], seen(recorded(joint, reference, 60.0))
    assert record is not None
    assert record.peak_error == pytest.approx(predicted.peak_error, rel=0.03)
    assert record.standing <= 1.05 * predicted.standing


def test_pieces_make_no_difference(puma: Joint) -> None:
    """Issue 23: how the samples are cut into batches changes nothing."""
    batch = recorded(puma, sine(0.05, 0.2, puma, GAINS), 30.0)
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    for begin in range(0, len(batch), 137):
        monitor.process(batch.where(slice(begin, begin + 137)))
    monitor.finish()
    assert monitor.assessment().reversals == seen(batch)


def test_nothing_is_measured_where_nothing_turns(puma: Joint) -> None:
    """Issue 23: no reference, or one that goes one way, has no reversal, whatever the joint does."""
    batch = recorded(puma, sine(0.05, 0.2, puma, GAINS), 20.0)
    assert seen(replace(batch, reference_position=np.full(len(batch), np.nan))) is None
    assert seen(replace(batch, reference_position=0.01 * batch.time)) is None


def test_reversing_is_said_with_what_is_measured(puma: Joint) -> None:
    """Issue 23: a joint that turns before it can be judged is not judged, and what its reversals do is said."""
    monitor = JointMonitor(options=MonitorOptions(learn=False, least_motion=30.0))
    batch = recorded(puma, triangle(0.02, 0.25, puma, Gains(stiffness=6300.0, damping=200.0)), 20.0)
    reasons = set()
    for begin in range(0, len(batch), 50):
        monitor.process(batch.where(slice(begin, begin + 50)))
        finding = monitor.finding()
        if isinstance(finding.reason, Reversing):
            assert finding.status is Status.NOT_JUDGED
            reasons.add(reason_text(finding))
    assert any(text.startswith("reversing: it stands for 0.") and "mrad" in text for text in reasons)


def test_forgotten_when_told(puma: Joint) -> None:
    """Issue 23: a reset forgets reversals with the rest."""
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    monitor.process(recorded(puma, sine(0.05, 0.2, puma, GAINS), 20.0))
    assert monitor.assessment().reversals is not None
    monitor.reset()
    assert monitor.assessment().reversals is None
