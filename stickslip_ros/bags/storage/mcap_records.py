# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Records of MCAP files, as its specification has them: the fields that a reader of messages needs."""

from __future__ import annotations

from enum import IntEnum

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


class Fields:
    """The fields of a record, in their order.

    Raises
    ------
    ValueError
        From every method, if the record ends before the field does.
    """

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def data(self, size: int) -> bytes:
        """The next bytes."""
        begin, self._at = self._at, self._at + size
        if self._at > len(self._content):
            raise ValueError("it ends in the midst of a field")
        return self._content[begin : self._at]

    def number(self, size: int) -> int:
        """An integer of so many bytes."""
        return int.from_bytes(self.data(size), "little")

    def text(self) -> str:
        """A text, after its length."""
        return self.data(self.number(4)).decode()

    def by_channel(self) -> dict[int, int]:
        """A number for each channel."""
        table = np.frombuffer(self.data(self.number(4)), dtype=_BY_CHANNEL)
        return dict(zip(table["channel"].tolist(), table["value"].tolist(), strict=True))
