# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip reversal`: what it prints, draws and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.cli.main import main

JOINT = "--joint puma560_joint1 --stiffness 6300 --damping 200"


def run(command: str, status: int = 0) -> None:
    """Run `stickslip reversal`."""
    assert main(["reversal", *command.split()]) == status


def test_a_sine(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: a sentence, then a row for each reversal."""
    run(f"{JOINT} --amplitude 0.02 --frequency 0.05")
    output = capsys.readouterr().out
    assert (
        "Where a sine of ±0.02 rad at 0.05 Hz (up to 0.00628 rad/s) turns round, the joint stands for 1.79 s" in output
    )
    assert "falls behind by up to 1.63 mrad, then runs." in output
    assert output.count("mrad") >= 2 * 3


def test_json_has_all_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: one object, null for what is infinite."""
    run(f"{JOINT} --amplitude 0.02 --frequency 0.05 --triangle --json")
    (first, second) = json.loads(capsys.readouterr().out)["reversals"]
    assert {first["direction"], second["direction"]} == {1, -1}
    assert first["standing"] > 0
    run(f"{JOINT} --amplitude 0.0002 --frequency 0.05 --json")
    assert json.loads(capsys.readouterr().out)["reversals"][0]["standing"] is None


def test_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: the motion, its error, and both against speed and amplitude, with the numbers beside it."""
    run(f"{JOINT} --amplitude 0.02 --frequency 0.5 --out {tmp_path / 'reversal.png'}")
    assert {path.name for path in tmp_path.iterdir()} == {"reversal.png", "reversal.svg", "reversal.csv"}
    numbers = (tmp_path / "reversal.csv").read_text(encoding="utf-8")
    for curve in ("reference", "joint", "±5 mrad", "±20 mrad", "±80 mrad"):
        assert curve in numbers
    assert str(tmp_path / "reversal.png") in capsys.readouterr().out


def test_a_trajectory_of_the_users_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: any motion that turns round, as a table of time and position."""
    times = np.arange(0.0, 20.0, 0.01)
    path = tmp_path / "there_and_back.csv"
    np.savetxt(
        path, np.column_stack([times, 0.05 * np.sin(times)]), delimiter=",", header="time_s,position_rad", comments=""
    )
    run(f"{JOINT} --trajectory {path} --json")
    turns = json.loads(capsys.readouterr().out)["reversals"]
    assert [turn["time"] for turn in turns] == pytest.approx(np.pi * (0.5 + np.arange(6)), abs=0.02)
    straight = tmp_path / "straight.csv"
    np.savetxt(straight, np.column_stack([times, times]), delimiter=",", header="time_s,position_rad", comments="")
    run(f"{JOINT} --trajectory {straight}", status=2)
    assert "does not turn round" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "give --amplitude, or a --trajectory"),
        ("--amplitude 0.1", "give --frequency, or a --trajectory"),
        ("--amplitude -0.1 --frequency 1", "'--amplitude' must be finite and > 0: -0.1"),
        ("--amplitude 0.1 --frequency 1e-9", "'--frequency' must be >= "),
        ("--amplitude 0.1 --frequency 1 --trajectory x.csv", "'--amplitude' must be left out where there is a --traj"),
        (
            "--amplitude 0.1 --frequency 1 --contact lugre --presliding-stiffness 0",
            "'--presliding-stiffness' must be > 0",
        ),
        ("--amplitude 0.1 --frequency 1 --stiffness 0", "'--stiffness' must be finite and > 0"),
    ],
)
def test_what_is_refused(capsys: pytest.CaptureFixture[str], options: str, said: str) -> None:
    """Issue 23: in one line, with the name that was typed."""
    run(f"{JOINT} {options}", status=2)
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
