# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A compiled walk through the records of an MCAP file."""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, kernel

MESSAGE = 0x05
_HEADER = 9  # opcode and length
_MESSAGE_HEADER = 22  # channel, sequence, log time, publish time

# Columns of the table of records.
OPCODE, OFFSET, LENGTH, CHANNEL, LOG_TIME = range(5)
COLUMNS = 5


@helper()
def _number(buffer, at, size):
    """A little-endian number; what does not fit an int64 comes out negative."""
    value = np.int64(0)
    for n in range(size):
        value |= np.int64(buffer[at + n]) << np.int64(8 * n)
    return value


@kernel()
def walk(buffer, start, largest, table):
    """List the records that lie wholly in ``buffer[start:]``.

    Of a message the table has the place of its data, its channel and log time; of other records the place of their
    content. Returns how many were found, where the next one begins, how many bytes that one needs (0 if its header
    is cut off), and whether all of them can be records.
    """
    count, at, size = 0, start, buffer.shape[0]
    while count < table.shape[0]:
        if at + _HEADER > size:
            return count, at, 0, True
        opcode, length = buffer[at], _number(buffer, at + 1, 8)
        if opcode == 0 or length < 0 or length > largest or (opcode == MESSAGE and length < _MESSAGE_HEADER):
            return count, at, 0, False
        content = at + _HEADER
        if content + length > size:
            return count, at, _HEADER + length, True
        table[count, OPCODE] = opcode
        if opcode == MESSAGE:
            table[count, OFFSET], table[count, LENGTH] = content + _MESSAGE_HEADER, length - _MESSAGE_HEADER
            table[count, CHANNEL], table[count, LOG_TIME] = _number(buffer, content, 2), _number(buffer, content + 6, 8)
        else:
            table[count, OFFSET], table[count, LENGTH], table[count, CHANNEL], table[count, LOG_TIME] = (
                content,
                length,
                -1,
                0,
            )
        count += 1
        at = content + length
    return count, at, 0, True
