# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Data that cannot be right: what is wrong is said, nothing is called well that could not be judged, status 2."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from conftest import examples
from hypothesis import example, given
from hypothesis import strategies as st
from support_bags import JOINT_STATE, joint_state, write_mcap

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.cli.main import main
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

COUNT = 1500
TIMES = 1.0 + 0.01 * np.arange(COUNT)
POSITIONS = 0.05 * TIMES
NOT_JUDGED = ("unknown", "not_judged")
ALL_IS_WELL = ("Nothing has to be done", "moves smoothly", "keep them", "sticks and slips.")


def recorded(path: Path, times: Any, positions: Any, names: Sequence[str] = ("joint1",)) -> Path:
    """A bag of joints that all have the same positions, recorded in order whatever their stamps."""
    rows = [
        ("/joint_states", JOINT_STATE, 1.0 + 0.01 * number, joint_state(time, names, position=[position] * len(names)))
        for number, (time, position) in enumerate(
            zip(np.asarray(times).tolist(), np.asarray(positions, dtype=float).tolist(), strict=True)
        )
    ]
    return write_mcap(path, rows)


def outcome(*arguments: str) -> tuple[int, str, str]:
    """Exit status, output and errors of `stickslip analyze`, in this process."""
    out, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(errors):
        status = main(["analyze", *arguments, "--no-learning"])
    return status, out.getvalue(), errors.getvalue()


def changed(values: Any, where: Any, what: Any) -> Any:
    """The values with some of them replaced."""
    new = np.array(values, dtype=float)
    new[where] = what
    return new


