# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Tables of samples as bags: written as files, or read as one (episodes of LeRobot data sets)."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from stickslip_ros.bags.simulated import GAINS, LAST_STAMP, REFERENCES, STATES
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import load_table
from stickslip_ros.bags.writing import BagWriter, Serialized, serialized_joint_states
from stickslip_ros.messages.blocks import Block, Channel, Warn, blocks_of
from stickslip_ros.messages.content import DESCRIPTION, robot_description
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray

FIRST_STAMP = 1.0  # [s] of a recording whose times begin at zero: a stamp of zero means that there is none


def _streams(batches: Mapping[str, Batch], start: float) -> tuple[FloatArray, dict[str, Iterator[Serialized]]]:
    """Stamps [s]; joint states and, if there are any, references of joints as serialized JointStates, by topic.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples whose time no stamp can be are left out.
    start : what is added to the times [s].
    """
    names = tuple(batches)
    times = batches[names[0]].time + start
    known = (times >= 0.0) & (times <= LAST_STAMP)
    times = times[known]
    parts = [batch.where(known) for batch in batches.values()]
    nothing = np.full(len(times), np.nan)
    states = np.stack([np.stack([one.position, one.velocity, one.effort], axis=1) for one in parts], axis=2)
    references = np.stack(
        [np.stack([one.reference_position, one.reference_velocity, nothing], axis=1) for one in parts], axis=2
    )
    streams = {STATES: serialized_joint_states(STATES, names, times, states)}
    if np.isfinite(references).any():
        # Before the samples that they are the references of.
        streams = {REFERENCES: serialized_joint_states(REFERENCES, names, times, references), **streams}
    return times, streams


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
    times, streams = _streams(batches, start)
    # The states' channel is the first in the file.
    topics = {topic: JOINT_STATE for topic in (STATES, REFERENCES) if topic in streams}
    if gains is not None:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    if prismatic:
        topics[DESCRIPTION] = "std_msgs/msg/String"
    with BagWriter(path, topics, compression) as writer:
        if prismatic and len(times):
            text = writer.message("std_msgs/msg/String", data=robot_description(names, prismatic))
            writer.write([writer.serialized(round(float(times[0]) * 1e9), DESCRIPTION, text)])
        if gains is not None and len(times):
            kinds = {"p": gains.stiffness, "i": gains.integral, "d": gains.damping}
            kinds = {kind: gain for kind, gain in kinds.items() if kind != "i" or gain}
            values = np.tile([float(value) for value in kinds.values()], (len(names), 1))
            table = writer.table(",".join(names), ",".join(kinds), values)
            writer.write([writer.serialized(round(float(times[0]) * 1e9), GAINS, table)])
        writer.write(*streams.values())
    return len(times)


class EpisodeStorage:
    """One episode; see :class:`~stickslip_ros.messages.blocks.Storage`.

    Parameters
    ----------
    path : of the episode. limit : of what is unpacked. warn : told what is not known of it.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """

    def __init__(self, path: Path, limit: UnpackLimit, warn: Warn) -> None:
        table = load_table(path, limit=limit)
        for note in table.notes:
            warn(note)
        # Times of an episode begin at zero, which as a stamp means that there is none.
        _, streams = _streams(table.batches, FIRST_STAMP)
        self._channels = {
            number: Channel(topic=topic, type=JOINT_STATE, encoding="cdr", schema_encoding="", schema="")
            for number, topic in enumerate(streams)
        }
        self._messages = [
            [(time, number, data) for time, _, data in stream] for number, stream in enumerate(streams.values())
        ]

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.blocks.Storage`."""
        return {channel: len(self._messages[number]) for number, channel in self._channels.items()}

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.blocks.Storage`."""
        chosen = [some for number, some in enumerate(self._messages) if self._channels[number] in wanted]
        merged = heapq.merge(*chosen, key=lambda one: one[0])
        yield from blocks_of(((number, time, data) for time, number, data in merged), self._channels)
