# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 33: stick-slip is found where a joint does nothing else, and not where it does something else."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import RECORDINGS, examples, nightly, recording
from hypothesis import given
from hypothesis import strategies as st
from ordinary_days import DayTally, is_found, ordinary_day, watch_day
from support import record

from stickslip_ros.analysis.judgement import overall_status
from stickslip_ros.bags.table import load_table
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, simulate
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import (
    Finding,
    Hunting,
    NotFollowing,
    SampledTooSlowly,
    Segment,
    SpeedFalls,
    Status,
    StopsAndGoes,
)
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow

COUNT = 2.5e-5
FINGER, SERVO = "tendon_finger_p6200", "bus_servo_pendulum_225108"


def watch(batch: Batch) -> tuple[list[Cycle], list[Segment], JointMonitor]:
    """Cycles, segments and the monitor that found them."""
    monitor = JointMonitor(segments_kept=None)
    cycles = monitor.process(batch)
    return cycles + monitor.finish(), list(monitor.segments), monitor


def spent(segments: list[Segment], status: Status, begin: float = -math.inf, end: float = math.inf) -> float:
    """Time in a status between two times [s]."""
    return sum(max(min(one.end, end) - max(one.start, begin), 0.0) for one in segments if one.status is status)


def rounded(places: np.ndarray, count: float = COUNT) -> np.ndarray:
    """As an encoder reads it."""
    return count * np.round(places / count)


def after_a_move(joint: Joint, way: float, *, with_reference: bool) -> tuple[Batch, list[tuple[float, float]]]:
    """A move at 0.5 rad/s, two seconds of rest, and half a minute at 0.0058 rad/s; the slips there [s]."""
    time = 1e-3 * np.arange(int(1e3 * (abs(way) / 0.5 + 35.0)))
    begin = abs(way) / 0.5 + 2.5
    velocity = np.where((time > 0.5) & (time < 0.5 + abs(way) / 0.5), math.copysign(0.5, way), 0.0)
    velocity[time >= begin] = 0.0058
    reference = 1e-3 * np.cumsum(velocity)
    found = simulate(joint, Gains(stiffness=630.0, damping=20.0), reference, velocity)
    slips = [
        (one.time, other.time) for one, other in itertools.pairwise(found.events)
        if one.kind is EventKind.BREAKAWAY and one.time > begin
    ]  # fmt: skip
    batch = Batch(
        time=found.time, position=rounded(found.position), reference_position=reference if with_reference else ()
    )
    return batch, slips


@pytest.mark.parametrize("with_reference", [True, False])
@pytest.mark.parametrize("way", [0.0, 0.1, 0.3, -0.3, 1.0])
def test_what_came_before_hides_nothing(puma: Joint, way: float, with_reference: bool) -> None:
    """Found 1: after a move of a radian the same slips are found as without it."""
    batch, slips = after_a_move(puma, way, with_reference=with_reference)
    cycles, segments, _ = watch(batch)
    found = [any(abs(cycle.arrest - arrest) < 0.05 for cycle in cycles) for _, arrest in slips]
    assert len(slips) > 20
    assert sum(found) >= len(slips) - 2
    assert all(cycle.breakaway > slips[0][0] - 0.1 for cycle in cycles)
    # Without a reference a dwell of unknown length comes before the first slip, which therefore is no evidence.
    begin = slips[1 if with_reference else 2][0]
    assert spent(segments, Status.STICK_SLIP, begin, slips[-1][1]) > 0.98 * (slips[-1][1] - begin)


@pytest.mark.parametrize("share", [0.5, -1.0, -0.2, 0.017, 1.6])
def test_a_joint_that_does_not_go_with_its_reference_is_no_smooth_one(share: float) -> None:
    """Half as far, or the other way: another joint's reference, or in another unit, or a joint that sags."""
    time = 0.01 * np.arange(2400)
    way = 0.1 * np.clip(time - 2.0, 0.0, 10.0)
    position = rounded(share * 0.1 * np.clip(time - 2.05, 0.0, 10.0))
    _, segments, monitor = watch(Batch(time=time[:1000], position=position[:1000], reference_position=way[:1000]))
    assert not spent(segments, Status.SMOOTH)
    finding = monitor.finding()
    assert finding.status is Status.NOT_JUDGED
    assert isinstance(finding.reason, NotFollowing)
    assert finding.reason.share == pytest.approx(share, rel=0.02)


@pytest.mark.parametrize("share", [0.8, 1.0, 1.2])
def test_a_joint_that_lags_or_catches_up_is_judged(share: float) -> None:
    """So does one whose reference steps from goal to goal while it moves, or whose velocity alone is known."""
    time = 0.01 * np.arange(1000)
    way = 0.1 * np.clip(time - 2.0, 0.0, 10.0)
    position = rounded(share * 0.1 * np.clip(time - 2.3, 0.0, 10.0))
    goals = np.where(way > 0.0, 0.5 * np.ceil(2.0 * way), 0.0)
    for reference in (way, goals, -goals):
        _, segments, _ = watch(Batch(time=time, position=position, reference_position=reference))
        assert spent(segments, Status.SMOOTH) > 6.0


def test_moves_that_steps_command_are_commanded() -> None:
    """The reference steps to and fro just before the joint sets off; "publish the reference" was no help there."""
    time = 0.002 * np.arange(13000)
    reference, position = np.zeros_like(time), np.zeros_like(time)
    for number in range(20):
        begin, way = 1.2 * (number + 1), 1.0 if number % 2 else -1.0
        reference += way * (time >= begin)
        position += way * 0.5 * (1.0 - np.cos(np.pi * np.clip((time - begin - 0.01) / 0.1, 0.0, 1.0)))
    _, segments, _ = watch(Batch(time=time, position=rounded(position, 3e-4), reference_position=reference))
    assert all(one.caveat is None for one in segments)


