# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When the samples of each joint are processed, and when its status is published.

To process the samples of a joint costs about as much for a few samples as for many, and to publish its status costs
more than either. So samples of a joint that rests, or moves smoothly, are processed only when its status is published,
as long as the joint is where it was expected to be; of very many such joints, not even each time. The results do not
depend on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from operator import is_not
from time import monotonic

from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.joints.watched_joints import WORTH_CHANGING, WatchedJoint

_ROUNDING = 1e-6  # [s] of sums of periods
_ALL_WITHIN, _URGENT_WITHIN = 1.0, 0.1  # [s] every joint, and one that sticks, is told of at least so often
FEW, _SOME = 8, 4  # so few joints are all told of each time, as an arm's are; of more at least some
# [s] for which samples of a joint that rests or moves smoothly may wait: at least, for each joint, at most
_LATER, _LATER_EACH, _LATEST = 0.1, 0.002, 0.5
_LOOKS = 60.0  # [1/s] at joints that go on as they did: of more, the same is told of one until it is looked at
_AS_EXPECTED = 1.5  # [s] likewise, of a joint that goes on as it did: usually it is told of before, and looked at then
_AT_ONCE = 8  # quiet joints that are looked at together at least: the costs of more are spread over time
_PACE_OVER = 0.2  # [s] over which the pace of a joint is taken
_BEHIND = 0.1  # [s] by which a joint may be behind where its pace would have it
_UNEVENTFUL = (Status.SMOOTH, Status.AT_REST)


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


@dataclass(kw_only=True)
class _Course:
    """Where a joint is expected to be, if it goes on as it did.

    Attributes
    ----------
    since, began : time [s] and position [rad] from which its pace is taken.
    time, position : of the last sample that was looked at. pace : [rad/s]. band : that is no motion [rad].
    looked_at : when it was looked at last, as a steady time [s].
    """

    since: float
    began: float
    time: float
    position: float
    pace: float = math.nan
    band: float = 0.0
    processed_at: float = -math.inf

    def go_on(self, time: float, position: float, band: float, now: float) -> None:
        """Take the last sample that was looked at."""
        self.time, self.position, self.band, self.processed_at = time, position, band, now
        if not 0.0 <= time - self.since < _PACE_OVER:
            self.pace = (position - self.began) / (time - self.since) if time > self.since else math.nan
            self.since, self.began = time, position

    def surprised(self, time: float, position: float) -> bool:
        """Whether a sample is elsewhere; also where that cannot be said."""
        aside = abs(position - self.position - self.pace * (time - self.time))
        return not (aside <= self.band + _BEHIND * abs(self.pace) and time >= self.time)


class BatchProcessing:
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
        self._courses: dict[str, _Course] = {}
        self._surprised: set[str] = set()
        self._polled_at = -math.inf
        self._processed: dict[str, None] = {}
        self._cycles: list[tuple[str, Cycle]] = []

    def expect(self, samples: Mapping[str, FloatArray], references: Iterable[str], now: float) -> None:
        """Samples, rows of time and position first, or references of these joints have come at a steady time [s]."""
        joints, surprised, courses, since = self._joints, self._surprised, self._courses, self._since
        for name, rows in samples.items():
            if name not in joints:
                continue
            since.setdefault(name, now)
            if name not in surprised:
                course = courses.get(name)
                if course is None or course.surprised(rows.item(-1, 0), rows.item(-1, 1)):
                    surprised.add(name)
        for name in references:
            if name in self._joints:
                self._since.setdefault(name, now)

    def poll(self, now: float) -> None:
        """Follow the joints of which something may have happened, and those whose samples have waited for long."""
        hurry = self._hurry()
        later = min(_LATER + _LATER_EACH * len(self._joints), _LATEST)
        as_expected = _AS_EXPECTED + len(self._joints) / _LOOKS
        quiet = max(_AT_ONCE, math.ceil(len(self._joints) * min((now - self._polled_at) / later, 1.0)))
        self._polled_at = now
        for name, since in list(self._since.items()):
            if hurry or self._joints[name].monitor.latest_status not in _UNEVENTFUL:
                self.process_pending(name, now)
            elif quiet and now - since >= (later if name in self._surprised else as_expected):
                quiet -= 1
                self.process_pending(name, now)

    def process_pending(self, name: str, now: float | None = None) -> None:
        """Follow what has come of one joint; what goes wrong with it is no other joint's business."""
        if self._since.pop(name, None) is None:
            return
        joint = self._joints[name]
        self._processed[name] = None
        now = monotonic() if now is None else now
        try:
            batch = joint.pairing.next_batch(now)
            if batch is not None:
                self._cycles += [(name, cycle) for cycle in joint.monitor.process(batch)]
                self._surprised.discard(name)
                time, position = float(batch.time[-1]), float(batch.position[-1])
                course = self._courses.setdefault(
                    name, _Course(since=time, began=position, time=time, position=position)
                )
                course.go_on(time, position, joint.monitor.band, now)
        except Exception:
            self._on_error(joint)

    def may_wait(self, in_turn: Iterable[str], period: float) -> set[str]:
        """Of joints whose turn it merely is, those of which may be told again what was told.

        They go on as they did; all but those that were looked at longest ago.

        Parameters
        ----------
        period : until this is asked again [s].
        """
        if len(self._joints) <= FEW:
            return set()
        quiet = [name for name in in_turn if name not in self._surprised and name in self._courses]
        quiet = [name for name in quiet if self._joints[name].monitor.latest_status in _UNEVENTFUL]
        quiet.sort(key=lambda name: self._courses[name].processed_at)
        return set(quiet[math.ceil(_LOOKS * period) :])

    def processed(self) -> list[str]:
        """The joints that were looked at since this was asked last."""
        processed, self._processed = list(self._processed), {}
        return processed

    def pop_cycles(self) -> list[tuple[str, Cycle]]:
        """The cycles found since this was asked last, each with the name of its joint."""
        cycles, self._cycles = self._cycles, []
        return cycles
