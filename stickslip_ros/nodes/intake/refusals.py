# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node did not take, and why: counted for the diagnostics, said once in the log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

_MOST_REASONS = 64


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
