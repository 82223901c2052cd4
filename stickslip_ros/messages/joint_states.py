# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Serialized JointStates to arrays, a whole block at once.

The messages of one publisher have one layout until its names change, so that stamps and values stand at the same
places in each of them. The layout is read from one message; the others are compared with it byte by byte, in
everything but stamp and values, and then copied.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass

import numpy as np

from stickslip_ros.messages import _gather_kernel as kernel
from stickslip_ros.messages.blocks import Block, Bytes, FloatArray, Integers
from stickslip_ros.messages.content import MessageError

TYPE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
_ENCAPSULATION = 4
_STAMP = 8
_PADDING = 32  # bytes after the message, less than this: serializers reckon with more alignment than there is
_LAYOUTS_KEPT = 64
_MOST_NAMES = 4096  # no robot has more joints, but damaged bytes may seem to


@dataclass(frozen=True, kw_only=True)
class JointRows:
    """Rows of one order of names.

    Attributes
    ----------
    index : which of the messages given they are, of shape (n,).
    time : stamps [s], 0 where none was set, of shape (n,).
    values : position, velocity and effort of each joint in turn, NaN where missing, of shape (n, 3, joints).
    """

    names: tuple[str, ...]
    index: Integers
    time: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class _Layout:
    names: tuple[str, ...]
    template: Bytes
    mask: Bytes
    places: Integers
    sizes: Integers
    present: tuple[bool, bool, bool]
    length: int


