# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled walks through bytes: the records of an MCAP file, and JointState messages of one layout."""

from __future__ import annotations

import numpy as np
from numba import njit

MESSAGE = 0x05
_HEADER = 9  # opcode and length
_MESSAGE_HEADER = 22  # channel, sequence, log time, publish time

# Columns of the table of records.
OPCODE, OFFSET, LENGTH, CHANNEL, LOG_TIME = range(5)
COLUMNS = 5


@njit(cache=True)
def _number(buffer, at, size):
    """A little-endian number; what does not fit an int64 comes out negative."""
    value = np.int64(0)
    for n in range(size):
        value |= np.int64(buffer[at + n]) << np.int64(8 * n)
    return value


@njit(cache=True)
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
        row = table[count]
        row[OPCODE], row[OFFSET], row[LENGTH], row[CHANNEL], row[LOG_TIME] = opcode, content, length, -1, 0
        if opcode == MESSAGE:
            row[OFFSET], row[LENGTH] = content + _MESSAGE_HEADER, length - _MESSAGE_HEADER
            row[CHANNEL], row[LOG_TIME] = _number(buffer, content, 2), _number(buffer, content + 6, 8)
        count += 1
        at = content + length
    return count, at, 0, True


@njit(cache=True)
def matching(buffer, offsets, lengths, template, mask, least, most):
    """Which messages agree with a template in all bytes that a mask of 0 and 255 leaves, and have its length."""
    matches = np.zeros(offsets.shape[0], dtype=np.bool_)
    for n in range(offsets.shape[0]):
        if lengths[n] < least or lengths[n] > most:
            continue
        message = buffer[offsets[n] : offsets[n] + template.shape[0]]
        # Without a way out of the loop it compares many bytes at once.
        differs = np.uint8(0)
        for k in range(template.shape[0]):
            differs |= (message[k] ^ template[k]) & mask[k]
        matches[n] = differs == 0
    return matches


@njit(cache=True)
def gather(buffer, offsets, places, sizes, out):
    """Copy parts of every message, one after the other, into its row of bytes."""
    for n in range(offsets.shape[0]):
        row, to = out[n], 0
        for p in range(places.shape[0]):
            begin = offsets[n] + places[p]
            row[to : to + sizes[p]] = buffer[begin : begin + sizes[p]]
            to += sizes[p]
