# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is said of a whole recording: status, worst status, share of stick-slip, transients; in every output."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support_bags import JOINT_STATE, KNOWN, WITHOUT_LEARNING, joint_state, sticking, write_mcap

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.fleet import Answers, BagTask
from stickslip_ros.analysis.fleet_joints import stick_slip_share as share_of_rows
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.judgement import (
    caveat,
    moving_time,
    overall_status,
    stick_slip_share,
    stuck,
    transient,
    worst_status,
)
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.cli.main import main
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Segment, Status, StopsAndGoes, Stuck
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output.diagnosis import joint_diagnostic
from stickslip_ros.output.published import Findings
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

STICKS, RISK, SMOOTH = Status.STICK_SLIP, Status.AT_RISK, Status.SMOOTH
REST, NOT_JUDGED, UNKNOWN = Status.AT_REST, Status.NOT_JUDGED, Status.UNKNOWN


def stretches(*parts: tuple[Status, float]) -> list[Segment]:
    """Segments one after the other, of a status and a duration [s] each, from 0 s on."""
    segments: list[Segment] = []
    for status, duration in parts:
        start = segments[-1].end if segments else 0.0
        segments.append(Segment(start=start, end=start + duration, status=status, velocity=0.01))
    return segments


def cycle(rest: float, breakaway: float, arrest: float, *, hunting: bool = False) -> Cycle:
    """A cycle whose rest begins at a time [s]."""
    return Cycle(
        breakaway=breakaway, arrest=arrest, dwell=breakaway - rest, slip_distance=0.01, position=0.0, effort=math.nan,
        hunting=hunting,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("parts", "status", "worst"),
    [
        ([(SMOOTH, 212.0), (STICKS, 3.0)], SMOOTH, STICKS),
        ([(STICKS, 3.0), (SMOOTH, 2.0)], STICKS, STICKS),
        ([(STICKS, 2.0), (SMOOTH, 2.0)], STICKS, STICKS),
        ([(RISK, 2.0), (SMOOTH, 2.0), (REST, 90.0)], RISK, RISK),
        ([(RISK, 2.0), (STICKS, 2.5), (SMOOTH, 2.0), (SMOOTH, 2.0)], SMOOTH, STICKS),
        # What was judged speaks, if it is a fifth of the moving time, however long the rest.
        ([(NOT_JUDGED, 50.0), (SMOOTH, 2.0), (REST, 90.0)], NOT_JUDGED, SMOOTH),
        ([(NOT_JUDGED, 7.0), (SMOOTH, 2.0), (REST, 90.0)], SMOOTH, SMOOTH),
        ([(NOT_JUDGED, 0.3), (REST, 9.0)], REST, REST),
        ([(NOT_JUDGED, 5.0), (REST, 90.0)], NOT_JUDGED, NOT_JUDGED),
        ([(REST, 90.0)], REST, REST),
        ([(UNKNOWN, 3.0)], UNKNOWN, UNKNOWN),
        ([], UNKNOWN, UNKNOWN),
        # Stick-slip however short; anything else from half a second on.
        ([(SMOOTH, 60.0), (STICKS, 0.3)], SMOOTH, STICKS),
        ([(SMOOTH, 60.0), (RISK, 0.3)], SMOOTH, SMOOTH),
        ([(NOT_JUDGED, 0.4), (RISK, 0.3)], RISK, RISK),
        # Never milder than the status, though that has come piece by piece.
        ([(RISK, 0.3), (REST, 2.0), (NOT_JUDGED, 0.6), (RISK, 0.3)], RISK, RISK),
        ([(NOT_JUDGED, 0.3), (REST, 9.0), (NOT_JUDGED, 0.3)], NOT_JUDGED, NOT_JUDGED),
    ],
)
def test_most_of_the_time_and_the_worst(parts: list[tuple[Status, float]], status: Status, worst: Status) -> None:
    """Issue 17, item 6: the status is what held for most of the judged time; the worst is beside it."""
    segments = stretches(*parts)
    assert overall_status(segments) is status
    assert worst_status(segments) is worst


