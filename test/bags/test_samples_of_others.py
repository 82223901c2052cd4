# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34: samples that cannot be what was measured, missing positions, and units, are named."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support_bags import JOINT_STATE, STORE, joint_state, write_mcap

from stickslip_ros.analysis.sample_checks import SampleChecks
from stickslip_ros.cli.main import main
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.output.wording import angle_text


def _warnings(path: Path, messages: Sequence[Any], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit status, warnings and errors of an analysis."""
    write_mcap(path, messages)
    status = main(["analyze", str(path), "--no-learning", "--json"])
    said = capsys.readouterr()
    bag = json.loads(said.out)["bags"][0] if said.out else {}
    return status, " ".join(bag.get("warnings", [])), said.err


def _messages(
    position: np.ndarray, velocity: np.ndarray | None = None, *, period: float = 0.02
) -> list[tuple[str, str, float, Any]]:
    """Joint states of one joint."""
    messages = []
    for number, value in enumerate(position.tolist()):
        fields = {"position": [value]} | ({} if velocity is None else {"velocity": [float(velocity[number])]})
        time = 1.0 + period * number
        messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["joint1"], **fields)))
    return messages


SWING = 0.4 * np.sin(0.5 * 0.02 * np.arange(2000))
RAMP = 0.006 * np.arange(2000) + 0.03 * np.sin(0.02 * np.arange(2000))
SPEED = 0.2 * np.cos(0.5 * 0.02 * np.arange(2000))


# A joint at rest, and the noise of its velocity, which is not that of its position.
STANDS, NOISE = np.array([[2e-6], [1e-3]]) * np.random.default_rng(5).standard_normal((2, 2000))


def _with(values: np.ndarray, at: Any, wrong: float) -> np.ndarray:
    found = values.copy()
    found[at] = wrong
    return found


@pytest.mark.parametrize(
    ("position", "velocity", "said"),
    [
        (np.repeat(SWING[::10], 10), None, "joint1: each value comes 10 times, 5 new ones a second of 50"),
        (np.repeat(RAMP[::10], 10), None, "joint1: each value comes 10 times, 5 new ones a second of 50"),
        (np.repeat(SWING[::10], 10), np.repeat(SPEED[::10], 10), "each value comes 10 times"),
        (_with(SWING, slice(5, None, 10), 7.0), None, "single samples stand far off both neighbours"),
        (_with(np.full(2000, 0.6) + 1e-4 * (np.arange(2000) % 7 == 0), 900, -math.pi), None, "1 sample stands far off"),
        (SWING, np.rad2deg(SPEED), "its velocity is 57.3 times what its position says: is the velocity in degrees?"),
        (np.rad2deg(SWING), SPEED, "what its position says: is the position in degrees?"),
        (SWING, -SPEED, "its velocity has the other sign than the change of its position"),
        (SWING, np.zeros(2000), "its velocity is zero where its position changes"),
        (SWING, np.cos(2.3 * np.arange(2000) ** 1.1), "its velocity contradicts its position"),
        (SWING, SPEED, ""),
        (STANDS, NOISE, ""),
        (SWING, None, ""),
        (np.round(SWING / 1e-3) * 1e-3, np.round(SPEED / 0.05) * 0.05, ""),
        (0.001 * np.floor(np.arange(2000) / 5.0), None, ""),
    ],
)
def test_samples_that_cannot_be_right(
    position: np.ndarray, velocity: np.ndarray | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Values that are republished, single wrong ones, and velocities of another unit or motion are named; what coarse
    encoders give is none of these.
    """
    _, warnings, _ = _warnings(tmp_path / "a.mcap", _messages(position, velocity), capsys)
    assert said in warnings
    assert bool(warnings) == bool(said), warnings


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (180.0 / math.pi, "its reference moves 57.3 times as far as it: is the reference in degrees?"),
        (math.pi / 180.0, "its reference moves 0.0175 times as far as it: is the position in degrees?"),
        (1000.0, "its reference moves 1e+03 times as far as it"),
        (2.0, ""),
    ],
)
def test_a_reference_in_another_unit_is_named(factor: float, said: str) -> None:
    """It hid stick-slip: 60 slips were slower than their reference in degrees, and no word said why."""
    checks = SampleChecks()
    checks.add(Batch(time=0.01 * np.arange(2000), position=SWING, reference_position=factor * SWING))
    assert checks.problems() == ([said] if said else [])


def test_a_bag_without_positions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Efforts alone cannot be judged: one line says so."""
    messages = [
        ("/joint_states", JOINT_STATE, time, joint_state(time, ["a", "b"], effort=[1.0, 2.0]))
        for time in (1.0 + 0.01 * np.arange(300)).tolist()
    ]
    status, _, error = _warnings(tmp_path / "a.mcap", messages, capsys)
    assert status == 2
    assert error.count("\n") == 1
    assert "its joint states have no positions" in error


@pytest.mark.parametrize(
    ("error", "said"), [(395.2, "395 rad"), (0.0123, "12.3 mrad"), (4.2e-6, "4.2 µrad"), (0.0, "0 rad")]
)
def test_numbers_have_a_prefix_that_fits(error: float, said: str) -> None:
    """What falls behind by much is not said in thousands of milliradians."""
    assert angle_text(error) == said


def test_prismatic_joints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A robot's description says which joints are prismatic; a table in metres becomes a bag that says it too."""
    motion = _messages(SWING)
    text = '<robot name="a"><joint type="prismatic" name="joint1"/><joint name="other" type="revolute"/></robot>'
    description = STORE.types["std_msgs/msg/String"](data=text)
    messages = [("/robot_description", "std_msgs/msg/String", 1.0, description), *motion]
    _, warnings, _ = _warnings(tmp_path / "a.mcap", messages, capsys)
    assert warnings == "positions of joint1 are in m; wherever rad is said, read m, and N for N·m"
    assert _warnings(tmp_path / "b.mcap", motion, capsys)[1] == ""
    rows = "\n".join(f"{0.02 * number:.4f},{1e3 * value},0.5" for number, value in enumerate(SWING.tolist()))
    (tmp_path / "c.csv").write_text(f"time_s,slide_pos_mm,elbow_pos_rad\n{rows}\n", encoding="utf-8")
    assert main(["convert", str(tmp_path / "c.csv"), "--out", str(tmp_path / "c.mcap")]) == 0
    assert "positions of slide are in m" in capsys.readouterr().err
    assert main(["analyze", str(tmp_path / "c.mcap"), "--no-learning", "--json"]) == 0
    bag = json.loads(capsys.readouterr().out)["bags"][0]
    assert [one for one in bag["warnings"] if "are in m" in one] == [
        "positions of slide are in m; wherever rad is said, read m, and N for N·m"
    ]