@pytest.mark.parametrize("drift", [0.0, 1e-9])
def test_the_rounding_of_a_reference_leaves_no_joint_behind(drift: float) -> None:
    """A joint that never moved has no band yet; it was stuck while its reference moved by 2e-10 rad."""
    time = 0.01 * np.arange(2000)
    jitter = np.cumsum(np.random.default_rng(0).standard_normal(2000)) * 1e-12
    _, segments, _ = watch(
        Batch(time=time, position=np.full(2000, 0.5), reference_position=0.5 + jitter + drift * time)
    )
    assert {one.status for one in segments} <= {Status.AT_REST, Status.NOT_JUDGED}
    assert not any(one.stuck for one in segments)


@pytest.mark.parametrize("days", [8, nightly(24)])
def test_ordinary_days(days: int) -> None:
    """The short form of docs/measure_ordinary_days.py, which has the figures of 200 joints."""
    known, unknown = DayTally(), DayTally()
    for seed in range(days):
        day = ordinary_day(seed)
        known.add(watch_day(day, with_reference=True))
        unknown.add(watch_day(day, with_reference=False))
    assert known.recall > 0.98
    assert unknown.recall > 0.88
    assert known.false <= 0.005 * known.cycles
    assert unknown.false <= 0.005 * unknown.cycles
    assert known.right > 0.9 * known.judged


@examples(12, 30)
@given(st.integers(0, 29), st.floats(0.0, 30.0), st.booleans())
def test_where_a_recording_begins_does_not_matter(seed: int, later: float, with_reference: bool) -> None:
    """Found 2: begun later, what is found a few cycles after the beginning is the same."""
    day = ordinary_day(seed)
    batch = day.watched(with_reference=with_reference)
    whole, _, _ = watch(batch)
    cut = batch.where(batch.time >= later)
    found, _, _ = watch(cut)
    # Without a reference a stretch that was cut may have too few slips left.
    begins = later + 2.0 if with_reference else min([end for _, end in day.stretches if end > later], default=math.inf)
    slips = [slip for slip in day.slips if slip.breakaway - slip.dwell > begins]
    missed = [slip for slip in slips if is_found(slip, whole) and not is_found(slip, found)]
    assert len(missed) <= (0.02 if with_reference else 0.1) * len(slips) + 1.0


@pytest.mark.parametrize("name", [SERVO, "openarm_joint3_tracking", "enslyon_slider_k168_v1100"])
def test_where_a_real_recording_begins_does_not_matter(name: str) -> None:
    """Found 2: the same cycles, begun half a second, a second or two later."""
    batch = recording(name)
    whole, _, _ = watch(batch)
    for later in (0.3, 0.5, 1.0, 2.0):
        begin = float(batch.time[0]) + later
        found, _, _ = watch(batch.where(batch.time >= begin))
        expected = [cycle for cycle in whole if cycle.breakaway - cycle.dwell > begin + 1.0]
        missed = [one for one in expected if not any(abs(one.arrest - other.arrest) < 0.02 for other in found)]
        assert len(missed) <= 0.03 * len(expected)


@pytest.mark.parametrize("name", [SERVO, "openarm_joint3_tracking", "enslyon_slider_k168_v1100"])
def test_a_move_before_a_real_recording_hides_nothing(name: str) -> None:
    """Found 1: a commanded move and a pause before it leave the cycles as they are."""
    batch = recording(name)
    alone, _, _ = watch(batch)
    interval = float(np.median(np.diff(batch.time)))
    time = np.arange(0.0, 6.0, interval)
    share = np.clip((time - 1.0) / 2.0, 0.0, 1.0)
    scale = 3.0 * float(np.ptp(batch.position))
    resolution = float(np.min(np.abs(np.diff(batch.position))[np.diff(batch.position) != 0.0]))
    move = scale * (share**3 * (10.0 - 15.0 * share + 6.0 * share**2) - 1.0)
    offset = 6.0 - float(batch.time[0])
    joined = Batch(
        time=np.concatenate([time, batch.time + offset]),
        position=np.concatenate([batch.position[0] + rounded(move, max(resolution, 1e-7)), batch.position]),
        reference_position=np.concatenate([batch.reference_position[0] + move, batch.reference_position]),
    )
    found, _, _ = watch(joined)
    first = alone[0].arrest
    expected = [cycle for cycle in alone if cycle.breakaway > first]
    missed = [one for one in expected if not any(abs(one.arrest + offset - other.arrest) < 0.02 for other in found)]
    assert len(missed) <= 0.03 * len(expected) + 1


def test_a_servo_that_leads_its_reference_sticks() -> None:
    """Found 2: the load pulls it past its reference, and it sticks all the same."""
    cycles, segments, _ = watch(recording(SERVO))
    assert len(cycles) >= 4
    assert all(cycle.breakaway > 3.9 for cycle in cycles)
    assert spent(segments, Status.STICK_SLIP) > 1.0
    assert spent(segments, Status.STICK_SLIP, 0.0, 3.9) == 0.0
    cycles, segments, _ = watch(recording("bus_servo_pendulum_184014"))
    assert not cycles


