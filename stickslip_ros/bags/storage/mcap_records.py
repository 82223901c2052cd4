# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Records of MCAP files, as its specification has them: the fields that a reader of messages needs."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

_BY_CHANNEL = np.dtype([("channel", "<u2"), ("value", "<u8")])


class Opcode(IntEnum):
    """Kinds of records."""

    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    DATA_END = 0x0F


class _Fields:
    """The fields of a record, in their order.

    Raises
    ------
    ValueError
        From every method, if the record ends before the field does.
    """

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def data(self, size: int) -> bytes:
        begin, self._at = self._at, self._at + size
        if self._at > len(self._content):
            raise ValueError("it ends in the midst of a field")
        return self._content[begin : self._at]

    def number(self, size: int) -> int:
        return int.from_bytes(self.data(size), "little")

    def text(self) -> str:
        return self.data(self.number(4)).decode()

    def by_channel(self) -> dict[int, int]:
        table = np.frombuffer(self.data(self.number(4)), dtype=_BY_CHANNEL)
        return dict(zip(table["channel"].tolist(), table["value"].tolist(), strict=True))


class Schema(NamedTuple):
    """The definition of a type of messages."""

    id: int
    name: str
    encoding: str
    data: bytes

    @staticmethod
    def read(content: bytes) -> Schema:
        """The record; ValueError if it is damaged, as of all of them."""
        fields = _Fields(content)
        return Schema(fields.number(2), fields.text(), fields.text(), fields.data(fields.number(4)))


class ChannelRecord(NamedTuple):
    """A channel: a topic as one publisher had it."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str

    @staticmethod
    def read(content: bytes) -> ChannelRecord:
        """The record."""
        fields = _Fields(content)
        return ChannelRecord(fields.number(2), fields.number(2), fields.text(), fields.text())


class Chunk(NamedTuple):
    """Records, compressed together."""

    uncompressed_size: int
    uncompressed_crc: int
    compression: str
    data: bytes

    @staticmethod
    def read(content: bytes) -> Chunk:
        """The record."""
        fields = _Fields(content)
        fields.data(16)  # first and last time
        return Chunk(fields.number(8), fields.number(4), fields.text(), fields.data(fields.number(8)))


class ChunkIndex(NamedTuple):
    """Where a chunk is [bytes], and what channels have messages in it."""

    begin: int
    length: int
    channels: frozenset[int]

    @staticmethod
    def read(content: bytes) -> ChunkIndex:
        """The record."""
        fields = _Fields(content)
        fields.data(16)  # first and last time
        return ChunkIndex(fields.number(8), fields.number(8), frozenset(fields.by_channel()))


def footer(content: bytes) -> tuple[int, int]:
    """Where the summary begins [bytes], and its checksum; 0 where there is none."""
    fields = _Fields(content)
    summary, _, checksum = fields.number(8), fields.number(8), fields.number(4)
    return summary, checksum


def messages_by_channel(content: bytes) -> dict[int, int]:
    """Numbers of messages, of a record of statistics."""
    fields = _Fields(content)
    fields.data(42)  # totals, first and last time
    return fields.by_channel()
