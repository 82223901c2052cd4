# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bag files of ROS 1, as blocks of messages; the package rosbags reads them, `bag.py` makes them ROS 2's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from stickslip_ros.bags.storage.formats import BagFile
from stickslip_ros.errors import reason
from stickslip_ros.messages.joint_states import Block, Channel, Warn, blocks_of, counts_by_channel, with_progress


class Ros1Storage:
    """One .bag file; see :class:`~stickslip_ros.messages.joint_states.Storage`.

    Parameters
    ----------
    file : the file. warn : told what is lost.

    Raises
    ------
    ValueError
        If it is damaged, or has no index.
    """

    def __init__(self, file: BagFile, warn: Warn) -> None:
        from rosbags.rosbag1 import Reader
        from rosbags.rosbag1.reader import decompressors

        self._file, self._warn = file, warn
        self._reader = Reader(file.plain())
        try:
            self._reader.open()
        except Exception as error:
            # What damaged bytes make the package raise cannot be listed.
            text = reason(error)
            hint = " (rosbag reindex makes one)" if "not indexed" in text else ""
            raise ValueError(f"not a sound bag of ROS 1: {text}{hint}") from error
        file.at_close(self._reader.close)
        # What compressed data may become is bounded as everywhere.
        unpack = {decompressors["bz2"]: file.allowance.bz2, decompressors["lz4"]: file.allowance.lz4}
        self._reader.chunks = {
            place: chunk._replace(decompressor=unpack.get(chunk.decompressor, chunk.decompressor))
            for place, chunk in self._reader.chunks.items()
        }

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        connections = self._reader.connections
        return counts_by_channel(
            {one.id: _channel(one) for one in connections}, {one.id: one.msgcount for one in connections}
        )

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        self._file.allowance.restart()
        chosen = [one for one in self._reader.connections if _channel(one) in wanted]
        channels = {one.id: _channel(one) for one in chosen}
        total = sum(one.msgcount for one in chosen)
        yield from with_progress(self._read(chosen, channels), total, self._file.size, progress)

    def _read(self, connections: list[Any], channels: dict[int, Channel]) -> Iterator[Block]:
        try:
            found = self._reader.messages(connections) if connections else ()
            yield from blocks_of(((one.id, time, bytes(data)) for one, time, data in found), channels)
        except Exception as error:
            # As above.
            self._warn(f"{self._file.name}: damaged; the rest of it is lost: {reason(error)}")


def _channel(connection: Any) -> Channel:
    return Channel(
        topic=connection.topic,
        type=connection.msgtype,
        encoding="ros1",
        schema_encoding="ros1msg",
        schema=connection.msgdef.data,
    )