def test_a_finger_climbs_down_a_staircase_and_hunts() -> None:
    """Found 3, 4: stops of few samples; then swings about a reference that stands, of which each is a cycle."""
    cycles, segments, _ = watch(recording(FINGER))
    down = [cycle for cycle in cycles if not cycle.hunting]
    swings = [cycle for cycle in cycles if cycle.hunting]
    assert 3 <= len(down) <= 11
    assert all(cycle.breakaway > 3.9 and cycle.arrest < 6.2 and cycle.slip_duration < 0.3 for cycle in down)
    assert 7 <= len(swings) <= 10
    assert all(one.slip_distance * other.slip_distance < 0 for one, other in itertools.pairwise(swings))
    assert spent(segments, Status.STICK_SLIP, 0.0, 3.9) == 0.0
    assert spent(segments, Status.STICK_SLIP, 6.6, 8.3) > 1.5
    assert spent(segments, Status.AT_REST, 8.8, 10.6) > 1.6
    # On the way up it swings without a stop.
    assert spent(segments, Status.AT_RISK, 2.0, 3.5) > 0.2


def test_ripple_is_no_stick_slip() -> None:
    """Found 5: a motor that never stops, and whose speed dips through zero for a millisecond or two."""
    cycles, segments, _ = watch(recording("motor_cogging"))
    assert not cycles
    assert spent(segments, Status.STICK_SLIP) == 0.0


def test_what_lies_in_a_gap_was_not_seen() -> None:
    """Found 6: of a motor only what stands was kept."""
    path = RECORDINGS / "small" / "motor_samples_missing.csv"
    if not path.exists():
        pytest.skip(f"recording {path.name} is not in {RECORDINGS / 'small'} (set STICKSLIP_RECORDINGS)")
    for batch in load_table(path).batches.values():
        cycles, segments, _ = watch(batch)
        assert not cycles
        assert spent(segments, Status.STICK_SLIP) == 0.0
        assert spent(segments, Status.SMOOTH) < 0.05 * (batch.time[-1] - batch.time[0])
        assert spent(segments, Status.NOT_JUDGED) > 0.65 * (batch.time[-1] - batch.time[0])


@pytest.mark.parametrize("name", ["seven_axis_arm_at_rest", "winches_standing", "pendulum_flicker_at_rest"])
def test_a_joint_that_stands_is_at_rest(name: str) -> None:
    """Found 7: flicker of a float's last digits, of noise now and then, of one count."""
    path = RECORDINGS / "small" / f"{name}.csv"
    if not path.exists():
        pytest.skip(f"recording {path.name} is not in {RECORDINGS / 'small'} (set STICKSLIP_RECORDINGS)")
    for batch in load_table(path).batches.values():
        _, segments, _ = watch(batch)
        # Of the first samples, and of those after a gap, nothing is known.
        assert spent(segments, Status.AT_REST) > 0.9 * (batch.time[-1] - batch.time[0])
        assert {one.status for one in segments} <= {Status.AT_REST, Status.NOT_JUDGED}


def stairs(rate: float, *, step: float = 6.6e-3, rest: float = 0.6, slip: float = 0.5, duration: float = 60.0) -> Batch:
    """Half cosines of equal size with equal pauses, positions alone."""
    time = np.arange(0.013, duration, 1.0 / rate)
    within, number = time % (rest + slip), np.floor(time / (rest + slip))
    risen = np.where(within < rest, 0.0, 0.5 * (1.0 - np.cos(math.pi * (within - rest) / slip)))
    return Batch(time=time, position=rounded(step * (number + risen)))


@pytest.mark.parametrize("rate", [2.3, 5.0, 7.1, 10.0, 17.0])
def test_what_is_sampled_too_slowly_is_not_called_smooth(rate: float) -> None:
    """Found 8: plain stairs at 5 Hz."""
    _, segments, monitor = watch(stairs(rate))
    assert spent(segments, Status.SMOOTH) == 0.0
    reason = monitor.why_not_judged()
    if isinstance(reason, SampledTooSlowly):
        assert reason.needed == pytest.approx(20.0)
        assert reason.rate == pytest.approx(rate, rel=0.05)
    else:
        assert reason == StopsAndGoes()
        assert rate > 9.0
    _, segments, _ = watch(stairs(50.0))
    assert spent(segments, Status.STICK_SLIP) > 50.0


def test_straight_ramps_are_no_slips() -> None:
    """Found 9: equal steps with corners and equal pauses, without a reference: no spring makes them."""
    time = np.arange(0.0, 60.0, 0.01)
    position = 0.14 * (np.floor(time / 1.1) + np.clip(time % 1.1 / 0.55 - 1.0, 0.0, 1.0))
    noisy = position + 1e-4 * np.random.default_rng(1).standard_normal(len(time))
    for places in (position, noisy):
        cycles, segments, monitor = watch(Batch(time=time, position=rounded(places, 1e-4)))
        assert not cycles
        assert spent(segments, Status.STICK_SLIP) == 0.0
        assert monitor.why_not_judged() is not None


def test_a_long_slide_is_no_slip() -> None:
    """Found 10: a joint that slides along with a noisy reference, and stops where it is told to."""
    time = np.arange(0.0, 30.0, 0.02)
    generator = np.random.default_rng(2)
    velocity = np.where((time % 10.0 > 1.0) & (time % 10.0 < 3.6), 0.13, 0.0) + np.where(time % 10.0 > 6.0, 0.3, 0.0)
    reference = 0.02 * np.cumsum(velocity)
    position = np.interp(time - 0.05, time, reference) + 3e-4 * generator.standard_normal(len(time))
    jittered = time + 2e-3 * generator.uniform(-1.0, 1.0, len(time))
    _, segments, _ = watch(Batch(time=jittered, position=rounded(position, 1e-4), reference_position=reference))
    assert spent(segments, Status.STICK_SLIP) == 0.0