NAN, INFINITE = "position is missing or not a number", "position is infinite or larger than 1e+12"
# Stamps, positions, what is said, whether the joint can be judged all the same.
CASES: dict[str, tuple[Any, Any, str, bool]] = {
    "all NaN": (TIMES, np.full(COUNT, math.nan), f"joint1: 1500 of 1500 samples left out: {NAN}", False),
    "all infinite": (TIMES, np.full(COUNT, math.inf), f"1500 of 1500 samples left out: {INFINITE}", False),
    "all huge": (TIMES, np.full(COUNT, 1e300), f"1500 of 1500 samples left out: {INFINITE}", False),
    "NaN in between": (TIMES, changed(POSITIONS, range(9, 99), math.nan), f"90 of 1500 samples left out: {NAN}", True),
    "infinite in between": (TIMES, changed(POSITIONS, 700, -math.inf), f"1 of 1500 samples left out: {INFINITE}", True),
    "huge in between": (TIMES, changed(POSITIONS, 700, 1e300), f"1 of 1500 samples left out: {INFINITE}", True),
    "backwards": (TIMES[::-1], POSITIONS, "samples left out: stamp goes backwards", False),
    "to and fro": (TIMES + 10.0 * (np.arange(COUNT) % 2), POSITIONS, "stamps jump back 749 times", False),
    "begun anew": (np.tile(TIMES, 2), np.tile(POSITIONS, 2), "stamps jump back once", True),
    "equal": (np.full(COUNT, 5.0), POSITIONS, "1499 of 1500 samples left out: stamp stands still", False),
    "zero": (np.zeros(COUNT), POSITIONS, "stamp is zero; the time of recording is used instead (1500 messages)", True),
    "one sample": (TIMES[:1], POSITIONS[:1], "joint1 cannot be judged: too few samples", False),
    "three samples": (TIMES[:3], POSITIONS[:3], "joint1 cannot be judged: too few samples", False),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_with_the_data_is_said(case: str, tmp_path: Path) -> None:
    """Issue 17, item 11: how many samples were left out and why, in the table, the JSON and the report."""
    times, positions, said, judged = CASES[case]
    path, page = recorded(tmp_path / "bag.mcap", times, positions), tmp_path / "report.html"
    status, text, errors = outcome(str(path), "--html", str(page))
    assert status == (0 if judged else 2)
    assert outcome(str(path), "--out", str(tmp_path / "annotated.mcap"))[0] == status
    assert said in text
    assert "Nothing has to be done" not in text
    html = page.read_text(encoding="utf-8").replace("&#39;", "'")
    if "cannot be judged" not in said:
        assert said in html
        (bag,) = json.loads(outcome(str(path), "--json")[1])["bags"]
        assert any(said.removeprefix("joint1: ") in warning for warning in bag["warnings"])
    if judged:
        assert not errors
        return
    (line,) = errors.strip().splitlines()
    assert line.startswith(f"stickslip: bag {path}: no joint could be judged: joint1: ")
    assert "None of 1 joint could be judged" in html
    assert "sticks and slips" not in html
    assert "joint1 cannot be judged" in text


def test_durations_where_stamps_go_back(tmp_path: Path) -> None:
    """Issue 17, item 11: no duration is negative; where a recording begins anew its parts add up."""
    quiet = AnalysisOptions(parameters=Parameters({"learn": False}), with_traces=True)

    def joint(times: Any, positions: Any) -> Any:
        return analyze(recorded(tmp_path / "bag.mcap", times, positions), quiet).joints["joint1"]

    assert joint(TIMES, POSITIONS).duration == pytest.approx(14.99)
    assert joint(TIMES[::-1], POSITIONS).duration == 0.0
    twice = joint(np.tile(TIMES, 2), np.tile(POSITIONS, 2))
    assert twice.duration == pytest.approx(2 * 14.99, abs=0.1)
    assert (twice.start, twice.end) == pytest.approx((1.0, 15.99), abs=0.05)
    # A stamp that is far ahead is no recording of years.
    assert joint(changed(TIMES, 700, 2e9), POSITIONS).duration == pytest.approx(14.99, abs=0.1)
    # A value that is left out is not drawn.
    _, _, high = joint(TIMES, changed(POSITIONS, 700, 1e300)).traces.position.points()
    assert np.nanmax(high) < 1.0


def test_names_that_say_nothing(tmp_path: Path) -> None:
    """Issue 17, item 11: a joint without a name is analysed, and said; a bag without joints is an error."""
    status, text, _ = outcome(str(recorded(tmp_path / "bag.mcap", TIMES, POSITIONS, names=("",))))
    assert status == 0
    assert "joint '' has no name" in text
    status, _, errors = outcome(str(recorded(tmp_path / "bag.mcap", TIMES, POSITIONS, names=())))
    assert status == 2
    assert "no joint in it" in errors


def test_one_joint_that_can_be_judged_is_enough(tmp_path: Path) -> None:
    """Issue 17, item 11: exit status 2 only if nothing could be judged; of the others it is said all the same."""
    rows = [
        ("/joint_states", JOINT_STATE, time, joint_state(time, ["good", "bad"], position=[position, math.nan]))
        for time, position in zip(TIMES.tolist(), POSITIONS.tolist(), strict=True)
    ]
    path, page = write_mcap(tmp_path / "bag.mcap", rows), tmp_path / "report.html"
    status, text, errors = outcome(str(path), "--html", str(page))
    assert (status, errors) == (0, "")
    assert "bad cannot be judged: 1500 of 1500 samples left out" in text
    html = page.read_text(encoding="utf-8")
    assert "None of 1 joint sticks and slips</strong>; 1 could not be judged" in html


def test_a_fleet_of_bad_bags(tmp_path: Path) -> None:
    """Issue 17, item 11: a bag of which nothing could be judged is named among many."""
    recorded(tmp_path / "good.mcap", TIMES, POSITIONS)
    recorded(tmp_path / "bad.mcap", TIMES, np.full(COUNT, math.nan))
    page = tmp_path / "fleet.html"
    status, text, errors = outcome(str(tmp_path), "--html", str(page))
    assert status == 2
    (line,) = [text for text in errors.splitlines() if text.startswith("stickslip: ")]
    # Said of the bag as soon as it was done, too.
    assert "bad.mcap: no joint could be judged (" in errors
    assert "bad.mcap: no joint could be judged: joint1: 1500 of 1500 samples left out" in line
    assert "nan" not in text


_NONSENSE = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1e300, 1e13, 1e11, 0.0, -0.0, 1e-300])
_STAMPS = st.sampled_from([0.0, 1e-9, 1.0, 2.0e9, 5.0])


