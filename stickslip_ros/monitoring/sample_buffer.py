# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The latest samples of a joint, in blocks that are used again: few objects, and a bound on their memory.

Where they become too many, samples of long rests are thinned out first: of a joint that stands still one sample tells
as much as two. Then those of the older half are, and in the end the oldest are forgotten. What is kept depends on the
samples alone, not on how they were batched.
"""

from __future__ import annotations

from collections import deque
from itertools import groupby

import numpy as np

from stickslip_ros.monitoring._buffer_kernel import store
from stickslip_ros.monitoring.samples import Batch, FloatArray

MOST_BYTES = 450_000  # of the samples of one joint
_ROWS = 512
_FIELDS = tuple(Batch.__dataclass_fields__)  # the first is the time, the second the position
_JOINED = 2  # blocks that become one, with every second sample of theirs
_THINNEST = 16  # of motion at least every so-manieth sample is kept
_AT_REST = 0.02  # of the longest way in a block: a shorter one is a joint's that stands


class _Block:
    """Some hundred samples; a column that has only NaN is not written, and takes no memory.

    Attributes
    ----------
    every : so many samples there were for each that is here.
    way : of a block that is full, from its lowest to its highest position [rad]; size : its memory [bytes].
    """

    def __init__(self) -> None:
        self.columns = np.zeros((len(_FIELDS), _ROWS))
        self.known = np.zeros(len(_FIELDS), dtype=np.bool_)
        self.clear()

    def clear(self) -> None:
        """Begin anew with other samples."""
        self.known[:] = False
        self.count, self.every, self.way, self.size = 0, 1, 0.0, 0

    def finish(self) -> None:
        """It is full."""
        self.way = float(self.columns[1].max() - self.columns[1].min())
        self.size = 8 * _ROWS * int(np.count_nonzero(self.known))

    def first(self) -> float:
        """Time of the first sample [s]."""
        return float(self.columns[0, 0])

    def last(self) -> float:
        """Time of the last sample [s]."""
        return float(self.columns[0, self.count - 1])


class SampleBuffer:
    """The latest samples, bounded in time and memory.

    Parameters
    ----------
    longest : kept [s]. most_bytes : of memory.
    """

    def __init__(self, longest: float = 58.0, most_bytes: int = MOST_BYTES) -> None:
        self._longest, self._most_bytes = longest, most_bytes
        self._blocks: deque[_Block] = deque()
        self._spare: list[_Block] = []

    def add(self, batch: Batch) -> None:
        """Keep samples that follow those kept."""
        begin = 0
        while begin < len(batch):
            if not self._blocks or self._blocks[-1].count == _ROWS:
                self._begin_block()
            block = self._blocks[-1]
            taken = min(len(batch) - begin, _ROWS - block.count)
            store(
                block.columns, block.known, block.count, begin, taken,
                batch.time, batch.position, batch.velocity, batch.effort,
                batch.reference_position, batch.reference_velocity,
            )  # fmt: skip
            block.count += taken
            begin += taken

    @property
    def size(self) -> int:
        """Memory that the samples take, but those of the last block [bytes]."""
        return sum(block.size for block in self._blocks)

    def _begin_block(self) -> None:
        if self._blocks:
            self._blocks[-1].finish()
            now = self._blocks[-1].last()
            while len(self._blocks) > 1 and self._blocks[1].first() < now - self._longest:
                self._give_back(self._blocks.popleft())
            # The block to come will be like the last one.
            while len(self._blocks) > 1 and self.size + self._blocks[-1].size > self._most_bytes:
                self._make_room()
        self._blocks.append(self._new())

    def _new(self) -> _Block:
        return self._spare.pop() if self._spare else _Block()

    def _make_room(self) -> None:
        begin = self._to_join()
        if begin is None:
            self._give_back(self._blocks.popleft())
            return
        blocks = list(self._blocks)
        group = blocks[begin : begin + _JOINED]
        joined = self._new()
        for number in range(len(_FIELDS)):
            joined.known[number] = any(block.known[number] for block in group)
            if joined.known[number]:
                joined.columns[number] = _column(group, number)[::_JOINED]
        joined.count, joined.every = _ROWS, _JOINED * group[0].every
        joined.finish()
        for block in group:
            self._give_back(block)
        self._blocks = deque([*blocks[:begin], joined, *blocks[begin + _JOINED :]])

    def _to_join(self) -> int | None:
        """Where blocks begin that are to become one: of rests if there are such, else old ones; None for none."""
        blocks = list(self._blocks)
        ways = np.array([block.way for block in blocks])
        stands = ways <= _AT_REST * ways.max()
        # A slip begins gently, in a block that seems one of the rest before.
        inside = stands & np.append(True, stands[:-1]) & np.append(stands[1:], False)
        older = [at < len(blocks) // 2 and block.every < _THINNEST for at, block in enumerate(blocks)]
        for eligible in (inside.tolist(), older):
            kinds = [block.every if wanted else 0 for block, wanted in zip(blocks, eligible, strict=True)]
            at = 0
            for kind, run in groupby(kinds):
                length = len(list(run))
                if kind and length >= _JOINED:
                    return at
                at += length
        return None

    def _give_back(self, block: _Block) -> None:
        block.clear()
        self._spare.append(block)

    def between(self, begin: float, end: float) -> Batch | None:
        """Samples from one time to another, and the one before; None if there are none."""
        blocks = [block for block in self._blocks if block.count and block.last() >= begin and block.first() <= end]
        if not blocks:
            return None
        joined = Batch(**{name: _column(blocks, number) for number, name in enumerate(_FIELDS)})
        first, last = np.searchsorted(joined.time, [begin, end], side="right")
        return joined.where(slice(max(int(first) - 1, 0), int(last))) if last > first else None


def _column(blocks: list[_Block], number: int) -> FloatArray:
    parts = [
        block.columns[number, : block.count] if block.known[number] else np.full(block.count, np.nan)
        for block in blocks
    ]
    return np.concatenate(parts)
