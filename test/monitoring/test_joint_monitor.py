# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint's findings under bad input, gaps, restarts and change."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import examples
from hypothesis import given
from hypothesis import strategies as st
from support import record

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.model.verdict import verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.detection.status import Finding, Hunting, NoSamples, Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output.wording import reason_text
from stickslip_ros.settings.known_joints import load_joint

STICKING = Gains(stiffness=630.0)


def test_before_any_sample_nothing_is_claimed(puma: Joint) -> None:
    """Issue 2: no data is `unknown`, with the reason."""
    assessment = JointMonitor(puma, STICKING).assessment()
    assert assessment.finding.status is Status.UNKNOWN
    assert assessment.finding.reason == NoSamples()
    assert reason_text(assessment.finding) == "no samples yet"
    assert math.isnan(assessment.time)


def test_positions_that_are_missing_are_named(puma: Joint) -> None:
    """Issue 2: NaN positions leave the joint `unknown`, and say so."""
    monitor = JointMonitor(puma, STICKING)
    monitor.process(Batch(time=np.arange(5.0), position=np.full(5, np.nan)))
    finding = monitor.finding()
    assert finding.status is Status.UNKNOWN
    assert "position is missing" in reason_text(finding)


def test_few_samples_are_not_judged() -> None:
    """Issue 2: too few samples are `not_judged`."""
    monitor = JointMonitor()
    monitor.process(Batch(time=1e-3 * np.arange(20), position=np.zeros(20)))
    assert monitor.finding().status is Status.NOT_JUDGED


def test_holding_is_at_rest_and_moving_on_says_stuck() -> None:
    """Issue 2: at rest; with the reference leaving, the reason says that the joint is stuck."""
    time = 1e-2 * np.arange(1000)
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=np.full(1000, 0.5), reference_position=0.5 + 0.01 * time))
    finding = monitor.finding()
    assert finding.status is Status.AT_REST
    assert "stuck" in reason_text(finding)


def test_a_joint_that_stands_where_its_reference_has_stopped_is_not_stuck() -> None:
    """It is some counts behind, as friction holds any joint."""
    time = 1e-2 * np.arange(2000)
    reference = 0.01 * np.minimum(time, 5.0)
    position = 1e-4 * np.round(np.maximum(reference - 0.002, 0.0) / 1e-4)
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=position, reference_position=reference))
    assert monitor.finding() == Finding(status=Status.AT_REST, reason=None)


@pytest.mark.parametrize("rate", [400.0, 1000.0])
@pytest.mark.parametrize("frequency", [5.0, 10.0])
def test_steps_are_no_rest(rate: float, frequency: float) -> None:
    """A stiff servo that is told where to be a few times a second stands most of the time, and moves."""
    time = np.arange(0.0, 24.0, 1.0 / rate)
    steps = 0.002 * np.floor(frequency * time)
    position = 0.0
    positions = []
    for step in steps:
        position += (step - position) * min(200.0 / rate, 1.0)
        positions.append(position)
    monitor = JointMonitor(segments_kept=None)
    monitor.process(Batch(time=time, position=1e-4 * np.round(np.array(positions) / 1e-4)))
    monitor.finish()
    resting = sum(one.end - one.start for one in monitor.segments if one.status is Status.AT_REST)
    assert resting < 0.85 * time[-1]
    assert {one.status for one in monitor.segments} == {Status.AT_REST, Status.NOT_JUDGED}


def test_a_few_counts_of_creep_are_not_smooth() -> None:
    """A telescope creeps by three counts in ten seconds, and jumps by hundreds: smooth motion has counts enough."""
    time = np.arange(0.0, 96.0, 0.02)
    creep = 2e-6 * np.floor(0.3 * time)
    position = creep + 1.4e-3 * np.floor(time / 19.0)
    monitor = JointMonitor(segments_kept=None)
    monitor.process(Batch(time=time, position=position))
    monitor.finish()
    assert Status.SMOOTH not in {one.status for one in monitor.segments}