def test_stuck_is_who_stands_while_the_reference_goes_on() -> None:
    """Smooth for a while and then stuck: no all-clear; a pause that is told, a start and a turn are nothing of it."""

    def stands(stuck: float, before: float = 0.01, after: float = 0.01) -> list[Segment]:
        parts = stretches((SMOOTH, 10.0), (REST, 8.0), (SMOOTH, 5.0))
        return [
            replace(parts[0], velocity=before),
            replace(parts[1], velocity=0.0, stuck=stuck, travel=0.02 * stuck),
            replace(parts[2], velocity=after),
        ]

    assert stuck(stands(0.0)) is None
    assert stuck(stands(0.3)) is None
    assert stuck(stands(8.0, after=-0.01)) is None
    assert stuck(stands(8.0)) == Stuck(duration=8.0, travel=0.16)
    assert overall_status(stands(8.0)) is SMOOTH
    jammed = [*stands(8.0)[:2], replace(stands(8.0)[1], start=18.0, end=30.0, stuck=12.0)]
    assert overall_status(jammed) is NOT_JUDGED


@pytest.mark.parametrize(("stops", "status"), [((1.0, 1.15, 3.6), SMOOTH), ((0.9, 1.1, 2.9, 3.6), NOT_JUDGED)])
def test_stops_too_short_to_be_stretches_bear_on_the_whole(stops: tuple[float, ...], status: Status) -> None:
    """Of stops of 20 ms, without a reference, it was "stops and goes" live, and "nothing has to be done" in the end."""
    times = np.arange(0.0, 4.0, 0.001)
    speed = np.full(len(times), 0.5)
    for stop in stops:
        speed *= np.clip(np.abs(times - stop - 0.02) / 0.01 - 1.0, 0.0, 1.0)
    monitor = JointMonitor(segments_kept=None)
    monitor.process(Batch(time=times, position=1e-4 * np.round(10.0 * np.cumsum(speed))))
    monitor.finish()
    assert overall_status(monitor.segments) is status
    why, lasted = caveat(monitor.segments)
    assert why == StopsAndGoes()
    assert lasted > 1.0


def test_flicker_tells_no_turn() -> None:
    """What a joint did before a stand and after it is told by motion, not by the nearest flicker."""

    def stands(*velocities: float) -> list[Segment]:
        parts = stretches((SMOOTH, 10.0), (NOT_JUDGED, 0.1), (REST, 8.0), (NOT_JUDGED, 0.1), (SMOOTH, 5.0))
        parts = [replace(one, velocity=velocity) for one, velocity in zip(parts, velocities, strict=True)]
        return [*parts[:2], replace(parts[2], stuck=8.0, travel=0.16), *parts[3:]]

    assert stuck(stands(0.01, -0.001, 0.0, 0.001, 0.01), band=0.001) == Stuck(duration=8.0, travel=0.16)
    turning = stands(0.01, 0.0, 0.0, 0.001, -0.01)
    assert stuck(turning, band=0.001) is None
    # A joint that fell while its reference rose, and stands until that is set back and comes to it.
    assert stuck([replace(turning[0], led=0.2), *turning[1:]], band=0.001) is None
    assert stuck([replace(turning[0], led=-0.2), *turning[1:]], band=0.001) == Stuck(duration=8.0, travel=0.16)


