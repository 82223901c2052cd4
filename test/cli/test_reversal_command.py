# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip reversal`: what it prints, draws and refuses."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from stickslip_ros.cli.main import main

JOINT = "--model puma560_joint1 --stiffness 6300 --damping 200"


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
    assert "falls behind by up to 1.63 mrad, then moves without another stop." in output
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
    width, height = struct.unpack(">II", (tmp_path / "reversal.png").read_bytes()[16:24])
    assert (width, height) < (1500, 1500), "four panels in a row were 2,912 px wide (issue 40)"


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


def triangle_file(path: Path, spacing: float, heading: str = "time_s") -> Path:
    """±0.02 rad, four times of 10 s."""
    times = np.arange(0.0, 40.1, spacing)
    positions = np.interp(times, 10.0 * np.arange(5.0), [-0.02, 0.02, -0.02, 0.02, -0.02])
    table = np.column_stack([times, positions])
    np.savetxt(path, table, delimiter=",", header=f"{heading},position_rad", comments="", fmt="%g")
    return path


@pytest.mark.parametrize("spacing", [10.0, 5.0, 1.0, 0.01])
def test_points_may_be_far_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str], spacing: float) -> None:
    """Issue 23: the same motion by few points or by many: it was "does not turn round", and peaks were missed."""
    run(f"{JOINT} --amplitude 0.02 --frequency 0.05 --triangle --json")
    expected = json.loads(capsys.readouterr().out)["reversals"]
    run(f"{JOINT} --trajectory {triangle_file(tmp_path / 'motion.csv', spacing)} --json")
    found = json.loads(capsys.readouterr().out)["reversals"]
    assert [turn["time"] for turn in found] == pytest.approx([10.0, 20.0, 30.0], abs=0.01)
    for key in ("standing", "peak_error", "lost_motion", "running_error"):
        assert found[-1][key] == pytest.approx(expected[-1][key], rel=0.01)


def test_a_unit_of_time_is_not_guessed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: whole seconds without a unit were taken for milliseconds; now the unit is asked for, or said."""
    run(f"{JOINT} --trajectory {triangle_file(tmp_path / 'whole.csv', 1.0, 'time')}", status=2)
    assert "the unit of its column 'time' is not known; name it in the heading, as one of time_s" in (
        capsys.readouterr().err
    )
    run(f"{JOINT} --trajectory {triangle_file(tmp_path / 'parts.csv', 0.5, 'time')} --json")
    said = capsys.readouterr()
    assert json.loads(said.out)["reversals"][0]["time"] == pytest.approx(10.0, abs=0.01)
    assert "took 'time' in s; a heading such as time_ms" in said.err


def test_the_picture_is_of_what_was_computed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: with a sampled controller too, which looked at the joint once a sample of the user's."""
    command = f"{JOINT} --trajectory {triangle_file(tmp_path / 'motion.csv', 10.0)} --controller-period 0.002"
    run(f"{command} --json --out {tmp_path / 'own.png'}")
    peak = max(turn["peak_error"] for turn in json.loads(capsys.readouterr().out)["reversals"])
    assert peak == pytest.approx(1.6e-3, rel=0.02)
    lines = (tmp_path / "own.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) > 1000


def test_a_very_stiff_contact_is_rigid(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: with σ₀ beyond all rounding it did "not move at all"; "inf", which the message names, is taken."""
    found = []
    for stiffness in ("inf", "1e300", "1e14"):
        run(f"{JOINT} --amplitude 0.02 --frequency 0.05 --json --presliding-stiffness {stiffness}")
        found.append(json.loads(capsys.readouterr().out)["reversals"])
    assert found[0] == found[1] == found[2]
    assert found[0][0]["standing"] == pytest.approx(1.79, abs=0.01)


def test_unknown_coulomb_friction_is_not_taken_for_none(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: it does not cancel where a joint turns round; 0 is taken from who types it."""
    alone = "--inertia 6.3 --stiffness 6300 --damping 200 --stribeck 1.6 --stribeck-velocity 0.0058"
    motion = "--amplitude 0.02 --frequency 0.05"
    for joint in (alone, "--model dynamixel_mx106"):
        run(f"{joint} {motion}", status=2)
        assert "missing: --coulomb [N·m], on which reversals depend" in capsys.readouterr().err
    run(f"{alone} {motion} --coulomb 0")