def test_twenty_readings_a_second_are_twenty() -> None:
    """They were too few: the mean of intervals of 0.05 s is not exactly that."""
    time = 0.05 * np.arange(400.0) + 1.7e9
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=1e-5 * np.round(0.1 * (time - time[0]) / 1e-5)))
    assert monitor.finding().status is Status.SMOOTH


def test_sine_is_not_judged_for_reversing() -> None:
    """Issue 2: motion that turns before it can be judged is `not_judged: reversing`."""
    time = 1e-3 * np.arange(20_000)
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=1e-5 * np.round(0.2 * np.sin(4 * time) / 1e-5)))
    assert {segment.status for segment in monitor.segments} <= {Status.NOT_JUDGED, Status.AT_REST}
    assert reason_text(monitor.finding()) == "reversing"


@pytest.mark.parametrize("frequency", [0.05, 0.1, 0.25])
@pytest.mark.parametrize("step", [1e-9, 1e-5])
def test_a_slow_sine_is_smooth_between_its_turns(frequency: float, step: float) -> None:
    """Its speed rises from nothing at each turn, as it does from a rest: that is no dip."""
    time = 1e-2 * np.arange(4000)
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=step * np.round(0.3 * np.sin(math.tau * frequency * time) / step)))
    statuses = {segment.status for segment in monitor.segments}
    assert Status.SMOOTH in statuses
    assert statuses <= {Status.SMOOTH, Status.NOT_JUDGED, Status.AT_REST}


def test_smooth_with_a_thin_margin_is_at_risk(puma: Joint) -> None:
    """Issue 2: smooth motion whose margin is thin is `at_risk`."""
    time = 1e-3 * np.arange(5000)
    position = 2.5e-5 * np.round(0.0058 * time / 2.5e-5)
    batch = Batch(time=time, position=position, reference_velocity=np.full(5000, 0.0058))
    monitor = JointMonitor(puma, STICKING)
    monitor.process(batch)
    assert monitor.finding().status is Status.AT_RISK
    safe = JointMonitor(puma, Gains(stiffness=9000.0, damping=100.0))
    safe.process(batch)
    assert safe.finding().status is Status.SMOOTH


def test_cure_is_seen(puma: Joint) -> None:
    """Issue 2: stick-slip, then the advised gains, then smooth: status and margin follow."""
    before = record(puma, STICKING, 0.0058, duration=15.0, hold=0.0)
    monitor = JointMonitor(puma, STICKING)
    monitor.process(before.batch)
    sick = monitor.assessment()
    assert sick.finding.status is Status.STICK_SLIP
    assert sick.margin is not None
    assert sick.margin.energy_margin < 0
    assert sick.recommended is not None
    advised = sick.recommended.gains
    after = record(puma, advised, 0.0058, duration=15.0, hold=0.0).batch
    monitor.gains = advised
    shift = before.batch.time[-1]
    monitor.process(
        Batch(
            time=after.time + shift,
            position=after.position + before.batch.position[-1],
            reference_position=after.reference_position + before.batch.position[-1],
            reference_velocity=after.reference_velocity,
        )
    )
    cured = monitor.assessment()
    assert cured.finding.status is Status.SMOOTH
    assert cured.recommendation is not None
    assert sick.recommendation is not None
    assert sick.recommendation.reserve < 0 < cured.recommendation.reserve


def test_the_reserve_in_passing_is_that_of_the_verdict(puma: Joint) -> None:
    """Issue 36, item 5: one damping reserve, whoever asks; none where integration takes too long."""
    for gains in (STICKING, Gains(stiffness=2016.0, damping=20.0)):
        monitor = JointMonitor(puma, gains)
        for velocity in (-0.0058, 0.002, 0.005, 0.02):
            found = verdict(puma, gains, abs(velocity)).damping_reserve
            assert 1.0 + monitor.damping_reserve(velocity) == pytest.approx(1.0 + found, rel=0.02)
        assert np.isnan(monitor.damping_reserve(0.0))
    assert np.isnan(JointMonitor(puma, Gains(stiffness=630.0, integral=100.0)).damping_reserve(0.005))
    assert np.isnan(JointMonitor().damping_reserve(0.005))