@pytest.mark.parametrize("amplitude", [0.19, 0.002])
def test_oscillation_about_a_command_that_stands_is_hunting(amplitude: float) -> None:
    """Found 11: a swing every 1.09 s, after a move of a radian; told by the third swing."""
    time = np.arange(0.0, 60.0, 0.01)
    share = np.clip((time - 1.0) / 2.0, 0.0, 1.0)
    reference = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    swing = amplitude * np.where(time > 5.0, np.sin(math.pi * (time - 5.0) / 1.09), 0.0)
    cycles, segments, monitor = watch(
        Batch(time=time, position=rounded(reference + swing), reference_position=reference)
    )
    assert all(cycle.hunting for cycle in cycles)
    assert cycles[0].breakaway < 5.0 + 2.5 * 1.09
    assert len(cycles) > 40
    assert spent(segments, Status.STICK_SLIP, 5.0 + 3.5 * 1.09, 58.0) > 0.97 * (53.0 - 3.5 * 1.09)
    assert monitor.finding() == Finding(status=Status.STICK_SLIP, reason=Hunting())


def test_free_oscillation_that_dies_out_is_no_hunting() -> None:
    """Found 11, the other way round: a joint with little damping rings after a move, and settles."""
    time = np.arange(0.0, 40.0, 0.005)
    since = time % 10.0
    reference = np.floor(time / 10.0)
    position = reference - np.exp(-0.5 * since) * np.cos(12.0 * since)
    cycles, segments, _ = watch(Batch(time=time, position=rounded(position), reference_position=reference))
    assert not cycles
    assert spent(segments, Status.STICK_SLIP) == 0.0


@pytest.mark.parametrize("rate", [111, 1000])
@pytest.mark.parametrize(
    ("load", "spring", "stiffness", "damping", "damping_of_load"),
    [(0.73, 59.0, 202.0, 2.4, 1.1), (0.31, 291.0, 1947.0, 4.5, 2.4), (1.07, 72.0, 196.0, 0.56, 1.1)],
)
def test_two_masses_that_ring_after_a_step_do_not_hunt(
    load: float, spring: float, stiffness: float, damping: float, damping_of_load: float, rate: int
) -> None:
    """Their two oscillations beat: three swings keep 95 % of their size, as on a teaching rig of carts and springs."""
    motion = np.zeros((4, 4))
    motion[:2, 2:] = np.eye(2)
    motion[2] = -(stiffness + spring), spring, -damping, 0.0
    motion[3] = spring / load, -spring / load, 0.0, -damping_of_load / load
    modes, shapes = np.linalg.eig(motion)
    amplitudes = np.linalg.solve(shapes, np.array([1.0, 1.0, 0.0, 0.0]))
    time = np.arange(0.0, 40.0, 1.0 / rate)
    ringing = np.real((shapes[0] * amplitudes) @ np.exp(np.outer(modes, time % 8.0)))
    side = np.where(time % 16.0 < 8.0, 1.0, -1.0)
    reference = 500.0 * side
    cycles, segments, _ = watch(
        Batch(time=time, position=rounded(reference - 1000.0 * side * ringing, 1.0), reference_position=reference)
    )
    assert not cycles
    assert spent(segments, Status.STICK_SLIP) == 0.0


def test_slips_against_the_reference_are_found(puma: Joint) -> None:
    """Found 12: integral action pulls the joint past its reference, and back again."""
    time = 1e-3 * np.arange(60_000)
    velocity = np.where(time > 1.0, 0.0015, 0.0)
    reference = 1e-3 * np.cumsum(velocity)
    found = simulate(puma, Gains(stiffness=630.0, damping=10.0, integral=1500.0), reference, velocity)
    events = found.events
    slips = [
        (one.time, other.time, other.position - one.position) for one, other in itertools.pairwise(events)
        if one.kind is EventKind.BREAKAWAY and one.time > 2.0 and abs(other.position - one.position) > 12 * COUNT
    ]  # fmt: skip
    against = [slip for slip in slips if slip[2] < 0.0]
    assert len(slips) > 8
    cycles, segments, _ = watch(Batch(time=found.time, position=rounded(found.position), reference_position=reference))
    missed = [slip for slip in slips if not any(abs(slip[1] - cycle.arrest) < 0.05 for cycle in cycles)]
    assert len(missed) <= 0.1 * len(slips)
    assert all(any(abs(slip[1] - cycle.arrest) < 0.05 for cycle in cycles) for slip in against)
    assert spent(segments, Status.STICK_SLIP, slips[2][0], slips[-1][1]) > 0.9 * (slips[-1][1] - slips[2][0])


@pytest.mark.parametrize("missing", [math.nan, math.inf])
@pytest.mark.parametrize("share", [0.01, 0.1, 0.3])
def test_references_that_are_missing_now_and_then_hide_nothing(puma: Joint, share: float, missing: float) -> None:
    """One sample in a hundred without a reference hid half of the slips."""
    batch, slips = after_a_move(puma, 0.3, with_reference=True)
    lost = np.random.default_rng(3).random(len(batch)) < share
    cycles, _, _ = watch(replace(batch, reference_position=np.where(lost, missing, batch.reference_position)))
    assert len(cycles) >= len(slips) - 2


def test_one_wild_reading_blinds_nobody(puma: Joint) -> None:
    """A billion radians once, and the joint was called smooth from then on."""
    batch, slips = after_a_move(puma, 0.3, with_reference=True)
    batch.position[8_000] += 1e9
    cycles, segments, _ = watch(batch)
    assert len(cycles) >= len(slips) - 2
    assert spent(segments, Status.SMOOTH, 9.0) == 0.0


