# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reasons why the node refused messages or names: counted for the diagnostics, logged once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from time import monotonic

_MOST_REASONS = 64  # number of reasons, 1: they may quote names from the graph, so their number is bounded
_TOLD = 60.0  # time after a refusal for which the node's status is about it, s: an operator looks by then


class Refusals:
    """Reasons and how often each occurred; their number is bounded.

    Parameters
    ----------
    warn : writes to the log. clock : steady [s].
    """

    def __init__(self, warn: Callable[[str], None], clock: Callable[[], float] = monotonic) -> None:
        self._warn, self._clock = warn, clock
        self.counts: Counter[str] = Counter()
        self._times: dict[str, float] = {}  # of the last of each [s]

    def __call__(self, reason: str, count: int = 1) -> None:
        """Count a refusal."""
        if reason not in self.counts:
            if len(self.counts) >= _MOST_REASONS:
                reason = "more reasons than are kept"
            if reason not in self.counts:
                self._warn(f"refused: {reason}")
        self.counts[reason] += count
        self._times[reason] = self._clock()

    @property
    def latest(self) -> str:
        """Of the last minute's reasons the one that occurred first most recently, "" if there is none."""
        begin = self._clock() - _TOLD
        return next((reason for reason, time in reversed(self._times.items()) if time > begin), "")
