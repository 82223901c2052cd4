# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A topic of JointStates as rows of each joint: drained in batches of bytes, decoded as the bags are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from time import monotonic

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.messages.blocks import Block, FloatArray, Integers
from stickslip_ros.messages.content import with_times
from stickslip_ros.messages.joint_states import JointRows, JointStateDecoder, rows_by_joint
from stickslip_ros.nodes.intake.drain import ArrivalTimes, Backlog, DrainedSubscription
from stickslip_ros.nodes.intake.publishers import NAMED, name_of
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.visible import listed

_LONGEST_GAP = 5000  # gap in the sequence numbers, messages: after a larger one another publisher is assumed
_MOST_STREAMS = 16  # number of publishers that are distinguished, 1: few topics have more than two
_SCAN_EVERY = 0.5  # time between two counts of publishers, s: several publishers of a joint are reported within it
_CONTESTED = 4  # steps back in a joint's sequence numbers between two scans, 1: a restart of its publisher makes one
_LONGEST_REASON = 300  # length of a reason, characters: it may quote names from the graph


class SequenceNumbers:
    """Sequence numbers of the publishers on one topic; ``lost`` counts messages that never came.

    A message does not name its publisher. The number distinguishes publishers, unless several have sent about as many
    messages; a loss may then be missed.
    """

    def __init__(self) -> None:
        self._last: list[int] = []
        self.lost = 0

    def add_numbers(self, numbers: Sequence[int]) -> None:
        """Process sequence numbers in the order of arrival."""
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


@dataclass(frozen=True, kw_only=True)
class _Drained:
    """Messages of one drain, their arrival times [s], and their sequence numbers, None where there are none."""

    messages: Block
    arrivals: FloatArray
    numbers: list[int] | None


class JointStateTopic:
    """Subscription of JointStates, and the rows of each joint.

    Parameters
    ----------
    refuse : called with the reason why a message is refused.

    Attributes
    ----------
    messages : number of messages; waiting : largest number in a drain since the last :meth:`reset_figures`.
    oldest : arrival of the oldest message since then, in the system's time [s]; NaN if none came.
    contested : joints that several publishers move at once, which gives no single motion.
    contest : sentence with the names of the publishers then, "" otherwise.
    """

    def __init__(self, node: Node, topic: str, qos: QoSProfile, refuse: Refusals) -> None:
        self._topic, self._refuse = topic, refuse
        self.subscription = DrainedSubscription(node, JointState, topic, qos, raw=True)
        self._decoder = JointStateDecoder()
        self._arrivals = ArrivalTimes(node)
        self._sequence = SequenceNumbers()
        self._scanned_at = 0.0
        self._last_number: dict[str, int] = {}
        self._steps_back: dict[str, int] = {}
        self.backlog: Backlog[_Drained] = Backlog()
        self.publishers = 0
        self.messages = self.waiting = 0
        self.oldest = np.nan
        self.contested: frozenset[str] = frozenset()
        self.contest = ""

    @property
    def lost(self) -> int:
        """Number of messages that never came."""
        return self._sequence.lost

    def reset_figures(self) -> None:
        """Reset the figures of drains."""
        self.waiting, self.oldest = 0, np.nan

    def keep(self) -> None:
        """Drain the messages that have arrived into the backlog; the middleware keeps no more than its queue holds."""
        taken = self.subscription.take_all()
        self._scan_graph()
        arrivals = self._arrivals.of([info for _, info in taken])
        if not taken:
            return
        self.messages += len(taken)
        self.waiting = max(self.waiting, len(taken))
        if not self.oldest <= self._arrivals.first:
            self.oldest = self._arrivals.first
        numbers = [number for _, info in taken if (number := info.get("publication_sequence_number")) is not None]
        numbered = len(numbers) == len(taken)
        if numbered:
            self._sequence.add_numbers(numbers)
        block = Block.of_messages(((0, 0, data) for data, _ in taken), {})
        drained = _Drained(messages=block, arrivals=arrivals, numbers=numbers if numbered else None)
        self.backlog.add(monotonic(), drained, len(taken), len(block.buffer))
        if self.backlog.dropped:
            self._refuse_many("too many while the node compiled; the oldest were dropped", self.backlog.dropped)
            self.backlog.dropped = 0

    def samples_until(self, until: float) -> dict[str, FloatArray]:
        """Rows of time, position, velocity and effort of each joint, of messages until a steady time [s]."""
        self.keep()
        return joined([self._rows(drained) for drained in self.backlog.pop_until(until)])

    def _rows(self, drained: _Drained) -> dict[str, FloatArray]:
        block = drained.messages
        found = self._decoder.decode(block, np.arange(len(block)))
        for reason, count in self._decoder.refused.items():
            self._refuse_many(reason, count)
        self._decoder.refused.clear()
        if drained.numbers is not None and self.publishers > 1:
            self._count_steps_back(found, np.array(drained.numbers))
        return rows_by_joint(found, [self._times(rows, drained.arrivals) for rows in found])

    def _times(self, rows: JointRows, arrivals: FloatArray) -> FloatArray:
        """Stamps, or arrival times where there are none."""
        return with_times(rows.time, arrivals[rows.index], self._arrivals.what, self._refuse_many)

    def _scan_graph(self) -> None:
        now = monotonic()
        if now - self._scanned_at < _SCAN_EVERY:
            return
        self._scanned_at = now
        self.publishers = self.subscription.publishers
        self.contested = frozenset(name for name, steps in self._steps_back.items() if steps >= _CONTESTED)
        self.contest = self._who_contests() if self.contested else ""
        if self.publishers < 2:
            self._last_number.clear()
        self._steps_back.clear()

    def _who_contests(self) -> str:
        # Messages do not name their publisher; of more than two publishers any two may be the cause.
        names = listed(sorted(map(name_of, self.subscription.endpoints)), NAMED)
        return f"published by several nodes at once ({names}); remap all but one of them"

    def _count_steps_back(self, found: list[JointRows], numbers: Integers) -> None:
        """Count steps back in the sequence numbers of each joint's messages: one publisher's numbers only grow."""
        indices: dict[str, list[Integers]] = {}
        for rows in found:
            for name in rows.names:
                indices.setdefault(name, []).append(rows.index)
        for name, parts in indices.items():
            mine = numbers[np.sort(np.concatenate(parts))]
            steps = int((np.diff(mine, prepend=self._last_number.get(name, mine[0] - 1)) <= 0).sum())
            self._last_number[name] = int(mine[-1])
            if steps:
                self._steps_back[name] = self._steps_back.get(name, 0) + steps

    def _refuse_many(self, reason: str, count: int) -> None:
        self._refuse(f"{self._topic}: {reason[:_LONGEST_REASON]}", count)

    def close(self) -> None:
        """Close the subscription."""
        self.subscription.close()


def joined(parts: list[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    """Rows of each joint, joined from several drains in their order."""
    if len(parts) == 1:
        return parts[0]
    return {
        name: np.concatenate([part[name] for part in parts if name in part])
        for name in dict.fromkeys(name for part in parts for name in part)
    }
