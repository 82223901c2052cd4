# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages lost on the way, by the numbers that publishers give them."""

from __future__ import annotations

from collections.abc import Sequence

_LONGEST_GAP = 5000  # numbers; what is further on is another publisher's
_MOST_STREAMS = 16


class SequenceNumbers:
    """Follows the numbers on one topic; ``lost`` counts those that never came.

    Which publisher a message is from cannot be seen. Its number tells, unless several publishers have sent about as
    many messages: then a loss may be missed.
    """

    def __init__(self) -> None:
        self._last: list[int] = []
        self.lost = 0

    def add_numbers(self, numbers: Sequence[int]) -> None:
        """The numbers of messages in the order of their arrival."""
        if len(self._last) == 1 and numbers[0] == self._last[0] + 1 and numbers[-1] == self._last[0] + len(numbers):
            self._last[0] = numbers[-1]
            return
        for number in numbers:
            before = [last for last in self._last if 0 < number - last <= _LONGEST_GAP]
            if before:
                nearest = max(before)
                self.lost += number - nearest - 1
                self._last.remove(nearest)
            self._last = [*self._last[-_MOST_STREAMS + 1 :], number]
