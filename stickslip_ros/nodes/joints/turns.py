# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When each joint is told of: at once where there is news, often where it sticks, else in turn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from operator import is_not

from stickslip_ros.nodes.joints.watched_joint import WORTH_CHANGING, WatchedJoint

_ROUNDING = 1e-6  # [s] of sums of periods
_ALL_WITHIN, _URGENT_WITHIN = 1.0, 0.1  # [s] every joint, and one that sticks, is told of at least so often
FEW, _SOME = 8, 4  # so few joints are all told of each time, as an arm's are; of more at least some


class RoundRobin:
    """Whom to tell of now: joints that have news, often those that stick or are at risk, the others in turn."""

    def __init__(self) -> None:
        # The news that were told, that told longest ago first; and when, on a clock of the periods that were asked of.
        self._reported: dict[str, tuple[object, ...]] = {}
        self._reported_at: dict[str, float] = {}
        self._clock = 0.0  # [s]

    def due(
        self, change_tokens: Mapping[str, tuple[object, ...]], urgent: Iterable[str], period: float
    ) -> tuple[list[str], list[str]]:
        """The joints to tell of, of all that there are; and of these those whose turn it merely is.

        Parameters
        ----------
        news : of each joint objects that are others when there is something to tell at once.
        urgent : told ten times a second.
        period : until this is asked again [s].
        """
        self._clock += period
        # The next time would be too late.
        reported_before = self._clock + 0.5 * period - _URGENT_WITHIN - _ROUNDING
        wanted = {name for name in urgent if self._reported_at.get(name, -math.inf) < reported_before}
        # Most of the news are the very ones that were told, which is found without a look into them.
        reported = self._reported
        wanted.update(
            name for name, new in change_tokens.items() if reported.get(name) is not new and self._is_new(name, new)
        )
        others = [name for name in self._reported if name in change_tokens and name not in wanted]
        share = (
            len(change_tokens)
            if len(change_tokens) <= FEW
            else max(_SOME, math.ceil(len(change_tokens) * period / _ALL_WITHIN))
        )
        turns = set(others[:share])
        wanted.update(turns)
        chosen = [name for name in change_tokens if name in wanted]
        for name in chosen:
            self._reported.pop(name, None)
            self._reported[name] = change_tokens[name]
            self._reported_at[name] = self._clock
        return chosen, [name for name in chosen if name in turns]

    def _is_new(self, name: str, new: tuple[object, ...]) -> bool:
        reported = self._reported.get(name)
        if reported is None or any(map(is_not, reported, new)):
            return True
        self._reported[name] = new
        return False


def urgent(joints: Mapping[str, WatchedJoint]) -> list[str]:
    """The joints that stick or are at risk."""
    return [name for name, joint in joints.items() if joint.monitor.latest_status in WORTH_CHANGING]