def test_each_speed_has_its_own_margin(puma: Joint) -> None:
    """The margin asked for at one speed is none at another."""
    monitor = JointMonitor(puma, STICKING)
    monitor.process(record(puma, STICKING, 0.0058, duration=3.0).batch)
    for velocity in (0.0058, 0.02, 0.0058):
        margin = monitor.assessment(velocity).margin
        assert margin is not None
        assert margin.energy_margin == stability_margin(puma, STICKING, velocity).energy_margin


def test_without_gains_or_joint_the_motion_is_judged_all_the_same(puma: Joint) -> None:
    """Issue 2: status needs neither gains nor friction; the margin says what it lacks."""
    batch = record(puma, STICKING, 0.0058, duration=10.0).batch
    for joint, gains, word in ((None, STICKING, "friction"), (puma, None, "gains")):
        monitor = JointMonitor(joint, gains)
        monitor.process(batch)
        assessment = monitor.assessment()
        assert assessment.finding.status is Status.STICK_SLIP
        assert assessment.margin is None
        assert word in assessment.margin_reason


@pytest.mark.parametrize(("stiffness", "word"), [(0.0, "stiffness"), (-10.0, "stiffness")])
def test_zero_or_negative_stiffness(puma: Joint, stiffness: float, word: str) -> None:
    """Issue 2: no stiffness, no Eq. (43), with the reason; no advice, with the reason."""
    monitor = JointMonitor(puma, Gains(stiffness=stiffness))
    monitor.process(record(puma, STICKING, 0.0058, duration=10.0).batch)
    assessment = monitor.assessment()
    assert assessment.margin is not None
    assert not assessment.margin.applicable
    assert word in assessment.margin_reason
    assert assessment.recommended is not None
    assert not assessment.recommended.found


def test_bad_stamps_are_dropped_and_counted(puma: Joint) -> None:
    """Issue 2: stamps that stand still, go back or are not finite cost samples, are counted, and change no finding."""
    clean = record(puma, STICKING, 0.0058, duration=12.0).batch
    generator = np.random.default_rng(0)
    insert = np.sort(generator.choice(np.arange(100, len(clean)), 60, replace=False))
    time, position = clean.time.copy(), clean.position.copy()
    bad_times = np.where(
        np.arange(60) % 3 == 0, time[insert - 1], np.where(np.arange(60) % 3 == 1, time[insert] - 0.05, np.nan)
    )
    spoilt = Batch(
        time=np.insert(time, insert, bad_times),
        position=np.insert(position, insert, 77.0),
        reference_position=np.insert(clean.reference_position, insert, 99.0),
        reference_velocity=np.insert(clean.reference_velocity, insert, 99.0),
    )
    monitor, reference = JointMonitor(), JointMonitor()
    cycles, expected = monitor.process(spoilt), reference.process(clean)
    assert [cycle.breakaway for cycle in cycles] == [cycle.breakaway for cycle in expected]
    assert monitor.assessment().dropped == {
        "time is missing, infinite or larger than 1e+12": 20,
        "stamp stands still": 20,
        "stamp goes backwards": 20,
    }


def test_time_that_begins_anew_begins_a_new_recording(puma: Joint) -> None:
    """Issue 2: a bag that loops goes on being counted, and no cycle spans the seam."""
    batch = record(puma, STICKING, 0.0058, duration=12.0).batch
    once = JointMonitor()
    first = once.process(batch) + once.finish()
    monitor = JointMonitor()
    cycles = monitor.process(batch) + monitor.process(batch) + monitor.finish()
    assert len(cycles) == 2 * len(first)
    assert monitor.finding().status is Status.STICK_SLIP


