# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages that wait until they can be used: while the node compiles, and until it has caught up."""

from __future__ import annotations

import math
from collections import deque
from typing import Generic, TypeVar

_MOST_BYTES = 256e6

Taken = TypeVar("Taken")


class Backlog(Generic[Taken]):
    """What was drained, in order; the oldest goes where it becomes too much. ``dropped`` counts messages."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Taken, int, int]] = deque()
        self._bytes = 0
        self.dropped = 0

    def add(self, now: float, taken: Taken, count: int, size: int) -> None:
        """Keep so many messages of so many bytes, drained at a steady time [s]."""
        self._waiting.append((now, taken, count, size))
        self._bytes += size
        while self._bytes > _MOST_BYTES and len(self._waiting) > 1:
            self.dropped += self._waiting[0][2]
            self._bytes -= self._waiting.popleft()[3]

    def pop_until(self, until: float) -> list[Taken]:
        """What was drained until then, and waits no longer."""
        found = []
        while self._waiting and self._waiting[0][0] <= until:
            _, taken, _, size = self._waiting.popleft()
            self._bytes -= size
            found.append(taken)
        return found

    @property
    def oldest(self) -> float:
        """When the oldest was drained [s]; infinite if none waits."""
        return self._waiting[0][0] if self._waiting else math.inf