@pytest.mark.parametrize("contact", ["lugre", "elasto_plastic"])
@pytest.mark.parametrize("rate", [100, 1000])
def test_creep_hides_no_slip_from_a_fine_encoder(puma: Joint, rate: int, contact: str) -> None:
    """Positions as a simulation has them, to the last digit: the joint creeps at every sample, and slips."""
    friction = replace(puma.friction, presliding_stiffness=63_000.0, presliding_damping=400.0, contact=contact)
    velocity = np.where(1e-3 * np.arange(40_000) > 1.0, 0.0058, 0.0)
    reference = 1e-3 * np.cumsum(velocity)
    found = simulate(replace(puma, friction=friction), Gains(stiffness=630.0), reference, velocity)
    kept = slice(0, None, 1000 // rate)
    cycles, segments, _ = watch(
        Batch(time=found.time[kept], position=found.position[kept], reference_position=reference[kept])
    )
    way = float(np.ptp(found.position)) / float(np.median([cycle.slip_distance for cycle in cycles]))
    assert len(cycles) > 20
    assert len(cycles) == pytest.approx(way, abs=2.0)
    assert spent(segments, Status.STICK_SLIP, cycles[1].arrest, cycles[-1].arrest) > 0.99 * (
        cycles[-1].arrest - cycles[1].arrest
    )


def ramp_of_half_cosines(
    rate: float, *, period: float, slip: float, distance: float, creep: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times, and places in 20 slips of half a cosine; between them the joint creeps at this share of the mean speed."""
    time = np.arange(0.0, 22.0 * period, 1.0 / rate)
    number, phase = np.divmod(time, period)
    share = 0.5 - 0.5 * np.cos(math.pi * np.clip((phase - period + slip) / slip, 0.0, 1.0))
    return time, distance * ((1.0 - creep) * (number + share) + creep * time / period)


@pytest.mark.parametrize("count", [3e-4, 1e-4, 2e-5, 2e-6, 2e-7])
@pytest.mark.parametrize("creep", [0.05, 0.1, 0.15, 0.2])
def test_the_same_creep_is_rest_to_every_encoder(creep: float, count: float) -> None:
    """Creep of 3 % of the slip's peak and more was none to a fine encoder: `at_risk`, with one cycle of 60."""
    time, way = ramp_of_half_cosines(100.0, period=0.6, slip=0.3, distance=0.012, creep=creep)
    cycles, _, _ = watch(Batch(time=time, position=rounded(way, count), reference_position=0.02 * time))
    assert len(cycles) >= 19


@pytest.mark.parametrize("rate", [30, 100, 500])
@pytest.mark.parametrize("count", [3e-4, 2e-5, 2e-7])
@pytest.mark.parametrize("dip", [0.8, 0.9])
def test_a_dip_is_no_rest_to_any_encoder(dip: float, count: float, rate: int) -> None:
    """A ripple of the speed as deep as the creep that is rest."""
    time = np.arange(0.0, 30.0, 1.0 / rate)
    way = 0.02 * time - dip * 0.02 * np.sin(2.0 * math.pi * time / 0.6) * 0.6 / (2.0 * math.pi)
    for reference in (0.02 * time, np.zeros(0)):
        cycles, segments, _ = watch(Batch(time=time, position=rounded(way, count), reference_position=reference))
        assert cycles == []
        assert spent(segments, Status.STICK_SLIP) == 0.0


@pytest.mark.parametrize("rate", [30, 100, 1000])
@pytest.mark.parametrize("begin", [0.0, 0.1, 0.27])
def test_oscillation_about_zero_from_the_first_sample_is_hunting(rate: int, begin: float) -> None:
    """Found 11: the reference is zero throughout, and the recording begins amid a swing."""
    time = np.arange(0.0, 20.0, 1.0 / rate)
    position = rounded(0.19 * np.sin(2.0 * math.pi * (time + begin) / 1.09), 1.5e-3)
    cycles, segments, _ = watch(Batch(time=time, position=position, reference_position=np.zeros(len(time))))
    assert len(cycles) >= 33
    assert spent(segments, Status.STICK_SLIP, 3.2) > 0.98 * 16.8


def test_hunting_about_a_reference_that_goes_on(puma: Joint) -> None:
    """Integral action on a slow ramp: to and fro, farther one way than the other; each swing is one cycle."""
    time = np.arange(0.0, 30.0, 0.002)
    reference = 0.003 * time
    swing = np.tanh(4.0 * np.sin(2.0 * math.pi * time / 2.3)) / math.tanh(4.0)
    cycles, segments, monitor = watch(
        Batch(time=time, position=rounded(reference + 0.015 * swing, 1e-4), reference_position=reference)
    )
    assert len(cycles) >= 22
    assert all(cycle.reference_speed == pytest.approx(0.003, rel=0.1) for cycle in cycles if cycle.hunting)
    assert all(one.arrest <= other.breakaway for one, other in itertools.pairwise(cycles))
    assert spent(segments, Status.STICK_SLIP, 5.0, 29.0) > 0.97 * 24.0
    assert monitor.finding() == Finding(status=Status.STICK_SLIP, reason=Hunting())


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9, 0.97])
@pytest.mark.parametrize("rate", [100, 1000])
def test_a_reading_that_wanders_does_not_hunt(rate: int, correlation: float) -> None:
    """Noise of three counts, each reading like the one before, about a reference that stands."""
    from scipy.signal import lfilter  # takes a second and a half of a core, in each process that collects tests

    generator = np.random.default_rng(11)
    steps = math.sqrt(1.0 - correlation**2) * generator.standard_normal(40 * rate)
    noise = lfilter([1.0], [1.0, -correlation], steps)
    time = np.arange(len(noise)) / rate
    cycles, segments, _ = watch(
        Batch(time=time, position=rounded(3e-5 * noise, 1e-5), reference_position=np.zeros(len(time)))
    )
    assert not cycles
    assert {one.status for one in segments} <= {Status.AT_REST, Status.NOT_JUDGED}