class JointStateDecoder:
    """Decodes the JointStates of one topic; ``refused`` counts why messages were left out, ``fields`` are those that
    any message had.
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.fields: set[str] = set()
        self._layouts: list[_Layout] = []

    def decode(self, block: Block, chosen: Integers) -> list[JointRows]:
        """The messages of a block that are chosen by their numbers, those of one layout together."""
        found: list[JointRows] = []
        left, known = chosen, iter(self._layouts)
        while len(left):
            layout = next(known, None)
            if layout is None:
                try:
                    layout = _layout_of(block.message(int(left[0])))
                except MessageError as error:
                    self.refused[str(error)] += 1
                    left = left[1:]
                    continue
                self.fields |= {name for name, there in zip(FIELDS, layout.present, strict=True) if there}
                self._layouts = [*self._layouts[-_LAYOUTS_KEPT + 1 :], layout]
            offsets = block.offset[left]
            same = kernel.matching(
                block.buffer, offsets, block.length[left], layout.template, layout.mask,
                layout.length, layout.length + _PADDING - 1,
            )  # fmt: skip
            if same.any():
                found.append(_rows(layout, block, offsets[same], np.searchsorted(chosen, left[same])))
            left = left[~same]
        return found


def _rows(layout: _Layout, block: Block, offsets: Integers, index: Integers) -> JointRows:
    raw = np.empty((len(offsets), int(layout.sizes.sum())), dtype=np.uint8)
    kernel.gather(block.buffer, offsets, layout.places, layout.sizes, raw)
    stamps = np.ascontiguousarray(raw[:, :_STAMP])
    time = stamps.view("<i4")[:, 0].astype(float) + 1e-9 * stamps.view("<u4")[:, 1]
    values = np.full((len(offsets), len(FIELDS), len(layout.names)), np.nan)
    given = (
        np.ascontiguousarray(raw[:, _STAMP:]).view("<f8").reshape(len(offsets), sum(layout.present), len(layout.names))
    )
    values[:, list(layout.present), :] = given
    return JointRows(names=layout.names, index=index, time=time, values=values)


def rows_by_joint(found: list[JointRows], times: list[FloatArray]) -> dict[str, FloatArray]:
    """Time, position, velocity and effort of each joint in the order of the messages, whatever the order of names.

    Parameters
    ----------
    times : of the rows [s], the stamps or what stands for them.
    """
    parts: dict[str, list[tuple[Integers, FloatArray]]] = {}
    for rows, time in zip(found, times, strict=True):
        tables = np.empty((len(rows.names), len(time), 1 + len(FIELDS)))
        tables[:, :, 0], tables[:, :, 1:] = time, rows.values.transpose(2, 0, 1)
        if len(found) == 1:
            # Most publishers send one layout, in which no name occurs twice: there is nothing to join.
            return dict(zip(rows.names, tables, strict=True))
        for name, table in zip(rows.names, tables, strict=True):
            parts.setdefault(name, []).append((rows.index, table))
    joined = {}
    for name, some in parts.items():
        if len(some) == 1:
            joined[name] = some[0][1]
        else:
            order = np.argsort(np.concatenate([index for index, _ in some]), kind="stable")
            joined[name] = np.concatenate([table for _, table in some])[order]
    return joined


def places_of_values(message: bytes) -> list[int]:
    """Where the values of each field that is not empty begin in a serialized message.

    Raises
    ------
    MessageError
        If it is no JointState.
    """
    return [int(place) for place in _layout_of(message).places[1:]]


def _layout_of(message: bytes) -> _Layout:
    """Where a message has what.

    Raises
    ------
    MessageError
        If it is no JointState, or one that cannot mean anything.
    """
    if len(message) < _ENCAPSULATION + _STAMP or message[0] != 0 or message[1] != 1:
        raise MessageError("it is not encoded as little-endian CDR")
    cursor = _Cursor(message, _ENCAPSULATION + _STAMP)
    cursor.string()
    named = cursor.count(least_size=5)
    if named > _MOST_NAMES:
        raise MessageError(f"it has {named} names; at most {_MOST_NAMES} are read")
    names = tuple(cursor.string() for _ in range(named))
    counts, places = [], [_ENCAPSULATION]
    for _ in FIELDS:
        counts.append(cursor.count(least_size=8))
        if counts[-1]:
            places.append(cursor.skip(8 * counts[-1], aligned_to=8))
    if len(message) - cursor.at >= _PADDING:
        raise MessageError(f"{len(message) - cursor.at} bytes are left over")
    for field, count in zip(FIELDS, counts, strict=True):
        if count not in (0, named):
            raise MessageError(f"{field} has {count} values for {named} names; it must have as many or none")
    if len(set(names)) != named:
        raise MessageError(f"a joint name occurs twice in {', '.join(names)}")
    mask = np.zeros(cursor.at, dtype=np.uint8)
    for begin, end in [(0, _ENCAPSULATION), *cursor.read]:
        mask[begin:end] = 0xFF
    return _Layout(
        names=names,
        template=np.frombuffer(message, dtype=np.uint8)[: cursor.at],
        mask=mask,
        places=np.array(places, dtype=np.int64),
        sizes=np.array([_STAMP, *(8 * count for count in counts if count)], dtype=np.int64),
        present=tuple(count > 0 for count in counts),  # type: ignore[arg-type]
        length=cursor.at,
    )


class _Cursor:
    """Reads CDR from one place to the next; ``read`` lists the bytes that were looked at."""

    def __init__(self, message: bytes, at: int) -> None:
        self._message = message
        self.at = at
        self.read: list[tuple[int, int]] = []

    def count(self, *, least_size: int) -> int:
        """The length of a sequence whose elements have a least size."""
        begin = self.skip(4, aligned_to=4)
        self.read.append((begin, self.at))
        found: int = struct.unpack_from("<I", self._message, begin)[0]
        if found * least_size > len(self._message):
            raise MessageError(f"it is cut off: {found} elements do not fit {len(self._message)} bytes")
        return found

    def string(self) -> str:
        length = self.count(least_size=1)
        begin = self.skip(length, aligned_to=1)
        self.read.append((begin, self.at))
        try:
            return self._message[begin : self.at].rstrip(b"\0").decode()
        except UnicodeDecodeError as error:
            raise MessageError("a name is not UTF-8") from error

    def skip(self, size: int, *, aligned_to: int) -> int:
        """Where the next bytes begin, after the padding that they need."""
        begin = self.at + (-(self.at - _ENCAPSULATION)) % aligned_to
        self.at = begin + size
        if self.at > len(self._message):
            raise MessageError(f"it is cut off at {len(self._message)} bytes")
        return begin
