# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reversals that are seen in samples, against what the model predicts of the same joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.model.compensation import usual_compensation
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.reversal import ReferenceMotion, followed, reversals, sine, triangle
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.detection.reversals import ReversalMeter, ReversalRecord
from stickslip_ros.monitoring.detection.status import Finding, Reversing, Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, SampleBuffer
from stickslip_ros.output.wording import reason_text

PERIOD, COUNTS = 1e-3, 2.5e-5
GAINS = Gains(stiffness=6300.0, damping=200.0)


def recorded(joint: Joint, reference: ReferenceMotion, duration: float, seed: int = 1, gains: Gains = GAINS) -> Batch:
    """What an encoder sees of a joint that follows a reference again and again."""
    times = PERIOD * np.arange(round(duration / PERIOD) + 1)
    length = reference.period * (len(reference.position) - 1)
    position = np.interp(times % length, reference.period * np.arange(len(reference.position)), reference.position)
    motion = followed(joint, gains, ReferenceMotion(period=PERIOD, position=position))
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


def test_stops_after_a_reversal_are_part_of_it(puma: Joint) -> None:
    """A joint that stops three times more after it has turned settles when it breaks away from the last stop."""
    gains = Gains(stiffness=6300.0, damping=20.0)
    reference = triangle(0.02, 0.03, puma, gains)
    predicted = reversals(puma, gains, reference)[-1]
    record = seen(recorded(puma, reference, 60.0, gains=gains))
    assert record is not None
    assert record.last.stops == predicted.stops == 3
    assert record.last.settles_after == pytest.approx(predicted.settles_after, rel=0.02)


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
    assert any(text.startswith("reversing: at a reversal it stands for 0.") and "mrad" in text for text in reasons)


def test_forgotten_when_told(puma: Joint) -> None:
    """Issue 23: a reset forgets reversals with the rest."""
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    monitor.process(recorded(puma, sine(0.05, 0.2, puma, GAINS), 20.0))
    assert monitor.assessment().reversals is not None
    monitor.reset()
    assert monitor.assessment().reversals is None


@pytest.mark.parametrize("share", [0.9, 1.0])
def test_turns_without_a_stop_are_measured(puma: Joint, share: float) -> None:
    """Issue 23: friction fed forward, the joint passes its reversals; what error is left is seen all the same."""
    reference = sine(0.2, 0.1, puma, GAINS)
    compensation = usual_compensation(puma.friction, period=PERIOD, resolution=0.0, feedforward=share)
    times = PERIOD * np.arange(round(45.0 / PERIOD) + 1)
    length = reference.period * (len(reference.position) - 1)
    position = np.interp(times % length, reference.period * np.arange(len(reference.position)), reference.position)
    conditions = OperatingConditions(compensation=compensation)
    motion = followed(puma, GAINS, ReferenceMotion(period=PERIOD, position=position), conditions)
    batch = Batch(
        time=motion.time, position=COUNTS * np.round(motion.position / COUNTS), reference_position=position[1:]
    )
    predicted = reversals(puma, GAINS, reference, conditions)[-1]
    record = seen(batch)
    assert record is not None
    assert record.count == 8
    assert record.standing <= 0.05
    assert record.peak_error == pytest.approx(predicted.peak_error, rel=0.1, abs=2.0 * COUNTS)


def test_a_frictionless_joint_turns_without_standing() -> None:
    """Issue 23: the lag of its damping is all that is measured; in pieces as at once."""
    times = np.arange(0.0, 30.0, 0.002)
    reference, lag = 0.3 * np.sin(1.3 * times), 0.05
    batch = Batch(
        time=times, position=1e-5 * np.round(0.3 * np.sin(1.3 * (times - lag)) / 1e-5), reference_position=reference
    )
    record = seen(batch)
    assert record is not None
    assert record.count == 12
    assert record.standing == 0.0
    assert record.peak_error == pytest.approx(0.3 * 2.0 * np.sin(0.65 * lag), rel=0.02)
    assert record.lost_motion == pytest.approx(0.3 * (1.0 - np.cos(1.3 * lag)), rel=0.05)
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    for begin in range(0, len(batch), 61):
        monitor.process(batch.where(slice(begin, begin + 61)))
    monitor.finish()
    assert monitor.assessment().reversals == record
    assert reason_text(Finding(status=Status.NOT_JUDGED, reason=Reversing(record=record))).startswith(
        "reversing: at a reversal it does not stand still and falls behind by "
    )


def test_what_shakes_under_a_resting_reference_does_not_turn_round() -> None:
    """Issue 23: only a reference that turns makes a reversal."""
    times = np.arange(0.0, 20.0, 0.002)
    shaking = 1e-5 * np.round(0.01 * np.sin(20.0 * times) / 1e-5)
    assert seen(Batch(time=times, position=shaking, reference_position=np.zeros(len(times)))) is None
    rising = 0.02 * times
    assert seen(Batch(time=times, position=rising + shaking, reference_position=rising)) is None


def test_a_pause_at_the_turn_is_not_friction(puma: Joint) -> None:
    """Only while the reference goes on does friction hold the joint: a pause of 4 s was told as standing for 4 s."""
    period, pause = 1e-3, 4.0
    there = np.arange(0.0, 0.02, 0.005 * period)
    reference = np.concatenate([there, np.full(round(pause / period), there[-1]), there[::-1]])
    velocities = np.gradient(reference, period)
    motion = JointSimulation(puma, GAINS).advance(period, reference, velocities)
    time = period * np.arange(len(reference))
    record = seen(Batch(time=time, position=1e-5 * np.round(motion.position / 1e-5), reference_position=reference))
    assert record is not None
    assert record.count == 1
    assert record.standing < 1.0


def test_a_reference_that_jumps_does_not_turn_round() -> None:
    """A square wave: how far the joint is behind is the jump."""
    time = 1e-2 * np.arange(4000)
    reference = np.where(time % 4.0 < 2.0, 0.0, 0.5)
    position, positions = 0.0, []
    for goal in reference:
        position += 0.1 * (goal - position)
        positions.append(position)
    assert (
        seen(Batch(time=time, position=1e-4 * np.round(np.array(positions) / 1e-4), reference_position=reference))
        is None
    )


def test_a_joint_that_comes_back_to_where_it_stood_stands_again() -> None:
    """Its way was counted from where it last stood: none out and back, so that no turn was measured at a stop."""
    time = np.arange(0.0, 24.0, 1.0 / 64.0)
    phase = time % 10.0
    reference = np.where(phase < 5.0, phase, 10.0 - phase) - 1.6
    # It turns at once above, and stands at its stop below until the reference comes back.
    position = 2e-4 * np.round(np.maximum(reference, 0.0) / 2e-4)
    record = seen(Batch(time=time, position=position, reference_position=reference))
    assert record is not None
    assert record.count == 4
    assert record.last.standing == pytest.approx(3.2, abs=0.1)


def test_a_turn_is_answered_after_it() -> None:
    """A reference that is set back while the joint stands: the way that it jumped was told as lost motion, 6 rad."""
    time = 1e-2 * np.arange(1, 1200)
    reference = time % 7.0
    position = 1e-4 * np.round(np.where(time < 7.05, 0.0, time - 7.05) / 1e-4)
    samples = SampleBuffer()
    samples.add(Batch(time=time, position=position, reference_position=reference))
    meter = ReversalMeter()
    meter.turn(7.06, samples)
    meter.finish(12.0, samples)
    assert meter.record is not None
    assert meter.record.lost_motion == pytest.approx(0.025, abs=0.02)
