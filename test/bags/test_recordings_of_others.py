# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34: recordings as other programs write them; each test is a row of docs/recordings.md#what-is-read."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from support_bags import JOINT_STATE, joint_state, simulated_bag, write_mcap

from stickslip_ros.bags.joint_samples import read_joint
from stickslip_ros.cli.main import main
from stickslip_ros.messages.whole_turns import WholeTurns

TURN = 2.0 * math.pi


def wrapped(values: np.ndarray, least: float) -> np.ndarray:
    """Positions within one turn from the least one on."""
    return np.mod(values - least, TURN) + least


@pytest.mark.parametrize("least", [-math.pi, 0.0])
def test_a_continuous_joint_that_wraps(least: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is judged as if it did not, and that is said; positions that jump otherwise are left alone."""
    plain = read_joint(simulated_bag(tmp_path / "plain.mcap"), "joint1")
    found = {}
    for name, position, wanted in (
        ("plain", plain.position, plain.reference_position),
        ("wrapped", *(wrapped(one + least - 0.03, least) for one in (plain.position, plain.reference_position))),
    ):
        messages = []
        for time, value, reference in zip(plain.time, position, wanted, strict=True):
            message = joint_state(time, ["joint1"], position=[reference])
            messages.append(("/joint_references", JOINT_STATE, time, message))
            messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["joint1"], position=[value])))
        write_mcap(tmp_path / "a.mcap", messages)
        assert main(["analyze", str(tmp_path / "a.mcap"), "--json", "--no-learning"]) == 0
        found[name] = json.loads(capsys.readouterr().out)["bags"][0]
    assert "joint1: position wraps at a whole turn" in " ".join(found["wrapped"]["warnings"])
    one, other = (found[name]["joints"]["joint1"] for name in ("plain", "wrapped"))
    assert one["status"] == other["status"] == "stick_slip"
    assert len(one["cycles"]) == len(other["cycles"])
    assert "wraps" not in " ".join(found["plain"]["warnings"])


@pytest.mark.parametrize("size", [1, 7, 400])
def test_whole_turns_are_removed_alike_in_batches_of_any_size(size: int) -> None:
    """Three turns forwards and back, with gaps; a joint that counts its turns, or is wrong once, is left alone."""
    times = np.arange(0.0, 8.0, 0.02)
    motion = 9.0 * np.sin(times)
    broken = motion.copy()
    broken[50:52] = np.nan
    cases = [(wrapped(broken, -math.pi), broken), (motion, motion)]
    glitch = np.full(len(times), 0.6)
    glitch[100] = -math.pi
    cases.append((glitch, glitch))
    for number, (given, right) in enumerate(cases):
        turns = WholeTurns()
        rows = np.column_stack([times, given])
        parts = [turns.removed("a", rows[begin : begin + size])[:, 1] for begin in range(0, len(rows), size)]
        np.testing.assert_allclose(np.concatenate(parts), right, atol=1e-9)
        assert bool(turns.counts) == (number == 0)
