# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When each joint's samples are looked at, and when it is told of: at once where something happens, else in turn.

To look at a joint costs about as much for a few samples as for many, and to tell of it costs more than either. So a
joint that rests, or moves smoothly, is looked at less often. What is found does not depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from operator import is_not
from time import monotonic

from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.joints.watched_joint import WORTH_CHANGING, WatchedJoint

# [s] for which samples of a joint that rests or moves smoothly may wait: at least, for each joint, at most
_LATER, _LATER_EACH, _LATEST = 0.1, 0.002, 0.5
_UNEVENTFUL = (Status.SMOOTH, Status.AT_REST)
_ALL_WITHIN, _URGENT_WITHIN = 1.0, 0.1  # [s] every joint, and one that sticks, is told of at least so often
_FEW, _SOME = 8, 4  # so few joints are all told of each time, as an arm's are; of more at least some


class Following:
    """Lets the joints' monitors follow their samples.

    Parameters
    ----------
    hurry : whether all joints are looked at at once. on_error : what to do about a joint when following it raises.
    """

    def __init__(
        self,
        joints: Mapping[str, WatchedJoint],
        hurry: Callable[[], bool],
        on_error: Callable[[WatchedJoint], None],
    ) -> None:
        self._joints, self._hurry, self._on_error = joints, hurry, on_error
        self._since: dict[str, float] = {}  # when the oldest of what waits was taken, as a steady time [s]
        self._found: list[tuple[str, Cycle]] = []

    def expect(self, names: Iterable[str], now: float) -> None:
        """Samples or references of these joints have come at a steady time [s]."""
        for name in names:
            if name in self._joints:
                self._since.setdefault(name, now)

    def look(self, now: float) -> None:
        """Follow the joints of which something may have happened, and those whose samples have waited for long."""
        hurry = self._hurry()
        later = min(_LATER + _LATER_EACH * len(self._joints), _LATEST)
        for name, since in list(self._since.items()):
            if hurry or now - since >= later or self._joints[name].monitor.latest_status not in _UNEVENTFUL:
                self.catch_up(name, now)

    def catch_up(self, name: str, now: float | None = None) -> None:
        """Follow what has come of one joint; what goes wrong with it is no other joint's business."""
        if self._since.pop(name, None) is None:
            return
        joint = self._joints[name]
        try:
            batch = joint.pairing.take(monotonic() if now is None else now)
            if batch is not None:
                self._found += [(name, cycle) for cycle in joint.monitor.process(batch)]
        except Exception:
            self._on_error(joint)

    def found(self) -> list[tuple[str, Cycle]]:
        """The cycles found since this was asked last, each with the name of its joint."""
        found, self._found = self._found, []
        return found


class Turns:
    """Whom to tell of now: joints that have news, often those that stick or are at risk, the others in turn."""

    def __init__(self) -> None:
        # The news, and how long ago they were told [s], that told longest ago first.
        self._told: dict[str, tuple[object, ...]] = {}
        self._since: dict[str, float] = {}

    def due(self, news: Mapping[str, tuple[object, ...]], urgent: Iterable[str], period: float) -> list[str]:
        """The joints to tell of, of all that there are.

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
        share = len(news) if len(news) <= _FEW else max(_SOME, math.ceil(len(news) * period / _ALL_WITHIN))
        wanted.update(others[:share])
        chosen = [name for name in news if name in wanted]
        for name in chosen:
            self._told.pop(name, None)
            self._told[name] = news[name]
            self._since[name] = 0.0
        return chosen

    def _is_new(self, name: str, new: tuple[object, ...]) -> bool:
        told = self._told.get(name)
        return told is None or any(map(is_not, told, new))


def urgent(joints: Mapping[str, WatchedJoint]) -> list[str]:
    """The joints that stick or are at risk."""
    return [name for name, joint in joints.items() if joint.monitor.latest_status in WORTH_CHANGING]
