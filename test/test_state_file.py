# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""State files of this version and of the one before; without a node, a study or a network."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import pytest

from stickslip_ros.monitoring.friction.change import FrictionChange, ParameterDifference
from stickslip_ros.monitoring.friction.learner import LearnerMemory
from stickslip_ros.monitoring.joint_monitor import JointMemory
from stickslip_ros.nodes.kept_state import NewerVersionError, StateFileError, as_text, read_state, write_state
from stickslip_ros.output.wording import friction_change_text

AT = "friction changed abruptly at 35.9 s"


def state(version: object, **of_friction: object) -> bytes:
    """A state file of a version, with this of a joint's friction."""
    joint = {"cycles": 3, "last_cycle": None, "friction": {"configured": None, "learnt": None, **of_friction}}
    body = json.dumps({"elbow": joint}).encode()
    header = {"format": "stickslip_ros state", "version": version, "crc32": zlib.crc32(body)}
    return json.dumps(header).encode() + b"\n" + body


@pytest.mark.parametrize(
    "sentence",
    [
        "",
        f"{AT}; learning anew",
        f"{AT}: coulomb 8.43 to 4.98",
        f"{AT}: stribeck velocity 1.2e-05 to 0.00031, rise time 1.07 to 1.5e+03",
        f"{AT}: in ways that the slips since do not name",
    ],
)
def test_a_change_that_version_1_had_as_a_sentence(tmp_path: Path, sentence: str) -> None:
    """It is read, says the same again, and is kept in this version without loss."""
    path = tmp_path / "state.json"
    path.write_bytes(state(1, notice=sentence))
    memory = read_state(path)
    change = memory["elbow"].friction.change
    assert friction_change_text(change) == sentence
    assert change is None or change.learning_anew == ("anew" in sentence)
    assert memory["elbow"].cycles == 3
    write_state(path, as_text(memory))
    assert read_state(path) == memory


def test_a_sentence_that_says_nothing_here_costs_no_friction(tmp_path: Path) -> None:
    """Of a file whose checksum is right all the rest is believed."""
    path = tmp_path / "state.json"
    path.write_bytes(state(1, notice=f"{AT.replace('35.9', 'some')}; learning anew"))
    assert read_state(path)["elbow"].friction.change is None


def test_a_change_comes_back_as_it_was(tmp_path: Path) -> None:
    """To the last digit."""
    difference = ParameterDifference(name="stribeck_velocity", old=1.0 / 3.0, new=0.1)
    change = FrictionChange(time=100.0 / 7.0, learning_anew=False, differences=(difference,))
    memory = JointMemory(cycles=1, last_cycle=None, friction=LearnerMemory(configured=None, learnt=None, change=change))
    path = tmp_path / "state.json"
    write_state(path, as_text({"elbow": memory}))
    assert read_state(path) == {"elbow": memory}
    assert friction_change_text(change) == "friction changed abruptly at 14.3 s: stribeck velocity 0.333 to 0.1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (state(1, notice=None), "must have exactly"),
        (state(1, notice=7.0), "must have exactly"),
        (state(1), "must have exactly"),
        (state(2, notice=""), "must have exactly"),
        (state(2, change="learning anew"), "must have exactly"),
        (state(2, change={"time": 1.0, "learning_anew": True, "differences": 0}), "differences cannot be 0"),
        (state(4, change=None), "it has version 4; this release reads versions up to 3"),
        (state("\x1b[31m4", change=None), "not 3"),
        (state([1], change=None), r"it has version \[1\], not 3"),
    ],
)
def test_what_no_version_has_is_refused(tmp_path: Path, text: bytes, message: str) -> None:
    """Neither a sentence in place of a change nor a later version is guessed at."""
    path = tmp_path / "state.json"
    path.write_bytes(text)
    with pytest.raises((StateFileError, NewerVersionError), match=message):
        read_state(path)
