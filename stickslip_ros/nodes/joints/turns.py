# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When each joint is told of: at once where there is news, often where it sticks, else in turn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from operator import is_not

from stickslip_ros.nodes.joints.watched_joint import WORTH_CHANGING, WatchedJoint

_ALL_WITHIN, _URGENT_WITHIN = 1.0, 0.1  # [s] every joint, and one that sticks, is told of at least so often
FEW, _SOME = 8, 4  # so few joints are all told of each time, as an arm's are; of more at least some


class Turns:
    """Whom to tell of now: joints that have news, often those that stick or are at risk, the others in turn."""

    def __init__(self) -> None:
        # The news, and how long ago they were told [s], that told longest ago first.
        self._told: dict[str, tuple[object, ...]] = {}
        self._since: dict[str, float] = {}

    def due(
        self, news: Mapping[str, tuple[object, ...]], urgent: Iterable[str], period: float
    ) -> tuple[list[str], list[str]]:
        """The joints to tell of, of all that there are; and of these those whose turn it merely is.

        Parameters
        ----------
        news : of each joint objects that are others when there is something to tell at once.
        urgent : told ten times a second.
        period : until this is asked again [s].
        """
        self._since = {name: self._since.get(name, 0.0) + period for name in news}
        # The next time would be too late.
        wanted = {name for name in urgent if self._since[name] + 0.5 * period > _URGENT_WITHIN}
        wanted.update(name for name, new in news.items() if self._is_new(name, new))
        others = [name for name in self._told if name in news and name not in wanted]
        share = len(news) if len(news) <= FEW else max(_SOME, math.ceil(len(news) * period / _ALL_WITHIN))
        turns = set(others[:share])
        wanted.update(turns)
        chosen = [name for name in news if name in wanted]
        for name in chosen:
            self._told.pop(name, None)
            self._told[name] = news[name]
            self._since[name] = 0.0
        return chosen, [name for name in chosen if name in turns]

    def _is_new(self, name: str, new: tuple[object, ...]) -> bool:
        told = self._told.get(name)
        return told is None or any(map(is_not, told, new))


def urgent(joints: Mapping[str, WatchedJoint]) -> list[str]:
    """The joints that stick or are at risk."""
    return [name for name, joint in joints.items() if joint.monitor.latest_status in WORTH_CHANGING]
