# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags and tables with numbers that cannot be: they are named, and no library warns of them on the terminal."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support_bags import read_joint, simulated_bag

from stickslip_ros.bags.writing import write_recording
from stickslip_ros.cli.main import main

pytestmark = pytest.mark.slow

ALTERNATING = np.array([1.0, -1.0])


@pytest.mark.parametrize("command", ["analyze", "identify"])
@pytest.mark.parametrize(
    ("effort", "said"),
    [
        (1e200 * ALTERNATING, "values left out: effort is infinite or larger than 1e+12"),
        (5e-324 * ALTERNATING, "values left out: effort is denormal (below 2.2e-308), as memory that nobody wrote is"),
        (0.0 * ALTERNATING, "its effort is always 0, so it is no measurement and counts as unknown"),
    ],
)
def test_efforts_that_are_none_are_named(
    command: str, effort: np.ndarray, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 34, items 7 and 12: an analysis ended in a ValueError, or told a friction of 4e-313."""
    batch = read_joint(simulated_bag(tmp_path / "plain.mcap"), "joint1")
    path = tmp_path / "efforts.mcap"
    write_recording(path, {"joint1": replace(batch, effort=np.resize(effort, len(batch)))}, start=0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        status = main([command, str(path), *(["--html", str(tmp_path / "a.html")] if command == "analyze" else [])])
    told = capsys.readouterr()
    assert said in " ".join((told.out + told.err).split())
    if command == "analyze":
        assert status == 0
        assert main(["analyze", str(path), "--json"]) == 0
        joint = json.loads(capsys.readouterr().out)["bags"][0]["joints"]["joint1"]
        assert joint["status"] == "stick_slip"


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("1e30,0.1,1", "1 rows have no time, or none that a stamp can be, and were left out"),
        ("-1e300,0.1,1", "1 rows have no time, or none that a stamp can be, and were left out"),
        ("inf,0.1,1", "1 rows have no time, or none that a stamp can be, and were left out"),
        ("1.5,1e308,1", "1 of 300 samples left out: position is infinite or larger than 1e+12"),
        ("1.5,0.45,1e308", "1 of 300 values left out: effort is infinite or larger than 1e+12"),
    ],
)
def test_a_row_of_a_table_that_cannot_be(
    row: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 34, item 12: `convert`, `analyze` and `identify` leave it out, and say so."""
    rows = [f"{0.01 * number:.3f},{0.003 * number:.5f},{number % 7}" for number in range(300)]
    rows[150] = row
    table, bag = tmp_path / "a.csv", tmp_path / "a.mcap"
    table.write_text("time_s,pos_deg,effort\n" + "\n".join(rows) + "\n", encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["convert", str(table), "--out", str(bag)]) == 0
        assert main(["analyze", str(bag)]) == 0
        told = capsys.readouterr()
        assert said in " ".join((told.out + told.err).split())
        assert main(["identify", str(table)]) in (0, 1)
        told = capsys.readouterr()
        assert "1 of 300" in told.out + told.err