@pytest.mark.parametrize("rate", [50, 500])
def test_a_joint_that_another_pushes_to_and_fro_short_of_its_reference_does_not_hunt(rate: int) -> None:
    """An arm's elbow hangs 0.024 rad below its command; whenever the next joint moves, it comes up by 0.021 rad."""
    time = np.arange(0.0, 60.0, 1.0 / rate)
    within = time % 5.7
    pushed = np.clip(within - 3.0, 0.0, 0.7) / 0.7 - np.clip(within - 5.0, 0.0, 0.7) / 0.7
    position = 0.5 + 0.024 - 0.021 * 0.5 * (1.0 - np.cos(math.pi * pushed))
    cycles, segments, _ = watch(
        Batch(time=time, position=rounded(position, 1.5e-3), reference_position=np.full(len(time), 0.5))
    )
    assert not cycles
    assert spent(segments, Status.STICK_SLIP) == 0.0


def test_a_joint_that_is_swung_by_its_reference_does_not_hunt() -> None:
    """A joint with little damping, under a sine near its resonance and under a square wave, and without friction."""
    from scipy.signal import lsim, lti

    time = np.arange(0.0, 40.0, 0.01)
    loop = lti([100.0], [1.0, 4.0, 100.0])
    for reference in (np.sin(9.0 * time), 0.05 * time + np.sin(11.0 * time), np.sign(np.sin(2.0 * time))):
        _, position, _ = lsim(loop, 0.1 * reference, time)
        cycles, segments, _ = watch(
            Batch(time=time, position=rounded(position, 1e-4), reference_position=0.1 * reference)
        )
        assert not any(cycle.hunting for cycle in cycles)
        assert spent(segments, Status.STICK_SLIP) == 0.0


def test_red_ends_with_the_next_move(puma: Joint) -> None:
    """A commanded move after a slow stretch is not coloured by it."""
    time = 1e-3 * np.arange(40_000)
    velocity = np.where((time > 1.0) & (time < 31.0), 0.0058, np.where((time > 33.0) & (time < 37.0), 0.25, 0.0))
    reference = 1e-3 * np.cumsum(velocity)
    found = simulate(puma, Gains(stiffness=630.0, damping=20.0), reference, velocity)
    _, segments, _ = watch(Batch(time=found.time, position=rounded(found.position), reference_position=reference))
    assert spent(segments, Status.STICK_SLIP, 6.0, 30.0) > 23.5
    assert spent(segments, Status.STICK_SLIP, 33.0) < 0.2


def test_steps_that_differ_are_no_slips() -> None:
    """Smooth steps one way without a reference, steps and pauses as different as a person makes them."""
    red = 0.0
    for seed in range(10):
        generator = np.random.default_rng(seed)
        pieces, place = [np.zeros(100)], 0.0
        for _ in range(40):
            way, count = 0.1 * math.exp(0.6 * generator.normal()), int(50 * math.exp(0.3 * generator.normal()))
            share = np.arange(1, count + 1) / count
            pieces += [
                place + way * share**3 * (10.0 - 15.0 * share + 6.0 * share**2),
                np.full(int(50 * math.exp(0.6 * generator.normal())), place + way),
            ]
            place += way
        position = np.concatenate(pieces)
        time = 0.01 * np.arange(len(position))
        _, segments, _ = watch(Batch(time=time, position=rounded(position, 1e-4)))
        red += spent(segments, Status.STICK_SLIP) / time[-1] / 10
    assert red < 0.3


def test_speed_that_falls_again_and_again_is_at_risk() -> None:
    """Found 8: a joint that swings at 11 Hz about its motion without a stop; slow and small changes are smooth."""
    time = np.arange(0.0, 20.0, 0.01)
    for ripple, frequency, status in (
        (0.45, 11.0, Status.AT_RISK),
        (0.1, 11.0, Status.SMOOTH),
        (0.45, 0.3, Status.SMOOTH),
    ):
        omega = 2.0 * math.pi * frequency
        speed = 0.4 * np.clip(time, 0.0, 1.0)
        position, reference = (
            np.cumsum(0.01 * speed * (1.0 + share * np.sin(omega * time))) for share in (ripple, 0.0)
        )
        _, segments, monitor = watch(Batch(time=time, position=rounded(position, 1e-4), reference_position=reference))
        assert spent(segments, status) > 17.5
        if status is Status.AT_RISK:
            assert isinstance(monitor.finding().reason, SpeedFalls)


@pytest.mark.parametrize("size", [1, 7, 333])
def test_batches_make_no_difference_to_a_day(size: int) -> None:
    """Live and recorded alike: cycles and segments to the last digit."""
    batch = ordinary_day(3).batch
    batch = batch.where(slice(0, 12_000))
    whole, segments, _ = watch(batch)
    monitor = JointMonitor(segments_kept=None)
    pieces = [cycle for i in range(0, len(batch), size) for cycle in monitor.process(batch.where(slice(i, i + size)))]
    # Efforts are unknown, and NaN is equal to nothing.
    assert repr(pieces + monitor.finish()) == repr(whole)
    assert list(monitor.segments) == segments


