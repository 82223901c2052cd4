# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joint states, live or recorded, as arrays: decoded messages, and serialized ones, a whole block at once.

The messages of one publisher have one layout until its names change, so that stamps and values stand at the same
places in each of them. The layout is read from one message; the others are compared with it byte by byte, in
everything but stamp and values, and then copied.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol
from xml.sax.saxutils import quoteattr, unescape

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages import _rows_kernel as kernel
from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains
from stickslip_ros.visible import visible

DESCRIPTION = "/robot_description"
DESCRIPTION_TYPE = "std_msgs/msg/String"
# Tags of joints in a URDF, by regular expressions: no parser of XML is trusted with a text of others.
_JOINT = re.compile(r"<joint\s([^<>]{1,1000})>")
_ATTRIBUTE = re.compile(r"\b(name|type)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_LONGEST_DESCRIPTION = 10_000_000  # characters of a URDF that are read: bounds the time
_ENTITIES = {"&quot;": '"', "&apos;": "'"}
Warn = Callable[[str], None]
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
FloatArray = NDArray[np.float64]
_MESSAGES, _BYTES = 4096, 16_000_000  # of a block at most: so much is held in memory at once
TYPE = "sensor_msgs/msg/JointState"
FIELDS = ("position", "velocity", "effort")
_ENCAPSULATION = 4
_STAMP = 8
_PADDING = 32  # bytes after the message, less than this: serializers reckon with more alignment than there is
_LAYOUTS_KEPT = 64
_MOST_NAMES = 4096  # no robot has more joints, but damaged bytes may seem to
WRAPS = "position wraps at a whole turn; it is read on as a continuous one"


class MessageError(StickSlipError, ValueError):
    """A message that cannot mean anything; the text says what is wrong with it."""


def seconds(stamp: Any) -> float:
    """A stamp as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def with_times(stamps: FloatArray, others: FloatArray, what: str, refuse: Callable[[str, int], None]) -> FloatArray:
    """Stamps [s]; the other times where a stamp is zero, which means that nobody set it.

    Parameters
    ----------
    what : name of the other times' event, for people. refuse : called with the reason and the number of unset stamps.
    """
    unset = stamps == 0.0
    if not unset.any():
        return stamps
    refuse(f"stamp is zero; the time of {what} is used instead", int(unset.sum()))
    return np.where(unset, others, stamps)


def with_time(stamp: float, other: float, what: str, refuse: Callable[[str, int], None]) -> float:
    """One stamp [s], or the other time; see :func:`with_times`."""
    return float(with_times(np.array([stamp]), np.array([other]), what, refuse)[0])


def gains_from_message(message: Any) -> dict[str, Gains]:
    """Gains of every joint in a `pd_gains` message.

    Raises
    ------
    MessageError
        If the layout is not [joint (names joined by commas), gain ("p,d" or "p,i,d")], or a gain is
        not finite.
    """
    dimensions = message.layout.dim
    if len(dimensions) != 2:
        raise MessageError(f"pd_gains needs layout.dim = [joints, gains], got {len(dimensions)} dimensions")
    joints = [name.strip() for name in dimensions[0].label.split(",")]
    kinds = [name.strip() for name in dimensions[1].label.split(",")]
    if kinds not in (["p", "d"], ["p", "i", "d"]):
        raise MessageError(f"the gains' label must be 'p,d' or 'p,i,d': {dimensions[1].label!r}")
    expected = len(joints) * len(kinds)
    if len(message.data) != expected:
        raise MessageError(
            f"pd_gains needs {expected} values for {len(joints)} joints by {len(kinds)} gains, got {len(message.data)}"
        )
    gains = {}
    for index, joint in enumerate(joints):
        row = dict(zip(kinds, message.data[index * len(kinds) : (index + 1) * len(kinds)], strict=True))
        for kind, value in row.items():
            if not abs(value) < LARGEST:
                raise MessageError(f"gain {kind} of {joint} must be finite and less than {LARGEST:g}: {value}")
        gains[joint] = Gains(stiffness=row["p"], damping=row["d"], integral=row.get("i", 0.0))
    return gains


def reference_rows(message: Any) -> dict[str, tuple[float, float]]:
    """Desired position and velocity of every joint in the state of a controller; NaN for what is missing.

    Raises
    ------
    MessageError
        If its arrays do not fit its names.
    """
    if hasattr(message, "dof_states"):
        return {state.name: (state.reference, math.nan) for state in message.dof_states}
    names = message.joint_names
    # Older definitions have `desired` alone; newer ones have both, of which publishers fill one.
    points = [getattr(message, name) for name in ("reference", "desired") if hasattr(message, name)]
    if not points:
        raise MessageError("it has neither a field reference nor a field desired")
    point = next((point for point in points if len(point.positions)), points[0])
    if len(point.positions) != len(names):
        raise MessageError(f"reference has {len(point.positions)} positions for {len(names)} joints")
    known = len(point.velocities) == len(names)
    velocities = point.velocities if known else [math.nan] * len(names)
    return dict(zip(names, zip(point.positions, velocities, strict=True), strict=True))


def prismatic_joints(text: str) -> set[str]:
    """Names of the prismatic joints in a robot's description (URDF): their positions are in metres."""
    found = set()
    for joint in _JOINT.findall(text[:_LONGEST_DESCRIPTION]):
        attributes = {name: unescape(one or other, _ENTITIES) for name, one, other in _ATTRIBUTE.findall(joint)}
        if attributes.get("type") == "prismatic":
            found.add(attributes.get("name", ""))
    return found


def robot_description(names: Iterable[str], prismatic: Collection[str]) -> str:
    """Description of a robot (URDF) with no more than the joints and their types."""
    joints = [
        f'<joint name={quoteattr(name)} type="{"prismatic" if name in prismatic else "revolute"}"/>' for name in names
    ]
    return f'<robot name="robot">{"".join(joints)}</robot>'


@dataclass(frozen=True, kw_only=True)
class Channel:
    """Where messages of one type come from.

    Attributes
    ----------
    topic, type : as ROS names them, e.g. "/joint_states", "sensor_msgs/msg/JointState".
    encoding : of the messages, "cdr".
    schema_encoding, schema : definition of the type, "ros2msg" or "ros2idl"; "" if the recorder did not know it.
    """

    topic: str
    type: str
    encoding: str = "cdr"
    schema_encoding: str = ""
    schema: str = ""

    def __post_init__(self) -> None:
        # Robots are named after topics; whoever reads a bag sees them, and types them, as they are shown.
        for name in ("topic", "type", "encoding"):
            object.__setattr__(self, name, visible(getattr(self, name)))


def counts_by_channel(channels: Mapping[int, Channel], counts: Mapping[int, int]) -> dict[Channel, int]:
    """How many messages each channel has, of the numbers that stand for it: there may be several."""
    found: dict[Channel, int] = dict.fromkeys(channels.values(), 0)
    for number, channel in channels.items():
        found[channel] += counts.get(number, 0)
    return found


@dataclass(frozen=True, kw_only=True)
class Block:
    """Messages in the order of their recording.

    Attributes
    ----------
    buffer : of shape (bytes,); message n is ``buffer[offset[n] : offset[n] + length[n]]``.
    channel : for each message, its number in ``channels``.
    log_time : when it was recorded [ns].
    """

    buffer: Bytes
    channels: dict[int, Channel]
    channel: Integers
    offset: Integers
    length: Integers
    log_time: Integers

    def __len__(self) -> int:
        return len(self.offset)

    def message(self, number: int) -> bytes:
        """One serialized message."""
        begin = int(self.offset[number])
        return self.buffer[begin : begin + int(self.length[number])].tobytes()

    @staticmethod
    def of_messages(messages: Iterable[tuple[int, int, bytes]], channels: dict[int, Channel]) -> Block:
        """A block of (channel number, log time [ns], message)."""
        numbers, times, data = zip(*messages, strict=True)
        lengths = np.array([len(one) for one in data], dtype=np.int64)
        return Block(
            buffer=np.frombuffer(b"".join(data), dtype=np.uint8),
            channels=channels,
            channel=np.array(numbers, dtype=np.int64),
            offset=np.concatenate([[0], np.cumsum(lengths)[:-1]]),
            length=lengths,
            log_time=np.array(times, dtype=np.int64),
        )


def blocks_of(messages: Iterable[tuple[int, int, bytes]], channels: dict[int, Channel]) -> Iterator[Block]:
    """Messages (channel number, log time [ns], data) in blocks.

    Where reading them ends in an error, those that came before it are given first.
    """
    batch: list[tuple[int, int, bytes]] = []
    size = 0
    try:
        for one in messages:
            batch.append(one)
            size += len(one[2])
            if len(batch) >= _MESSAGES or size >= _BYTES:
                yield Block.of_messages(batch, channels)
                batch, size = [], 0
    except Exception:
        if batch:
            yield Block.of_messages(batch, channels)
        raise
    if batch:
        yield Block.of_messages(batch, channels)


def with_progress(blocks: Iterable[Block], total: int, size: int, progress: Callable[[int], None]) -> Iterator[Block]:
    """Blocks of a file; ``progress`` is told the share of its size [bytes] that they have of all its messages."""
    count, reported = 0, 0
    for block in blocks:
        yield block
        count += len(block)
        read = size * min(count, total) // max(total, 1)
        progress(read - reported)
        reported = read
    progress(size - reported)


class Storage(Protocol):
    """One file of a bag."""

    def channels(self) -> dict[Channel, int]:
        """The channels, and how many messages each has."""

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        """The messages of the wanted channels, perhaps with others among them.

        ``progress`` is told how many bytes of the file have been dealt with since it was told last.
        """


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


class WholeTurns:
    """Removes whole turns from the positions of joints, row after row; how rows are cut into batches has no effect.

    A step counts as a whole turn if the motion goes on beyond it: less the turn, it is hardly larger than the step
    before. Positions have to stay within one turn until then, as those that wrap do.

    Parameters
    ----------
    warn : called once for each joint that wraps, with a sentence.

    Attributes
    ----------
    counts : how many whole turns were removed, by joint.
    """

    def __init__(self, warn: Warn = lambda _: None) -> None:
        self._warn = warn
        self.counts: Counter[str] = Counter()
        self._states: dict[str, FloatArray] = {}

    def removed(self, joint: str, rows: FloatArray) -> FloatArray:
        """The rows with positions that go on over whole turns.

        Parameters
        ----------
        rows : time, position [rad], and other values, of shape (n, at least 2). They are not changed.
        """
        state = self._states.get(joint)
        if state is None:
            state = self._states[joint] = np.array([math.nan, math.inf, -math.inf, 0.0, 0.0])
        added = np.empty(len(rows))
        turns = kernel.follow(np.ascontiguousarray(rows[:, 1]), LARGEST, state, added)
        if turns:
            if joint not in self.counts:
                self._warn(f"{joint}: {WRAPS}")
            self.counts[joint] += turns
        elif state[kernel.ADDED] == 0.0:
            return rows
        found: FloatArray = rows.copy()
        found[:, 1] += added
        return found