def test_a_silence_is_no_dwell() -> None:
    """Issue 2: a long gap in smooth motion is neither a stick nor a slip."""
    time = np.concatenate([1e-3 * np.arange(4000), 10.0 + 1e-3 * np.arange(4000)])
    monitor = JointMonitor()
    assert monitor.process(Batch(time=time, position=2.5e-5 * np.round(0.02 * time / 2.5e-5))) == []
    assert Status.STICK_SLIP not in {segment.status for segment in monitor.segments}


@pytest.mark.parametrize("size", [1, 60])
def test_samples_two_seconds_apart_are_one_stretch(size: int) -> None:
    """Only what is longer is a silence: there were as many segments as samples, all without length or velocity."""
    time = 2.0 * np.arange(60)
    monitor = JointMonitor()
    for begin in range(0, 60, size):
        part = slice(begin, begin + size)
        monitor.process(Batch(time=time[part], position=0.01 * time[part]))
    monitor.finish()
    (segment,) = monitor.segments
    assert (segment.start, segment.end, segment.velocity) == (0.0, 118.0, pytest.approx(0.01))


def test_reset_forgets(puma: Joint) -> None:
    """Issue 2: reset forgets what was learnt, not the joint."""
    monitor = JointMonitor(puma, STICKING, MonitorOptions(limits=AdviceLimits(wanted_margin=0.5)))
    monitor.process(record(puma, STICKING, 0.0058, duration=12.0).batch)
    monitor.reset()
    assert monitor.cycle_count == 0
    assert monitor.finding().status is Status.UNKNOWN
    assert monitor.joint is puma


def test_shapes_must_agree() -> None:
    """Issue 2: arrays of unequal length are refused with both shapes."""
    with pytest.raises(ValueError, match=r"position has shape \(3,\) but time has \(2,\)"):
        Batch(time=np.zeros(2), position=np.zeros(3))


def test_a_silence_ends_the_record_however_it_is_batched(puma: Joint) -> None:
    """Issue 2: after a silence the motion is followed anew, live as recorded, and no cycle spans it."""
    batch = record(puma, STICKING, 0.0058, duration=20.0).batch
    cut = batch.where((batch.time < 8.0) | (batch.time > 12.5))
    whole = JointMonitor()
    expected = whole.process(cut)
    assert len(expected) > 6
    assert not any(cycle.breakaway - cycle.dwell < 8.0 < 12.4 < cycle.arrest for cycle in expected)
    for size in (37, 1000):
        monitor = JointMonitor()
        pieces = [cut.where(slice(i, i + size)) for i in range(0, len(cut), size)]
        assert [cycle for piece in pieces for cycle in monitor.process(piece)] == expected


def test_segments_have_their_mean_velocities(puma: Joint) -> None:
    """Also those that became stick-slip later, and were joined then."""
    batch = record(puma, STICKING, 0.0058, duration=20.0).batch
    monitor = JointMonitor(options=MonitorOptions(learn=False), segments_kept=None)
    for begin in range(0, len(batch), 500):
        monitor.process(batch.where(slice(begin, begin + 500)))
    monitor.finish()
    assert Status.STICK_SLIP in {segment.status for segment in monitor.segments}
    for segment in monitor.segments:
        begin, end = np.interp([segment.start, segment.end], batch.time, batch.position)
        assert segment.velocity == pytest.approx((end - begin) / (segment.end - segment.start), abs=2e-4), segment


def test_one_late_stick_is_soon_forgotten(puma: Joint) -> None:
    """Issue 2: two sticks after a long smooth stretch do not keep the joint in `stick_slip` for as long again."""
    time = 1e-3 * np.arange(30_000)
    # While it sticks it slips at 2.5 times the speed of its reference, to keep up with it.
    sticks = (time < 5.0) | ((time > 15.0) & (time < 17.0))
    velocity = np.where(sticks, np.where(time % 1.0 < 0.6, 0.0, 0.025), 0.01)
    position = 1e-5 * np.round(np.cumsum(1e-3 * velocity) / 1e-5)
    monitor = JointMonitor()
    monitor.process(Batch(time=time, position=position, reference_velocity=np.full(30_000, 0.01)))
    assert monitor.cycle_count >= 5
    smooth = [segment for segment in monitor.segments if segment.status is Status.SMOOTH]
    assert smooth[-1].start < 21.0
    assert smooth[-1].end > 29.0