@examples(20, 100)
@given(
    st.lists(st.tuples(st.integers(0, 299), st.integers(1, 300), _NONSENSE), max_size=4),
    st.lists(st.tuples(st.integers(0, 299), st.integers(1, 300), _STAMPS), max_size=3),
    st.sampled_from(["as they are", "backwards", "shuffled", "twice"]),
    st.integers(1, 300),
    st.sampled_from([("joint1",), ("",), ("a", "b"), ("a/b", "[red]"), ()]),
)
@example(positions=[(1, 1, 1e-300), (2, 1, 1e11)], stamps=[], order="as they are", count=3, names=("joint1",))
def test_whatever_the_data(
    positions: list[tuple[int, int, float]],
    stamps: list[tuple[int, int, float]],
    order: str,
    count: int,
    names: tuple[str, ...],
) -> None:
    """Issue 17, item 11: no traceback; status 2 exactly if nothing could be judged; nothing is called well then."""
    time, position = 1.0 + 0.02 * np.arange(300), 0.03 * np.arange(300)
    for begin, length, value in positions:
        position[begin : begin + length] = value
    for begin, length, value in stamps:
        time[begin : begin + length] = value
    time, position = time[:count], position[:count]
    places = {
        "as they are": np.arange(count),
        "backwards": np.arange(count)[::-1],
        "shuffled": np.random.default_rng(1).permutation(count),
        "twice": np.tile(np.arange(count), 2),
    }[order]
    with TemporaryDirectory() as folder:
        path, page = Path(folder) / "bag.mcap", Path(folder) / "report.html"
        recorded(path, time[places], np.resize(position, len(places)), names)
        status, text, errors = outcome(str(path), "--html", str(page))
        again, found, _ = outcome(str(path), "--json", "--out", str(Path(folder) / "out.mcap"))
        html = page.read_text(encoding="utf-8") if page.exists() else ""
    assert status == again
    assert "Traceback" not in text + errors
    (bag,) = json.loads(found)["bags"]
    if "error" in bag:
        assert status == 2
        return
    joints = bag["joints"]
    judged = [name for name, joint in joints.items() if joint["worst_status"] not in NOT_JUDGED]
    assert status == (0 if judged else 2)
    assert len(errors.strip().splitlines()) == (0 if judged else 1)
    for joint in joints.values():
        assert joint["samples"] >= 0
        assert joint["duration"] is None or joint["duration"] >= 0.0
        assert all(one["end"] >= one["start"] for one in joint["segments"])
        assert joint["reason"] or joint["status"] != "unknown"
    if not judged:
        assert not any(words in text + errors + html for words in ALL_IS_WELL)
    assert not re.search(r"\bnan\b", text + errors)
    assert not re.search(r"(^|\s)-\d[\d.e+]* s", html)


def test_identify_says_what_is_wrong_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 17, item 11: data of which nothing can be used are an error; of others it is said what was left out."""
    path = recorded(tmp_path / "bag.mcap", TIMES, np.full(COUNT, math.nan))
    assert main(["identify", str(path)]) == 2
    assert f"1500 of 1500 samples left out: {NAN}" in capsys.readouterr().err
    path = recorded(tmp_path / "bag.mcap", TIMES[::-1], POSITIONS)
    assert main(["identify", str(path)]) == 1
    out = capsys.readouterr().out
    assert "samples left out: stamp goes backwards" in out
    assert "nan" not in out


def test_a_short_smooth_stretch_clears_nothing(tmp_path: Path) -> None:
    """A joint that cannot be judged was told "nothing has to be done", for it had moved smoothly for some seconds."""
    swings = 0.02 * np.sin(4.0 * np.pi * (TIMES - TIMES[350]))
    positions = np.where(np.arange(COUNT) < 350, POSITIONS - POSITIONS[350], swings)
    path = recorded(tmp_path / "a.mcap", changed(TIMES, slice(1000, None), TIMES[1000:] - 3.0), positions)
    _, text, _ = outcome(str(path))
    assert "cannot be judged" in " ".join(text.split())
    assert not any(word in text for word in ALL_IS_WELL)
    _, text, _ = outcome("--brief", str(path))
    assert text.splitlines()[0] == f"{path}: none of 1 joint stuck and slipped; 1 could not be judged"