def test_a_reference_that_is_heard_later_than_the_joint_makes_no_cycle() -> None:
    """A joint that follows its reference and turns; of the first second only positions came."""
    time = np.arange(0.0, 14.0, 0.003)
    reference = 0.012 * (7.0 - np.abs(time - 7.0))
    position = np.interp(time - 0.03, time, reference) - 2e-3 * np.sign(7.03 - time) * (np.abs(time - 7.03) > 0.17)
    turned = np.abs(time - 7.03) <= 0.17
    position[turned] = position[~turned][np.searchsorted(time[~turned], 6.86) - 1]
    heard = np.where(time < 1.0, np.nan, reference)
    cycles, segments, _ = watch(Batch(time=time, position=rounded(position), reference_position=heard))
    assert not cycles
    assert spent(segments, Status.STICK_SLIP) == 0.0


@pytest.mark.parametrize("count", [nightly(1e-7), COUNT, nightly(4e-4)])
def test_a_dropout_does_not_make_it_blind(puma: Joint, count: float) -> None:
    """After one dropout of 0.1 to 0.6 s in a slip, as of a network, no cycle was found any more.

    The first large step was taken for the time in which the sensor renews its reading. The recording may begin right
    before the dropout, as after a cable that is mended; and dropouts may go on and on.
    """
    whole = record(puma, Gains(stiffness=630.0), 0.0058, duration=30.0, resolution=count).batch
    period = 1.13
    for number, phase in enumerate(np.arange(0.0, period, 0.16)):
        lasts, begin = (0.1, 0.3, 0.55)[number % 3], 10.0 + phase
        dropout = (whole.time > begin) & (whole.time < begin + lasts)
        for first in (3.0, begin - 0.05):
            cycles, _, monitor = watch(whole.where(~dropout & (whole.time > first)))
            assert monitor.finding().status is Status.STICK_SLIP
            assert len([cycle for cycle in cycles if cycle.breakaway > begin + lasts + period]) >= 14
    rng = np.random.default_rng(35)
    lost = np.zeros(len(whole), dtype=bool)
    for begin in np.cumsum(rng.exponential(1.5, 20)):
        lost |= (whole.time > begin) & (whole.time < begin + rng.uniform(0.05, 0.4))
    cycles, segments, _ = watch(whole.where(~lost))
    assert len(cycles) > 18
    assert spent(segments, Status.STICK_SLIP) > 22.0
    assert spent(segments, Status.SMOOTH) + spent(segments, Status.AT_RISK) < 1.0


@pytest.mark.parametrize("rate", [10.0, 30.0, 50.0, 200.0])
def test_a_joint_that_never_moves_is_at_rest_at_any_rate(rate: float) -> None:
    """The samples that are waited for, before anything can be measured, are no motion: at 10 Hz they take 3 s."""
    time = np.arange(0.0, 40.0, 1.0 / rate)
    _, segments, _ = watch(Batch(time=time, position=np.full(len(time), 0.3)))
    assert [one.status for one in segments] == [Status.AT_REST]
    assert overall_status(segments) is Status.AT_REST


def short_slow_moves(rate: float, stand: float, slips: int) -> tuple[Batch, list[float]]:
    """Moves of 0.1 rad in 4 s, with a few slips each, and commanded stands between them; when the moves begin [s]."""
    time = np.arange(0.0, 4.0 * (4.0 + stand), 1.0 / rate)
    number, within = np.floor(time / (4.0 + stand)), time % (4.0 + stand) - stand
    reference = 0.1 * (number + np.clip(within / 4.0, 0.0, 1.0))
    steps = slips / 4.0 * np.clip(within - 0.2, 0.0, None)
    risen = np.floor(steps) + 0.5 * (1.0 - np.cos(math.pi * np.clip((steps % 1.0 - 0.8) / 0.2, 0.0, 1.0)))
    position = 0.1 * (number + np.clip(risen, 0.0, slips) / slips)
    begins = [float(stand + one * (4.0 + stand)) for one in range(4)]
    return Batch(time=time, position=rounded(position, 1.5e-3), reference_position=reference), begins


@pytest.mark.parametrize("rate", [50.0, 500.0])
@pytest.mark.parametrize("slips", [3, 6])
def test_a_commanded_stand_between_two_slow_moves_is_no_stick_slip(rate: float, slips: int) -> None:
    """An arm that sticks and slips in each of its short moves stands for 20 s between them, as it was told to."""
    batch, begins = short_slow_moves(rate, 20.0, slips)
    cycles, segments, _ = watch(batch)
    assert len(cycles) >= 3 * slips
    for begin in begins:
        assert spent(segments, Status.STICK_SLIP, begin, begin + 4.0) > 1.0
        assert spent(segments, Status.STICK_SLIP, begin - 16.0, begin) == 0.0


def in_steps(time: np.ndarray, speed: float, rate: float) -> np.ndarray:
    """A reference that goes on evenly, but comes so many times a second only."""
    return speed * np.floor(time * rate + 1e-9) / rate