def hold(joint: Joint, gains: Gains, *, offset: float = 0.016, duration: float = 60.0) -> Batch:
    """A joint that starts at rest beside a reference that stands still, seen by an encoder."""
    count = round(duration * 1e3)
    motion = JointSimulation(joint, gains).advance(1e-3, np.full(count, offset), np.zeros(count))
    position = 2.5e-5 * np.round(motion.position / 2.5e-5)
    return Batch(time=motion.time, position=position, effort=motion.effort, reference_position=np.full(count, offset))


def test_hunting_is_stick_slip_at_standstill(puma: Joint) -> None:
    """Issue 3: slips to and fro about a standing reference are `stick_slip`, reason "hunting", and are cycles."""
    gains = Gains(stiffness=630.0, damping=20.0, integral=1000.0)
    monitor = JointMonitor(puma, gains)
    batch = hold(puma, gains, duration=70.0)
    cycles = monitor.process(batch)
    assert monitor.finding() == Finding(status=Status.STICK_SLIP, reason=Hunting())
    assert len(cycles) >= 5
    assert all(cycle.hunting for cycle in cycles)
    assert all(one.slip_distance * other.slip_distance < 0 for one, other in itertools.pairwise(cycles))
    # Cut into pieces it is the same.
    pieces = JointMonitor(puma, gains)
    assert [
        cycle for i in range(0, len(batch), 333) for cycle in pieces.process(batch.where(slice(i, i + 333)))
    ] == cycles


def test_settling_and_commanded_reversals_are_no_hunting(puma: Joint) -> None:
    """Issue 3: a joint that creeps to its reference, and one told to go to and fro with rests, do not hunt."""
    gains = Gains(stiffness=630.0, damping=20.0, integral=200.0)
    monitor = JointMonitor(puma, gains)
    assert monitor.process(hold(puma, gains)) == []
    assert monitor.finding().status is Status.AT_REST
    time = 1e-3 * np.arange(40_000)
    position = 0.02 * np.clip(np.abs((time % 8.0) - 4.0) - 1.0, 0.0, 2.0)
    told = JointMonitor()
    assert told.process(Batch(time=time, position=position, reference_position=position)) == []


def test_just_after_a_rest_nothing_is_smooth(puma: Joint) -> None:
    """Issue 3: a motion counts from the rest before it, although that rest is only known in full later."""
    gains = Gains(stiffness=630.0, damping=20.0, integral=200.0)
    monitor = JointMonitor(puma, gains)
    monitor.process(hold(puma, gains, duration=8.0))
    assert Status.SMOOTH not in {segment.status for segment in monitor.segments}


def test_stick_slip_ends_in_rest(puma: Joint) -> None:
    """Issue 3: a joint that stuck and slipped, and is then told to stand, is `at_rest` a few periods later."""
    gains = Gains(stiffness=630.0)
    time = 1e-3 * np.arange(40_000)
    reference = 0.0058 * np.minimum(time, 25.0)
    motion = JointSimulation(puma, gains).advance(1e-3, reference, np.where(time < 25.0, 0.0058, 0.0))
    monitor = JointMonitor(puma, gains)
    monitor.process(
        Batch(time=motion.time, position=2.5e-5 * np.round(motion.position / 2.5e-5), reference_position=reference)
    )
    assert monitor.cycle_count > 10
    assert monitor.finding().status is Status.AT_REST


