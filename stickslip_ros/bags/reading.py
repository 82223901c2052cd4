# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples and references of one joint from an MCAP file with sensor_msgs/JointState."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.recordings import RecordingError

_TYPE = "sensor_msgs/msg/JointState"
_REFERENCES = "joint_references"


def read_joint(path: Path, joint: str) -> Batch:
    """Everything recorded of one joint: states, and references from topics that end in `joint_references`.

    Raises
    ------
    RecordingError
        If the file cannot be read, or has nothing of the joint; the message lists the joints that are there.
    """
    from stickslip_ros.nodes.conversion import MessageError, joint_rows, seconds
    from stickslip_ros.nodes.reference_pairing import ReferencePairing

    pairing = ReferencePairing()
    there: set[str] = set()
    batches = []
    for topic, message in _joint_states(path):
        try:
            rows = joint_rows(message)
        except MessageError:
            continue
        time = seconds(message.header.stamp)
        if topic.endswith(_REFERENCES):
            if joint in rows:
                pairing.add_reference(time, rows[joint][0], rows[joint][1])
            continue
        there |= set(rows)
        if joint in rows:
            pairing.add_sample(time, *rows[joint])
            batch = pairing.take()
            if batch is not None:
                batches.append(batch)
    last = pairing.take()
    batches += [last] if last is not None else []
    if not batches:
        names = ", ".join(sorted(there)) or "none"
        raise RecordingError(f"bag {path}: no samples of joint {joint!r}; joints there: {names} (choose one with --on)")
    return Batch.joined(batches)


def _joint_states(path: Path) -> Iterator[tuple[str, Any]]:
    """Topic and message of every JointState, in the order recorded."""
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import JointState
    except ImportError as error:
        raise RecordingError(f"bag {path}: reading it needs {error.name} (pip install mcap; ROS 2 sourced)") from error
    try:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages():
                if schema is not None and schema.name == _TYPE:
                    yield channel.topic, deserialize_message(message.data, JointState)
    except (OSError, McapError, ValueError) as error:
        raise RecordingError(f"bag {path}: {' '.join(str(error).split()) or type(error).__name__}") from error
