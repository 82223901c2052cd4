# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The .db3 files of rosbag2, through the package rosbags, as blocks of messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

from stickslip_ros.bags.storage.bag_file import BagFile
from stickslip_ros.messages.blocks import Block, Channel, Warn

_MESSAGES = 4096  # in a block


class SqliteStorage:
    """One .db3 file.

    Parameters
    ----------
    file : the file. warn : told what is lost.
    """

    def __init__(self, file: BagFile, warn: Warn) -> None:
        # The library takes it for a database by its name, and reads no stream.
        self._path, self._warn, self._name = file.named(".db3"), warn, file.name

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.blocks.Storage`.

        Raises
        ------
        ValueError
            If this is no such file.
        """
        from rosbags.rosbag2 import Reader

        try:
            with Reader(self._path) as reader:
                return {_channel(one): one.msgcount for one in reader.connections}
        except Exception as error:
            # The database's exceptions are not the library's.
            raise ValueError(f"not a rosbag2 database: {' '.join(str(error).split())}") from error

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.blocks.Storage`."""
        from rosbags.rosbag2 import Reader

        size, told, taken = self._path.stat().st_size, 0, 0
        try:
            with Reader(self._path) as reader:
                chosen = [one for one in reader.connections if _channel(one) in wanted]
                numbers = {one.id: _channel(one) for one in chosen}
                total = max(sum(one.msgcount for one in chosen), 1)
                if not chosen:
                    return
                messages = ((one.id, time, data) for one, time, data in reader.messages(connections=chosen))
                while batch := list(islice(messages, _MESSAGES)):
                    yield Block.of_messages(batch, numbers)
                    taken += len(batch)
                    progress(size * min(taken, total) // total - told)
                    told = size * min(taken, total) // total
        except GeneratorExit:
            raise
        except Exception as error:
            self._warn(f"{self._name}: reading stopped after {taken} messages: {' '.join(str(error).split())}")
        progress(size - told)


def _channel(connection: Any) -> Channel:
    definition = connection.msgdef
    encoding = {"MSG": "ros2msg", "IDL": "ros2idl"}.get(definition.format.name, "")
    return Channel(
        topic=connection.topic,
        type=connection.msgtype,
        encoding=connection.ext.serialization_format,
        schema_encoding=encoding,
        schema=definition.data if encoding else "",
    )