@pytest.mark.slow
@examples(8, 15)
@given(data=st.data())
def test_cycles_are_told_when_they_end(data: st.DataObject) -> None:
    """Issue 7: within 100 ms of the arrest where steps are fine, the same cycles as in hindsight, however batched."""
    stiffness, speed = data.draw(st.sampled_from([100, 200, 320])), data.draw(st.floats(0.5, 2.0))
    resolution = data.draw(st.sampled_from([1e-6, 1e-5, 2.5e-5]))
    puma = load_joint("puma560_joint1").joint
    with_reference = data.draw(st.booleans())
    recording = record(
        puma, Gains(stiffness=6.3 * stiffness), 0.0058 * speed, resolution=resolution,
        offset=data.draw(st.floats(0, 1e-4)), with_reference=with_reference,
    )  # fmt: skip
    hindsight, live = JointMonitor(), JointMonitor(at_arrest=True)
    later = hindsight.process(recording.batch) + hindsight.finish()
    step, told = data.draw(st.integers(5, 50)), []
    for begin in range(0, len(recording.batch), step):
        part = recording.batch.where(slice(begin, begin + step))
        told += [(float(part.time[-1]), cycle) for cycle in live.process(part)]
    told += [(math.inf, cycle) for cycle in live.finish()]
    assert [cycle.breakaway for _, cycle in told] == [cycle.breakaway for cycle in later]
    assert [cycle.dwell for _, cycle in told] == [cycle.dwell for cycle in later]
    for (_, cycle), known in zip(told, later, strict=True):
        assert abs(cycle.arrest - known.arrest) < 0.03
        assert cycle.slip_distance == pytest.approx(known.slip_distance, rel=0.05, abs=2 * resolution)
    # Whether it is stick-slip at all is not known before the first cycles are over.
    first = 4 if with_reference else 8
    in_time = [when - cycle.arrest < 0.1 + 1e-3 * step for when, cycle in told[first:-1]]
    assert sum(in_time) >= 0.8 * len(in_time)
    whole = JointMonitor(at_arrest=True)
    assert [c.arrest for c in whole.process(recording.batch) + whole.finish()] == [c.arrest for _, c in told]


def test_a_velocity_loop_has_no_stiffness_to_advise(puma: Joint) -> None:
    """Issue 34, item 9: Eq. (43) is of a position loop; what helps is said in terms of the velocity loop."""
    batch = record(puma, STICKING, 0.0058, duration=10.0, every=4).batch
    commanded = replace(batch, reference_position=np.full(len(batch), math.nan), effort=np.zeros(0))
    for joint in (None, puma):
        monitor = JointMonitor(joint, studies_at_once=True)
        monitor.process(commanded)
        monitor.finish()
        found = monitor.assessment()
        assert found.finding.status is Status.STICK_SLIP
        assert found.margin is None
        assert found.advice is None
        assert "velocities alone are commanded" in found.margin_reason
        assert "proportional gain" in found.margin_reason
    # Known gains are of a position loop, whatever is published of the reference.
    monitor.gains = STICKING
    assert monitor.assessment().margin is not None


@pytest.mark.parametrize(("noise", "allowed"), [(0.001, math.inf), (0.02, 0.1 * 10.03 / 0.02)])
def test_advice_knows_the_noise_of_the_measured_velocity(puma: Joint, noise: float, allowed: float) -> None:
    """Issue 36: k_v times 0.02 rad/s of noise is a tenth of the breakaway torque at 50 N·m·s/rad; 130 were advised."""
    batch = record(puma, STICKING, 0.0058, duration=12.0, with_velocity=True).batch
    noisy = batch.velocity + np.random.default_rng(36).normal(0.0, noise, len(batch))
    monitor = JointMonitor(puma, STICKING)
    monitor.process(replace(batch, velocity=noisy))
    state = monitor.assessment(0.0058)
    assert state.recommended is not None
    assert state.recommended.found
    assert (state.recommended.damping > 100.0) == math.isinf(allowed)
    assert state.recommended.damping <= 1.1 * allowed