@pytest.mark.parametrize("slip", [0.08, 0.4], ids=["a slip within a step", "a slip over several steps"])
def test_a_joint_that_creeps_at_each_step_of_its_reference_sticks(slip: float) -> None:
    """Its contact yields by 0.4 % of a slip, ten times a second, which a fine encoder sees; it was `not_judged`."""
    time, period, distance, count = np.arange(0.0, 14.0, 0.004), 0.7, 0.01, 2e-7
    number, phase = np.divmod(time - 1.0, period)
    share = np.clip((phase - (period - slip)) / slip, 0.0, 1.0)
    way = distance * (np.maximum(number, -1.0) + 0.5 * (1.0 - np.cos(math.pi * share)))
    since = np.mod(time, 0.1)
    creep = 4e-5 * (np.floor(time * 10.0 + 1e-9) + 1.0 - np.exp(-since / 0.01))
    resting = (share == 0.0) | (number < 0.0)
    positions = rounded(np.where(number < 0.0, 0.0, way) + np.cumsum(np.diff(creep, prepend=0.0) * resting), count)
    reference = in_steps(time, distance / period, 10.0)
    cycles, segments, _ = watch(Batch(time=time, position=positions, reference_position=reference))
    assert len(cycles) >= 14
    assert np.median([abs(cycle.slip_distance) for cycle in cycles]) == pytest.approx(distance, rel=0.1)
    assert spent(segments, Status.STICK_SLIP, 5.0, 13.0) > 7.5


def test_a_reference_in_steps_does_not_excuse_a_speed_that_falls() -> None:
    """The joint nearly stops again and again; as the reference stood between its steps this was `smooth`."""
    time = np.arange(0.0, 14.0, 0.008)
    positions = rounded(0.002 * (time + 0.95 * np.sin(10.0 * time) / 10.0), 5e-6)
    reference = in_steps(time, 0.002, 10.0) + 0.001
    _, segments, _ = watch(Batch(time=time, position=positions, reference_position=reference))
    assert spent(segments, Status.SMOOTH) < 0.05 * time[-1]
    # A joint that goes on evenly behind the same reference is smooth.
    _, segments, _ = watch(Batch(time=time, position=rounded(0.002 * time, 5e-6), reference_position=reference))
    assert spent(segments, Status.SMOOTH) > 0.8 * time[-1]


@pytest.mark.parametrize("samples", [7.3, 9.1])
def test_a_few_samples_of_each_cycle_show_that_a_joint_nearly_stops(samples: float) -> None:
    """At 20 Hz there were too few cycles in the motion that was searched for dips: it was `smooth` throughout."""
    time = np.arange(0.0, 30.0, 0.05)
    rhythm = 2.0 * math.pi * 20.0 / samples
    _, segments, _ = watch(Batch(time=time, position=rounded(0.002 * (time + np.sin(rhythm * time) / rhythm), 1e-6)))
    assert spent(segments, Status.SMOOTH) < 0.1 * time[-1]
    _, segments, _ = watch(Batch(time=time, position=rounded(0.002 * time, 1e-6)))
    assert spent(segments, Status.SMOOTH) > 0.8 * time[-1]


def test_a_joint_that_stops_every_25_counts_is_not_smooth_in_between() -> None:
    """How deep a dip seems depends on where the counts fall: statuses changed to and fro, 12 s of 20 `smooth`."""
    time, count, smooth = np.arange(0.0, 20.0, 0.002), 4e-4, 0.0
    for seed in range(3, 8):
        noise = 0.3 * count * np.random.default_rng(seed).standard_normal(len(time))
        positions = rounded(0.02 * (time + 0.97 * np.sin(4.0 * math.pi * time) / (4.0 * math.pi)) + noise, count)
        _, segments, _ = watch(Batch(time=time, position=positions))
        smooth += spent(segments, Status.SMOOTH)
    assert smooth < 0.15 * 5 * time[-1]


def test_a_stop_too_brief_for_a_rest_is_a_deep_dip() -> None:
    """Each second the joint nearly stops and creeps on; in between, it was `smooth` for a quarter of the time."""
    time, count = np.arange(0.0, 20.0, 0.005), 3e-4
    phase = np.mod(time, 1.0)
    speed = np.exp(4.0 * phase) * (1.0 - phase**8)
    positions = np.cumsum(speed) / speed.sum() * 40.0 * count * time[-1]
    noise = 0.3 * count * np.random.default_rng(5).standard_normal(len(time))
    reference = 40.0 * count * time + 80.0 * count
    batch = Batch(time=time, position=rounded(positions + noise, count), reference_position=reference)
    _, segments, _ = watch(batch)
    assert spent(segments, Status.SMOOTH) < 0.5


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_a_stop_out_of_a_fast_motion_leaves_no_joint_behind(rate: float) -> None:
    """The joint stops with its reference; it was stuck for 0.9 s by the way the reference had gone just before."""
    stuck = []
    for phase in np.linspace(0.0, 0.05, 11):
        time = np.arange(0.0, 8.0, 1.0 / rate)
        way = -0.5 * np.clip(time - 2.0 - phase, 0.0, 1.0) - 0.01 * np.clip(time - 4.0, 0.0, 4.0)
        lagging = np.interp(time - 0.003, time, way)
        _, segments, _ = watch(Batch(time=time, position=rounded(lagging, 1e-4), reference_position=way))
        stuck += [one.stuck for one in segments if one.stuck]
    assert not stuck


def test_the_way_of_a_reference_counts_from_the_stand_on() -> None:
    """The joint stops out of a fast motion, and its reference goes on slowly: that slow way alone leaves it behind."""
    for phase in np.linspace(0.0, 0.05, 6):
        time = np.arange(0.0, 7.0, 0.005)
        way = 0.5 * np.clip(time - 2.0 - phase, 0.0, 1.0) + 0.02 * np.clip(time - 3.0 - phase, 0.0, 4.0)
        position = rounded(np.minimum(np.interp(time - 0.003, time, way), 0.5), 1e-4)
        _, segments, _ = watch(Batch(time=time, position=position, reference_position=way))
        stuck = sum(one.stuck for one in segments)
        assert stuck > 2.5
        assert sum(one.travel for one in segments) == pytest.approx(0.02 * stuck, rel=0.02)
