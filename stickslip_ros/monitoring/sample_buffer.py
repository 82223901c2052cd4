# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The latest samples of a joint, in blocks that are used again: few objects, and no more memory after a while."""

from __future__ import annotations

from collections import deque

import numpy as np

from stickslip_ros.monitoring._buffer_kernel import store
from stickslip_ros.monitoring.samples import Batch, FloatArray

_ROWS = 1024
_FIELDS = tuple(Batch.__dataclass_fields__)  # the first is the time


class _Block:
    """Some thousand samples; a column that has only NaN is not written, and takes no memory."""

    def __init__(self) -> None:
        self.columns = np.zeros((len(_FIELDS), _ROWS))
        self.known = np.zeros(len(_FIELDS), dtype=np.bool_)
        self.count = 0

    def first(self) -> float:
        """Time of the first sample [s]."""
        return float(self.columns[0, 0])

    def last(self) -> float:
        """Time of the last sample [s]."""
        return float(self.columns[0, self.count - 1])


class SampleBuffer:
    """The latest samples, bounded in time and number.

    Parameters
    ----------
    longest : kept [s]. most : samples kept.
    """

    def __init__(self, longest: float = 58.0, most: int = 120_000) -> None:
        self._longest, self._most = longest, most
        self._blocks: deque[_Block] = deque()
        self._spare: _Block | None = None
        self._count = 0

    def add(self, batch: Batch) -> None:
        """Keep samples that follow those kept."""
        begin = 0
        while begin < len(batch):
            if not self._blocks or self._blocks[-1].count == _ROWS:
                self._blocks.append(self._spare or _Block())
                self._spare = None
            block = self._blocks[-1]
            taken = min(len(batch) - begin, _ROWS - block.count)
            store(
                block.columns, block.known, block.count, begin, taken,
                batch.time, batch.position, batch.velocity, batch.effort,
                batch.reference_position, batch.reference_velocity,
            )  # fmt: skip
            block.count += taken
            self._count += taken
            begin += taken
            self._forget(float(batch.time[begin - 1]))

    def _forget(self, now: float) -> None:
        while len(self._blocks) > 1 and (
            self._count - self._blocks[0].count > self._most or self._blocks[1].first() < now - self._longest
        ):
            self._spare = self._blocks.popleft()
            self._count -= self._spare.count
            self._spare.known[:], self._spare.count = False, 0

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
