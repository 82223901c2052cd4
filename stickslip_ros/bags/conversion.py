# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Tables of samples as bags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.bags.robot_description import DESCRIPTION, description
from stickslip_ros.bags.simulated import GAINS, LAST_STAMP, REFERENCES, STATES
from stickslip_ros.bags.writing import BagWriter, serialized_joint_states
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray

FIRST_STAMP = 1.0  # [s] of a recording whose times begin at zero: a stamp of zero means that there is none


def _with_stamp(time: FloatArray, start: float) -> NDArray[np.bool_]:
    """Which times [s] are stamps that a message can have, once ``start`` is added."""
    stamps = time + start
    return np.asarray((stamps >= 0.0) & (stamps <= LAST_STAMP))


def joint_state_streams(batches: Mapping[str, Batch], start: float) -> dict[str, Iterator[tuple[int, bytes]]]:
    """Joint states and, if there are any, references of joints as serialized JointStates, by topic: time [ns], message.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples whose time no stamp can be are left out.
    start : what is added to the times [s].
    """
    names = tuple(batches)
    time = batches[names[0]].time
    known = _with_stamp(time, start)
    times = time[known] + start
    parts = [batch.where(known) for batch in batches.values()]
    nothing = np.full(len(times), np.nan)
    states = np.stack([np.stack([one.position, one.velocity, one.effort], axis=1) for one in parts], axis=2)
    references = np.stack(
        [np.stack([one.reference_position, one.reference_velocity, nothing], axis=1) for one in parts], axis=2
    )
    streams = {STATES: serialized_joint_states(names, times, states)}
    if np.isfinite(references).any():
        # Before the samples that they are the references of.
        streams = {REFERENCES: serialized_joint_states(names, times, references), **streams}
    return streams


def write_recording(
    path: Path,
    batches: Mapping[str, Batch],
    start: float,
    gains: Gains | None = None,
    compression: str = "zstd",
    *,
    prismatic: Sequence[str] = (),
) -> int:
    """Write samples of joints as a bag; returns how many of each.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples whose time no stamp can be are left out.
    start : what is added to the times [s]. gains : of each joint's controller then, None if unknown.
    prismatic : joints whose positions are in metres, which the bag says by a description of the robot.

    Raises
    ------
    RecordingError
        If there is a directory of that name already.
    """
    names = tuple(batches)
    time = batches[names[0]].time
    times = time[_with_stamp(time, start)] + start
    streams = joint_state_streams(batches, start)
    # The states' channel is the first in the file.
    topics = {topic: JOINT_STATE for topic in (STATES, REFERENCES) if topic in streams}
    if gains is not None:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    if prismatic:
        topics[DESCRIPTION] = "std_msgs/msg/String"
    with BagWriter(path, topics, compression) as writer:
        if prismatic and len(times):
            text = writer.message("std_msgs/msg/String", data=description(names, prismatic))
            writer.write([writer.serialized(round(float(times[0]) * 1e9), DESCRIPTION, text)])
        if gains is not None and len(times):
            kinds = {"p": gains.stiffness, "d": gains.damping}
            if gains.integral:
                kinds = {"p": gains.stiffness, "i": gains.integral, "d": gains.damping}
            values = np.tile([float(value) for value in kinds.values()], (len(names), 1))
            table = writer.table(",".join(names), ",".join(kinds), values)
            writer.write([writer.serialized(round(float(times[0]) * 1e9), GAINS, table)])
        writer.write(*([(stamp, topic, data) for stamp, data in stream] for topic, stream in streams.items()))
    return len(times)
