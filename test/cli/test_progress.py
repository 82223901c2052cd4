# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How far long work is, with a terminal and without; Ctrl-C in the middle of it."""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from bags.support_bags import WITHOUT_LEARNING, simulated_bag
from conftest import LIMIT, nightly

from stickslip_ros.analysis import fleet
from stickslip_ros.cli.main import main

pytestmark = pytest.mark.slow

LOST = """
import os, signal
from stickslip_ros.cli.terminal import progress_bar
from stickslip_ros.interrupts import take_signals

class Finalized:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

take_signals()

with progress_bar("working") as tell:
    tell(1, 3)
    Finalized()
    print("went on", flush=True)
    tell(2, 3)
    print("too far", flush=True)
"""


def test_an_interrupt_in_a_finalizer_is_not_lost() -> None:
    """Issue 6, item 5: an interrupted run ends, also where Python would drop an exception: the next step raises it."""
    done = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.stdout == "went on\n"
    assert done.stderr.rstrip().endswith("Interrupted: 2")
    assert done.returncode != 0


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three recordings that take long enough to be looked at."""
    folder = tmp_path_factory.mktemp("bags")
    return [simulated_bag(folder / f"{name}.mcap", names=("a", "b", "c"), duration=60.0) for name in "xyz"]


@pytest.mark.parametrize("jobs", [1, nightly(2)])
def test_progress_within_a_bag(jobs: int, bags: list[Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Issue 22, item 6: while a bag is read its part counts; how far it is never goes back, and ends with all."""
    monkeypatch.setattr(fleet, "_LOOKED_EVERY", 0.002)
    told: list[tuple[float, float]] = []
    fleet.analyze_fleet(bags, WITHOUT_LEARNING, jobs=jobs, progress=lambda done, total: told.append((done, total)))
    parts = [done for done, _ in told]
    assert {total for _, total in told} == {3}
    assert len({part for part in parts if part % 1.0}) >= 3
    assert parts[0] == 0.0
    assert parts[-1] == 3.0
    assert all(before <= after for before, after in pairwise(parts))


def test_a_simulation_tells_how_far_it_is(tmp_path: Path) -> None:
    """Issue 22, item 6: of its samples."""
    told: list[tuple[int, int]] = []
    simulated_bag(tmp_path / "x.mcap", duration=25.0, rate=1000.0, progress=lambda *one: told.append(one))
    assert told == [(0, 25_000), (10_000, 25_000), (20_000, 25_000)]


def test_nightly_jobs_have_a_line_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 22, item 6: without a terminal each bag is a line with time and result, as soon as it is done."""
    sticks = simulated_bag(tmp_path / "a.mcap", names=("shoulder", "elbow"), duration=4.0)
    damaged = tmp_path / "b.mcap"
    damaged.write_bytes(b"nothing")
    kept = ["--results", str(tmp_path / "kept"), "--no-learning"]
    for took in (r"\d+\.\d s", "cached"):
        assert main(["analyze", str(sticks), str(damaged), *kept]) == 2
        captured = capsys.readouterr()
        first, second, *_ = sorted(line for line in captured.err.splitlines() if line.startswith("2"))
        when = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d"
        said = rf"2 of 2 joints stuck and slipped: (shoulder|elbow) \d+ %, (shoulder|elbow) \d+ % \({took}\)"
        assert re.fullmatch(rf"{when} {re.escape(str(sticks))}: {said}", first), first
        assert re.fullmatch(rf"{when} {re.escape(str(damaged))}: could not be analysed \(\d+\.\d s\)", second), second


def test_one_bag_has_its_table_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 22, item 6: what is printed of one bag is its result; stderr is for what is wrong."""
    bag = simulated_bag(tmp_path / "a.mcap", duration=2.0)
    assert main(["analyze", str(bag), "--no-learning"]) == 0
    assert capsys.readouterr().err == ""
