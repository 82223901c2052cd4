# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Episodes of LeRobot data sets, as blocks of messages: their rows as JointStates."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path

from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import load_table
from stickslip_ros.bags.writing import joint_state_streams
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.messages.joint_states import Block, Channel, Warn, blocks_of

_FIRST_STAMP = 1.0  # [s] of a recording whose times begin at zero: a stamp of zero means that there is none


class EpisodeStorage:
    """One episode of a LeRobot data set; see :class:`~stickslip_ros.messages.joint_states.Storage`.

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
        _, streams = joint_state_streams(table.batches, _FIRST_STAMP)
        self._messages = {Channel(topic=topic, type=JOINT_STATE): list(stream) for topic, stream in streams.items()}

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        return {channel: len(messages) for channel, messages in self._messages.items()}

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        chosen = [channel for channel in self._messages if channel in wanted]
        numbers = {channel.topic: number for number, channel in enumerate(chosen)}
        merged = heapq.merge(*(self._messages[channel] for channel in chosen), key=lambda one: one[0])
        yield from blocks_of(((numbers[topic], time, data) for time, topic, data in merged), dict(enumerate(chosen)))
