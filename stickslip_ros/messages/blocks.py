# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What every storage gives: serialized messages in blocks, each message a place in one buffer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.visible import visible

Warn = Callable[[str], None]
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
FloatArray = NDArray[np.float64]

_MESSAGES, _BYTES = 4096, 16_000_000  # of a block at most: so much is held in memory at once


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
