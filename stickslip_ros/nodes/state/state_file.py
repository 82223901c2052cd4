# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What was learnt, kept in a file: written whole or not at all, and used only if it is as it was written."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stickslip_ros.errors import StickSlipError
from stickslip_ros.files import write_whole
from stickslip_ros.monitoring.friction.change import FrictionChange, ParameterDifference
from stickslip_ros.monitoring.joint_monitor import JointMemory
from stickslip_ros.nodes.state.plain_data import from_plain, sealed, to_plain, unsealed
from stickslip_ros.regular_files import read_regular

_FORMAT = "stickslip_ros state"
_VERSION = 3
# Keys of version 2, of what updates by single slips started from.
_OF_UPDATES = ("information", "prior", "spread", "widening")
_USER_ONLY = 0o600  # permissions of a file, mode bits: the user alone reads and writes it
_LARGEST = 256_000_000  # size of the file, bytes: a larger file is no state
# Sentence of version 1, whatever the sentence in diagnostics is today.
_SENTENCE = re.compile(r"friction changed abruptly at (?P<time>\S+) s(?P<anew>; learning anew)?(?:: (?P<what>.*))?")
_DIFFERENCE = re.compile(r"(?P<name>[a-z ]+) (?P<old>\S+) to (?P<new>\S+)")


class StateFileError(StickSlipError, ValueError):
    """A file that is no state, or damaged; the text has the reason."""


def default_path(node_name: str) -> Path:
    """Path of the state of a node of this fully qualified name, in ROS_HOME or ~/.ros."""
    home = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
    # Node names have letters, digits and underscores alone; other characters are left out of the path.
    words = ["".join(c for c in word if c.isalnum() or c == "_") for word in node_name.split("/")]
    return home / "stickslip_ros" / f"{'.'.join(word for word in words if word)}.json"


def read_state(path: Path) -> dict[str, JointMemory]:
    """State of each joint; empty where there is no file.

    Raises
    ------
    NewerVersionError
        If a later release wrote the file.
    StateFileError
        If the file is damaged or no state.
    OSError
        If the file cannot be read, or is no regular file.
    """
    try:
        text = read_regular(path, _LARGEST)
    except FileNotFoundError:
        return {}
    try:
        version, body = unsealed(text, _FORMAT, _VERSION)
        joints: dict[str, Any] = json.loads(body)
        if version < _VERSION:
            joints = {name: as_of_now(data, version) for name, data in joints.items()}
        return {name: from_plain(JointMemory, data) for name, data in joints.items()}
    except (ValueError, RecursionError, AttributeError) as error:
        raise StateFileError(str(error)) from error


def as_text(joints: Mapping[str, JointMemory]) -> bytes:
    """Content of the file."""
    return sealed(_FORMAT, _VERSION, json.dumps({name: to_plain(memory) for name, memory in joints.items()}))


def write_state(path: Path, text: bytes) -> None:
    """Replace the file in one step; the user alone may read it, and a link to it stays.

    Raises
    ------
    OSError
        If there is no room, or no permission; the old file is then unchanged.
    """
    Path(os.path.realpath(path)).parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, text, mode=_USER_ONLY, durable=True)


def set_aside(path: Path) -> Path:
    """Rename a damaged file, in place of an earlier damaged one; returns the new path."""
    # A link to the file stays, and leads to the next file.
    path = Path(os.path.realpath(path))
    aside = path.with_name(f"{path.name}.damaged")
    path.replace(aside)
    return aside


def as_of_now(joint: Any, version: int) -> Any:
    """A joint's plain data of an earlier version in the present layout; unexpected data stay, and are refused later.

    Version 1 had an abrupt change of friction as a sentence, version 2 what updates by single slips started from.
    """
    friction = joint.get("friction") if isinstance(joint, Mapping) else None
    if not isinstance(friction, Mapping):
        return joint
    kept = dict(friction)
    if version == 1 and isinstance(kept.get("notice"), str):
        kept["change"] = to_plain(_change(kept.pop("notice")))
    if isinstance(kept.get("learnt"), Mapping):
        kept["learnt"] = {name: value for name, value in kept["learnt"].items() if name not in _OF_UPDATES}
    return {**joint, "friction": kept}


def _change(sentence: str) -> FrictionChange | None:
    """The change that a sentence describes, None if it describes none."""
    match = _SENTENCE.fullmatch(sentence)
    if match is None:
        return None
    parts = [_DIFFERENCE.fullmatch(part) for part in (match["what"] or "").split(", ")]
    try:
        return FrictionChange(
            time=float(match["time"]),
            learning_anew=match["anew"] is not None,
            differences=tuple(
                ParameterDifference(name=part["name"].replace(" ", "_"), old=float(part["old"]), new=float(part["new"]))
                for part in parts
                if part is not None
            ),
        )
    except ValueError:
        return None
