# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled walks through bytes: the records of an MCAP file, and JointState messages of one layout."""

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


@kernel()
def matching(buffer, offsets, lengths, template, mask, least, most):
    """Which messages agree with a template in all bytes that a mask of 0 and 255 leaves, and have its length."""
    matches = np.zeros(offsets.shape[0], dtype=np.bool_)
    for n in range(offsets.shape[0]):
        if lengths[n] < least or lengths[n] > most:
            continue
        begin = offsets[n]
        # Without a way out of the loop it compares many bytes at once.
        differs = np.uint8(0)
        for k in range(template.shape[0]):
            differs |= (buffer[begin + k] ^ template[k]) & mask[k]
        matches[n] = differs == 0
    return matches


@kernel()
def gather(buffer, offsets, places, sizes, out):
    """Copy parts of every message, one after the other, into its row of bytes."""
    for n in range(offsets.shape[0]):
        to = 0
        for p in range(places.shape[0]):
            begin = offsets[n] + places[p]
            for k in range(sizes[p]):
                out[n, to + k] = buffer[begin + k]
            to += sizes[p]
