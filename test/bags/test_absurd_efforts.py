# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags whose efforts are none: they are analysed and named, and no library warns of them on the terminal."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support_bags import simulated_bag

from stickslip_ros.bags.conversion import write_recording
from stickslip_ros.bags.joint_samples import read_joint
from stickslip_ros.cli.main import main

ALTERNATING = np.array([1.0, -1.0])


@pytest.mark.parametrize("command", ["analyze", "identify"])
@pytest.mark.parametrize(
    ("effort", "said"),
    [
        (1e200 * ALTERNATING, "values left out: effort is infinite or larger than 1e+12"),
        (5e-324 * ALTERNATING, "values left out: effort is denormal (below 2.2e-308), as memory that nobody wrote is"),
        (0.0 * ALTERNATING, "its effort is always 0, which no joint that moves measures: it counts as unknown"),
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
