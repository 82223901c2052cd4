# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The latest samples of a joint, in blocks that are used again: few objects, and a bound on their memory.

Where they become too many, samples of long rests are thinned out first: of a joint that stands still one sample tells
as much as two. Then those of the older half are, and in the end the oldest are forgotten. What is kept depends on the
samples alone, not on how they were batched.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from stickslip_ros.monitoring._samples_kernel import store
from stickslip_ros.monitoring.samples import Batch, FloatArray

MOST_BYTES = 450_000  # memory for the samples of one joint, bytes
_ROWS = 512  # samples of a block, 1
_FIELDS = tuple(Batch.__dataclass_fields__)  # the first is the time, the second the position
_HALF = _ROWS // 2
_THINNEST = 16  # ratio of samples to those kept of a motion, 1: at most
_AT_REST = 0.02  # way in a block, of the longest: with less the joint stands


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
        self._size = 0

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
        return self._size

    def _begin_block(self) -> None:
        if self._blocks:
            self._blocks[-1].finish()
            self._size += self._blocks[-1].size
            now = self._blocks[-1].last()
            while len(self._blocks) > 1 and self._blocks[1].first() < now - self._longest:
                self._forget_the_oldest()
            # The block to come will be like the last one.
            while len(self._blocks) > 1 and self._size + self._blocks[-1].size > self._most_bytes:
                self._make_room()
        self._blocks.append(self._new())

    def _new(self) -> _Block:
        return self._spare.pop() if self._spare else _Block()

    def _make_room(self) -> None:
        begin = self._to_join()
        if begin is None:
            self._forget_the_oldest()
            return
        first, second = self._blocks[begin], self._blocks[begin + 1]
        joined = self._new()
        # Every second sample of theirs.
        joined.columns[:, :_HALF], joined.columns[:, _HALF:] = first.columns[:, ::2], second.columns[:, ::2]
        if not np.array_equal(first.known, second.known):
            joined.columns[~first.known, :_HALF], joined.columns[~second.known, _HALF:] = np.nan, np.nan
        np.logical_or(first.known, second.known, out=joined.known)
        joined.count, joined.every = _ROWS, 2 * first.every
        joined.finish()
        self._size += joined.size - first.size - second.size
        self._give_back(first)
        self._give_back(second)
        self._blocks[begin] = joined
        del self._blocks[begin + 1]

    def _to_join(self) -> int | None:
        """Where two blocks begin that are to become one: of rests if there are such, else old ones; None for none."""
        blocks = list(self._blocks)
        least = _AT_REST * max(block.way for block in blocks)
        stands = [block.way <= least for block in blocks]
        # A slip begins gently, in a block that seems one of the rest before.
        inside = [
            here and before and after
            for here, before, after in zip(stands, [True, *stands[:-1]], [*stands[1:], False], strict=True)
        ]
        older = [at < len(blocks) // 2 and block.every < _THINNEST for at, block in enumerate(blocks)]
        for eligible in (inside, older):
            for at in range(len(blocks) - 1):
                if eligible[at] and eligible[at + 1] and blocks[at].every == blocks[at + 1].every:
                    return at
        return None

    def _forget_the_oldest(self) -> None:
        oldest = self._blocks.popleft()
        self._size -= oldest.size
        self._give_back(oldest)

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
