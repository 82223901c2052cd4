# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reasons why the node refused messages or names: counted for the diagnostics, logged once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

_MOST_REASONS = 64  # number of reasons, 1: they may quote names from the graph, so their number is bounded


class Refusals:
    """Reasons and how often each occurred; their number is bounded.

    Parameters
    ----------
    warn : writes to the log.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self.counts: Counter[str] = Counter()

    def __call__(self, reason: str, count: int = 1) -> None:
        """Count a refusal."""
        if reason not in self.counts:
            if len(self.counts) >= _MOST_REASONS:
                reason = "more reasons than are kept"
            if reason not in self.counts:
                self._warn(f"refused: {reason}")
        self.counts[reason] += count

    @property
    def latest(self) -> str:
        """The reason that occurred first most recently, "" if there is none."""
        return next(reversed(self.counts), "")
