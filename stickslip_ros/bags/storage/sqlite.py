# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The .db3 files of rosbag2, as blocks of messages.

Read through Python's sqlite3: readers of whole bags also parse each topic's quality of service as YAML, which in a
file of others need not end. A view in place of a table, or a computed column, would be a program that is run.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any
from urllib.parse import quote

from stickslip_ros.bags.storage.formats import BagFile
from stickslip_ros.messages.joint_states import Block, Channel, Warn, blocks_of, counts_by_channel, with_progress

_ENCODINGS = ("ros2msg", "ros2idl")
_COLUMNS = {"topics": ("id", "name", "type", "serialization_format"), "messages": ("topic_id", "timestamp", "data")}
_DEFINITIONS = ("topic_type", "encoding", "encoded_message_definition")
_DAMAGE = (sqlite3.Error, ValueError, TypeError, OverflowError, MemoryError)


class SqliteStorage:
    """One .db3 file.

    Parameters
    ----------
    file : the file. warn : told what is lost.
    """

    def __init__(self, file: BagFile, warn: Warn) -> None:
        self._path, self._warn, self._name = file.plain(), warn, file.name
        self._largest = file.allowance.limit.at_once
        self._channels: dict[int, Channel] = {}
        self._counts: dict[int, int] = {}

    def channels(self) -> dict[Channel, int]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`.

        Raises
        ------
        ValueError
            If this is no such file.
        """
        try:
            with self._open() as database:
                schemas = _definitions(database)
                rows = database.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id")
                for number, topic, kind, encoding in rows:
                    schema_encoding, schema = schemas.get(str(kind), ("", ""))
                    self._channels[int(number)] = Channel(
                        topic=str(topic), type=str(kind), encoding=str(encoding),
                        schema_encoding=schema_encoding, schema=schema,
                    )  # fmt: skip
                try:
                    self._counts = dict(database.execute("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"))
                except sqlite3.DatabaseError:
                    # It is damaged; reading shows how far its messages go.
                    self._counts = dict.fromkeys(self._channels, 1)
        except _DAMAGE as error:
            raise ValueError(f"not a rosbag2 database: {' '.join(str(error).split())}") from error
        return counts_by_channel(self._channels, self._counts)

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """See :class:`~stickslip_ros.messages.joint_states.Storage`."""
        numbers = {number: channel for number, channel in self._channels.items() if channel in wanted}
        total = sum(self._counts.get(number, 0) for number in numbers)
        if numbers:
            yield from with_progress(self._read(numbers), total, self._path.stat().st_size, progress)

    def _read(self, channels: dict[int, Channel]) -> Iterator[Block]:
        count = 0
        try:
            with self._open() as database:
                for block in blocks_of(self._messages(database, set(channels)), channels):
                    count += len(block)
                    yield block
        except _DAMAGE as error:
            self._warn(f"{self._name}: reading stopped after {count} messages: {' '.join(str(error).split())}")

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        # What is written meanwhile does not count, and no journal is looked for beside the file.
        address = f"file:{quote(str(self._path.resolve()))}?mode=ro&immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as database:
            database.text_factory = lambda value: value.decode("utf-8", errors="replace")
            for table, columns in _COLUMNS.items():
                _check_table(database, table, columns)
            yield database

    def _messages(self, database: sqlite3.Connection, numbers: set[int]) -> Iterator[tuple[int, int, bytes]]:
        left_out = 0
        # The order is that of the index of times, where there is one.
        found = database.execute(
            "SELECT topic_id, timestamp, CASE WHEN length(data) <= ? THEN data END FROM messages "
            "WHERE topic_id IN (SELECT value FROM json_each(?)) ORDER BY timestamp",
            (self._largest, json.dumps(sorted(numbers))),
        )
        for number, time, data in found:
            if isinstance(data, bytes) and isinstance(time, int):
                yield number, time, data
            else:
                left_out += 1
        if left_out:
            self._warn(f"{self._name}: {left_out} messages are no bytes, or more than can be")


def _check_table(database: sqlite3.Connection, table: str, columns: tuple[str, ...]) -> None:
    """Refuse what is no plain table with these columns.

    Raises
    ------
    ValueError
        If it is not.
    """
    found = database.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)).fetchone()
    if found is None or found[0] != "table" or str(found[1]).upper().split()[:2] != ["CREATE", "TABLE"]:
        raise ValueError(f"{table!r} must be a plain table in it")
    # Name and kind of each column: 0 is one that is stored.
    stored = {str(row[1]): row[6] for row in database.execute(f"PRAGMA table_xinfo({table})")}
    for column in columns:
        if stored.get(column) != 0:
            raise ValueError(f"its table {table!r} must have a column {column!r} that is stored")


def _definitions(database: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    """Encoding and text of each type's definition, where that is known; bags of before Iron have none."""
    try:
        _check_table(database, "message_definitions", _DEFINITIONS)
    except ValueError:
        return {}
    rows: Any = database.execute(f"SELECT {', '.join(_DEFINITIONS)} FROM message_definitions ORDER BY id DESC")
    return {str(kind): (encoding, str(text)) if encoding in _ENCODINGS else ("", "") for kind, encoding, text in rows}