@pytest.mark.parametrize(("limited", "status"), [(16.0, "not_judged"), (6.0, "smooth")])
def test_a_joint_that_does_not_go_with_its_reference_is_told(
    limited: float, status: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At a limit of its speed it is left behind; before and after it goes with its reference, which is no all-clear."""
    messages = []
    for time in [0.01 * number for number in range(2400)]:
        reference = 0.1 * max(time - 0.5, 0.0)
        position = reference - 0.06 * min(max(time - 4.0, 0.0), limited)
        state = joint_state(time, ["a"], position=[1e-4 * round(1e4 * position)])
        messages.append(("/joint_states", JOINT_STATE, time, state))
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[reference])))
    path = tmp_path / "limited.mcap"
    write_mcap(path, messages)
    assert main(["analyze", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bags"][0]["joints"]["a"]["status"] == status
    assert main(["analyze", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "othing has to be done" not in said
    assert "times as far as its reference" in said


@pytest.mark.parametrize(("jam", "jump"), [(2.0, 0.0), (20.0, 0.0), (2.0, 1.5)])
def test_a_joint_that_is_jammed_is_told(
    jam: float, jump: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It moves smoothly, then stands while its reference goes on: "smooth, nothing has to be done" was said of it.
    Where the reference jumped before the joint stood is no way that it went meanwhile.
    """
    times = [0.01 * number for number in range(round(100.0 * (10.0 + jam)))]
    messages = []
    for time in times:
        state = joint_state(time, ["a"], position=[1e-4 * round(max(300.0 * min(time, 10.0) - 13.0, 0.0))])
        messages.append(("/joint_states", JOINT_STATE, time, state))
        reference = 0.03 * time + (jump if time > 9.7 else 0.0)
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[reference])))
    path = tmp_path / "jammed.mcap"
    write_mcap(path, messages)
    assert main(["analyze", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["bags"][0]["joints"]["a"]
    assert found["status"] == ("smooth" if jam < 10.0 else "not_judged")
    assert found["stuck"]["duration"] == pytest.approx(jam, abs=0.4)
    assert found["stuck"]["travel"] == pytest.approx(0.03 * jam, abs=0.02)
    assert main(["analyze", str(path)]) == 0
    said = capsys.readouterr().out
    assert "othing has to be done" not in said
    assert "stuck for " in said


@pytest.mark.parametrize(
    ("slips", "back", "status"),
    [(5, 2.0, "not_judged"), (6, 3.0, "not_judged"), (3, 2.0, "not_judged"), (3, 14.0, "smooth")],
)
def test_slips_of_a_stroke_outweigh_a_smooth_return(
    slips: int, back: float, status: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Strokes that stick and returns that do not, without a reference: "smooth, nothing has to be done" was said."""
    period = slips + 1.0 + back
    time = np.arange(0.0, 3.0 * period, 0.01)
    phase = time % period
    slip = np.clip(phase % 1.0 / 0.15, 0.0, 1.0)
    stroke = np.floor(phase) - 1.0 + slip * slip * (3.0 - 2.0 * slip)
    returning = slips * np.clip(1.0 - (phase - slips - 1.0) / back, 0.0, 1.0)
    position = 0.05 * np.where(phase < 1.0, 0.0, np.where(phase < slips + 1.0, stroke, returning))
    path = tmp_path / "strokes.csv"
    rows = np.column_stack([time, np.round(position, 4)])
    np.savetxt(path, rows, fmt="%.4f", delimiter=",", header="time_s,a_position_rad", comments="")
    bag = str(tmp_path / "strokes.mcap")
    assert main(["convert", str(path), "--out", bag]) == 0
    assert main(["analyze", bag, "--no-learning", "--json"]) in (0, 2)
    said = capsys.readouterr().out
    found = json.loads(said[said.index("{") :])["bags"][0]["joints"]["a"]
    assert found["status"] == status
    # The stands between slips are moving time, as those of stick-slip are; those before a stroke are not.
    assert found["moving_time"] == pytest.approx(3.0 * (slips - 0.85 + back), abs=1.5)
    assert main(["analyze", bag, "--no-learning"]) in (0, 2)
    said = capsys.readouterr().out
    assert "othing has to be done" not in said
    assert "publish the joint's own to tell commanded stops from sticking" in said


def test_the_share_is_of_moving_time() -> None:
    """Issue 17, item 6: rest counts for nothing, motion that is not judged counts; no motion has no share."""
    segments = stretches((REST, 100.0), (SMOOTH, 6.0), (STICKS, 2.0), (NOT_JUDGED, 2.0), (UNKNOWN, 5.0))
    assert moving_time(segments) == pytest.approx(10.0)
    assert stick_slip_share(segments) == pytest.approx(0.2)
    assert math.isnan(stick_slip_share(stretches((REST, 3.0))))
    assert math.isnan(stick_slip_share([]))


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.0, "0 %"), (0.0142, "1.4 %"), (0.0001, "< 0.1 %"), (0.421, "42 %"), (1.0, "100 %"), (math.nan, "-")],
)
def test_shares_in_words(share: float, said: str) -> None:
    """Issue 17, item 6: short stick-slip is never 0 %."""
    assert words.percent(share) == said


FIRST = [cycle(0.0, 2.0, 2.8), cycle(2.8, 2.9, 3.7), cycle(3.7, 3.8, 4.6)]


@pytest.mark.parametrize(
    ("parts", "cycles", "dies_out"),
    [
        ([(REST, 2.0), (STICKS, 3.0), (SMOOTH, 15.0)], FIRST, True),
        # It stands, starts again, and sticks after starting again.
        ([(REST, 2.0), (STICKS, 3.0), (SMOOTH, 9.0), (REST, 6.0), (STICKS, 2.0), (SMOOTH, 30.0)],
         [*FIRST, cycle(20.3, 20.4, 21.0), cycle(21.0, 21.2, 22.0)], True),
        # In the midst of motion: the rest before the slip is no start.
        ([(SMOOTH, 9.0), (REST, 0.3), (SMOOTH, 40.0)], [cycle(9.0, 9.3, 9.9)], False),
        ([(REST, 2.0), (STICKS, 3.0), (SMOOTH, 4.0), (STICKS, 0.5), (SMOOTH, 30.0)],
         [*FIRST, cycle(9.0, 9.1, 9.5)], False),
        # It goes on too long, is not judged since, or hunts.
        ([(REST, 2.0), (STICKS, 3.0), (SMOOTH, 1.0)], FIRST, False),
        ([(REST, 2.0), (STICKS, 3.0), (NOT_JUDGED, 30.0), (SMOOTH, 4.0)], FIRST, False),
        ([(REST, 2.0), (STICKS, 3.0), (SMOOTH, 15.0)], [replace(one, hunting=True) for one in FIRST], False),
        ([(SMOOTH, 15.0)], [], False),
    ],
)  # fmt: skip
def test_what_dies_out_after_a_start(parts: list[tuple[Status, float]], cycles: list[Cycle], dies_out: bool) -> None:
    """Issue 17, item 5: sticks soon after a start, and smooth motion since, are a transient; nothing else is."""
    found = transient(stretches(*parts), cycles)
    assert (found is not None) == dies_out
    if found is not None:
        assert (found.cycles, found.end) == (len(cycles), cycles[-1].arrest)
        assert found.smooth >= 15.0


def test_faster_motion_is_no_end_of_a_transient() -> None:
    """Issue 17, item 5: a joint that is smooth only since it moves much faster would stick again."""
    segments = stretches((REST, 2.0), (STICKS, 3.0), (SMOOTH, 15.0))
    segments[-1] = replace(segments[-1], velocity=-0.1)
    assert transient(segments, FIRST) is None


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Joints that stick for a while and then move smoothly, a little faster; that stick to the end; that never do."""
    path = tmp_path_factory.mktemp("bags") / "arm.mcap"
    starting = RecordedJoint(
        joint=KNOWN.joint,
        gains=replace(KNOWN.gains, damping=60.0),
        velocities=(0.006, *[0.016] * 5),
        encoder_resolution=KNOWN.encoder_resolution,
    )
    joints = {"starting": starting, "sticking": sticking(0.006), "smooth": sticking(0.06)}
    write_simulation(path, joints, duration=90.0, rate=200.0)
    return path


@pytest.fixture(scope="module")
def joints(bag: Path) -> dict[str, JointAnalysis]:
    """What is found of them."""
    return analyze(bag, WITHOUT_LEARNING).joints


def test_a_joint_that_sticks_for_a_while(joints: dict[str, JointAnalysis]) -> None:
    """Issue 17, items 5 and 6: smooth for most of the time; stick-slip, its share, and advice are not hidden."""
    joint = joints["starting"]
    assert (joint.status, joint.worst) == (SMOOTH, STICKS)
    assert 0.05 < joint.stick_slip_share < 0.4
    assert joint.transient is not None
    assert joint.transient.cycles == len(joint.cycles)
    said = words.finding(joint)
    assert "starting moves smoothly most of the time, but sticks and slips at 0.00" in said
    assert f"for {100.0 * joint.stick_slip_share:.0f} % of its moving time" in said
    assert f"It stuck {len(joint.cycles)} times after starting and has moved smoothly since." in said
    assert words.advice(joint).startswith("Change damping")


def test_joints_of_one_status(joints: dict[str, JointAnalysis]) -> None:
    """Issue 17, item 6: what sticks throughout sticks, what never does is smooth, and keeps its gains."""
    assert (joints["sticking"].status, joints["sticking"].worst) == (STICKS, STICKS)
    assert joints["sticking"].transient is None
    assert (joints["smooth"].status, joints["smooth"].stick_slip_share) == (SMOOTH, 0.0)
    assert words.advice(joints["smooth"]) == "Its gains have the wanted reserve: keep them."
    assert (
        words.smooth([replace(joints["smooth"], worst=SMOOTH), joints["sticking"]])
        == "smooth: smooth, nothing has to be done; slips of less than 375 µrad may go unseen."
    )


def test_a_joint_that_is_pushed_now_and_then_has_a_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each of its motions is too short to be judged: that is said, and what is odd about its data is not the reason."""
    messages = []
    for number in range(3000):
        time, push = 0.01 * number, divmod(number, 100)
        position = 0.3 * (push[0] + min(push[1] / 35.0, 1.0))
        # The velocity in degrees: a warning, which says nothing of the motion.
        speed = 49.0 if push[1] < 35 else 0.0
        messages.append(
            ("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[position], velocity=[speed]))
        )
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[0.0])))
    write_mcap(tmp_path / "a.mcap", messages)
    main(["analyze", str(tmp_path / "a.mcap"), "--no-learning"])
    assert "not judged, stops and goes while no reference moves; publish the joint's own" in capsys.readouterr().out


def test_motions_that_are_too_short_are_told_by_the_longest(tmp_path: Path) -> None:
    """Of a recording that moved for 21 s the reason was "only 0.00 s of motion", as just before its end."""
    messages = []
    for number in range(3005):
        time, (push, part) = 0.01 * number, divmod(number, 100)
        position = 0.3 * (push + min(part / 70.0, 1.0))
        messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[position])))
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[position + 0.01])))
    write_mcap(tmp_path / "a.mcap", messages)
    joint = analyze(tmp_path / "a.mcap", WITHOUT_LEARNING).joints["a"]
    assert joint.status is NOT_JUDGED
    told = re.fullmatch(r"only (0\.\d+) s of motion without a stop, 1 s are needed", joint.reason)
    assert told is not None, joint.reason
    assert float(told[1]) == pytest.approx(0.7, abs=0.15)


@pytest.mark.parametrize(
    ("reference", "said"),
    [
        # A reference that only repeats what was measured: "falls behind by 0 rad (median); at most by -0 rad".
        (lambda time, position: position, r"^$"),
        # A reference of another rhythm: "is ahead of its reference by 198 mrad (median); at most by -198 mrad".
        (
            lambda time, position: 0.8 * np.cos(0.37 * time),
            r"is ahead of its reference by \d+ mrad \(median\); at least by \d+ mrad\.$",
        ),
    ],
)
def test_signs_of_what_reversals_do(
    reference: Callable[[np.ndarray, np.ndarray], np.ndarray], said: str, tmp_path: Path
) -> None:
    """Of two errors it is said which is ahead and which behind, and nothing of a reference that counts as none."""
    times = 0.01 * np.arange(4000)
    positions = np.round(0.5 * np.sin(0.2 * np.pi * times) / 1e-4) * 1e-4
    references = reference(times, positions)
    messages = []
    for time, position, wanted in np.stack([times, positions, references], axis=1).tolist():
        messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[position])))
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[wanted])))
    write_mcap(tmp_path / "a.mcap", messages)
    joint = analyze(tmp_path / "a.mcap", WITHOUT_LEARNING).joints["a"]
    assert re.search(said, words.reversals(joint)), words.reversals(joint)
    record = joint.assessment.reversals
    if record is not None:
        record = replace(record, largest_error=0.01)
        other = words.reversals(replace(joint, assessment=replace(joint.assessment, reversals=record)))
        assert other.endswith("; at most it falls behind by 10 mrad.")


@pytest.mark.parametrize(
    ("play", "said"),
    [
        (0.0, "a: smooth, nothing has to be done; slips of less than"),
        (0.2, "a: smooth between reversals, nothing has to be done against stick-slip; slips of less than"),
    ],
)
def test_a_joint_that_stands_at_its_reversals(play: float, said: str, tmp_path: Path) -> None:
    """Of lost motion: "it stands for 0.74 s and falls behind by 134 mrad", and then "nothing has to be done"."""
    messages, position = [], 0.0
    for time in (0.01 * np.arange(4000)).tolist():
        wanted = 0.5 * math.sin(0.2 * math.pi * time)
        position = min(max(position, wanted - 0.5 * play), wanted + 0.5 * play)
        seen = round(position / 1e-4) * 1e-4
        messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[seen])))
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[wanted])))
    write_mcap(tmp_path / "a.mcap", messages)
    joint = analyze(tmp_path / "a.mcap", WITHOUT_LEARNING).joints["a"]
    assert words.smooth([joint]).startswith(said)


def test_a_joint_that_was_smooth_for_a_little_while(tmp_path: Path) -> None:
    """Of 3.9 s of motion 0.9 were smooth, and the rest could not be judged: "nothing has to be done" was said."""
    messages = []
    times = 0.01 * np.arange(3000)
    # Smooth for 9 s; then motions to and fro, each too short to be judged.
    positions = np.where(times < 9.0, 0.1 * times, 0.9 - 0.01 * np.cos(8.0 * (times - 9.0)) + 0.01)
    for time, position in np.stack([times, np.round(positions / 1e-5) * 1e-5], axis=1).tolist():
        messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[position])))
        messages.append(("/joint_references", JOINT_STATE, time, joint_state(time, ["a"], position=[position + 1e-3])))
    write_mcap(tmp_path / "a.mcap", messages)
    joint = analyze(tmp_path / "a.mcap", WITHOUT_LEARNING).joints["a"]
    assert joint.status is SMOOTH
    said = words.smooth([joint])
    assert re.match(r"a: smooth for \d+ % of its moving time; the rest could not be judged; slips of less", said), said
    assert words.advice(joint) == ""


def test_a_joint_that_never_moves_needs_nothing(tmp_path: Path) -> None:
    """It has no moving time that could be shared."""
    messages = [
        ("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[0.5]))
        for time in np.arange(0.0, 9.0, 0.01)
    ]
    write_mcap(tmp_path / "a.mcap", messages)
    joint = analyze(tmp_path / "a.mcap", WITHOUT_LEARNING).joints["a"]
    assert (joint.moving_time, words.advice(joint), words.smooth([joint])) == (0.0, "Nothing has to be done.", "")


def test_advice_for_one_of_two_speeds_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A joint that stuck at 6 mrad/s too was advised 7.5 N·m·s/rad, which end it at 20 mrad/s; 130 end it at both."""
    path = tmp_path / "a.mcap"
    options = ["--velocity", "0.006,0.02", "--duration", "40", "--rate", "200"]
    assert main(["simulate", "--out", str(path), *options]) == 0
    common = ["analyze", str(path), "--no-learning", "--model", "puma560_joint1"]

    def said(*more: str) -> tuple[float, str]:
        assert main([*common, *more]) == 0
        text = capsys.readouterr().out
        (damping,) = re.findall(r"Change damping from 0 to ([\d.]+)", text)
        return float(damping), text

    damping, text = said()
    assert damping < 20.0
    found = re.search(
        r"gains are for 0\.02\d* rad/s\. It also stuck at 0\.006\d* rad/s: (--slowest-velocity) (\S+) ad", text
    )
    assert found is not None
    damping, text = said(*found.groups())
    assert damping > 100.0
    assert "also stuck" not in text


def test_a_joint_slower_than_it_has_to_be_smooth(tmp_path: Path) -> None:
    """Gains that are good from the slowest velocity on do not refute the friction estimate, which predicts stick-slip
    at the speed of the recording; the node says the same.
    """
    path = tmp_path / "a.mcap"
    write_simulation(path, {"a": sticking(0.006)}, duration=20.0, rate=200.0)
    options = {"learn": False, "model.*": "puma560_joint1", "slowest_velocity.a": 5.0}
    joint = analyze(path, AnalysisOptions(parameters=Parameters(options))).joints["a"]
    assert joint.worst is STICKS
    sentence = (
        f"ts gains have the wanted reserve from 5 rad/s on; at {joint.velocity:.3g} rad/s the model predicts stick-slip"
    )
    assert words.advice(joint) == f"I{sentence}."
    status = joint_diagnostic("a", Findings(assessment=joint.assessment, exact=joint.exact), 0.1)
    assert status.message == f"stick_slip; i{sentence}"


def test_a_model_that_does_not_fit_is_good_for_no_speed(tmp_path: Path) -> None:
    """The speed from which on a joint is smooth was advised by a model that the next line said not to trust."""
    path = tmp_path / "a.mcap"
    write_simulation(path, {"a": sticking(0.006)}, duration=30.0, rate=200.0)
    joint = analyze(path).joints["a"]
    assert re.search(r"^Change .* or keep the present gains and move faster than 0.02\d* rad/s\.", words.advice(joint))
    state = joint.assessment
    assert state.estimate is not None
    off = replace(state, estimate=replace(state.estimate, mismatch="friction model does not fit"))
    said = words.advice(replace(joint, assessment=off))
    assert said.startswith("Perhaps change ")
    assert said.endswith(": friction model does not fit.")
    assert "faster" not in said


def test_every_output_has_status_share_and_worst(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 6: the table on the terminal, the JSON, the table of a fleet, the page, the exit status."""
    common = ["analyze", str(bag), "--no-learning", "--model", "puma560_joint1"]
    table, page = tmp_path / "fleet.csv", tmp_path / "report.html"
    assert main([*common, "--table", str(table), "--html", str(page)]) == 0
    out = capsys.readouterr().out
    rows = {line.split()[0]: line.split() for line in reversed(out.splitlines()) if line.startswith("starting ")}
    assert rows["starting"][1] == "smooth"
    assert rows["starting"][3:5] == ["%", "stick_slip"]
    # In words what stuck most comes first.
    assert out.index("sticking sticks and slips") < out.index("starting moves smoothly")
    assert main([*common, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["bags"][0]["joints"]
    one = found["starting"]
    assert (one["status"], one["worst_status"]) == ("smooth", "stick_slip")
    assert one["stick_slip_share"] == pytest.approx(one["time_in"]["stick_slip"] / one["moving_time"])
    assert one["transient"]["cycles"] == len(one["cycles"])
    assert found["sticking"]["transient"] is None
    with table.open(newline="", encoding="utf-8") as file:
        (row,) = [row for row in csv.DictReader(file) if row["joint"] == "starting"]
    assert (row["status"], row["worst_status"]) == ("smooth", "stick_slip")
    assert float(row["stick_slip_share"]) == one["stick_slip_share"]
    text = page.read_text(encoding="utf-8")
    assert "2 of 3 joints stick and slip" in text
    assert text.index("<h2>sticking") < text.index("<h2>starting")
    # A short stretch of stick-slip fails too.
    assert main([*common, "--joint", "starting", "--fail-on-stick-slip"]) == 1
    assert main([*common, "--joint", "smooth", "--fail-on-stick-slip"]) == 0


def test_a_joint_over_its_recordings() -> None:
    """Issue 17, item 6: of a fleet's joint the time counts, not the number of recordings."""
    rows = [
        {"status": "smooth", "worst_status": "stick_slip", "moving_time": 90.0, "sticking_time": 1.0},
        {"status": "stick_slip", "worst_status": "stick_slip", "moving_time": 5.0, "sticking_time": 4.0},
        {"status": "stick_slip", "worst_status": "stick_slip", "moving_time": 5.0, "sticking_time": 5.0},
        {"status": "at_rest", "worst_status": "at_rest", "moving_time": 0.0, "sticking_time": 0.0},
    ]
    assert share_of_rows(rows) == pytest.approx(0.1)
    assert math.isnan(share_of_rows(rows[-1:]))


def test_answers_kept_by_another_layout_are_not_taken(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 17, item 6: answers kept before the keys changed are analysed anew, though the version is the same."""
    task = BagTask(bag, WITHOUT_LEARNING)
    kept = Answers(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("stickslip_ros.analysis.fleet._LAYOUT", 1)
        kept.keep(task, {"path": str(bag)})
        assert kept.get(task) == {"path": str(bag)}
    assert kept.get(task) is None
