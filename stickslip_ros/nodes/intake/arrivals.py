# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topics of motion while the node is active: what has arrived, in its order, and what still waits."""

from __future__ import annotations

import math
from collections.abc import Callable

from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.drain import DrainedSubscription, FirstMessage
from stickslip_ros.nodes.intake.joint_state_topic import JointStateTopic
from stickslip_ros.nodes.intake.reference_topic import reference_topic
from stickslip_ros.nodes.intake.refusals import Refusals

_QUEUE = 5000  # depth of a queue, messages: five seconds at 1 kHz without a drain lose none
_PENDING_PER_TICK = 5.0  # span of waiting messages that one tick processes, s: a tick stays short


class Arrivals:
    """Messages of joint states and references.

    Parameters
    ----------
    gains : topic of gains, whose messages end an idle time too.
    refuse : called with the reason why a message is refused.
    heard : called when the first message comes in an idle time, see :meth:`set_idle`.
    """

    def __init__(
        self,
        node: Node,
        reference_type: str,
        gains: DrainedSubscription,
        refuse: Refusals,
        heard: Callable[[], None],
    ) -> None:
        qos = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._references = reference_topic(node, reference_type, "joint_references", qos, refuse)
        self.states = JointStateTopic(node, "joint_states", qos, refuse)
        self._first = FirstMessage(node, (self.states.subscription, self._references.subscription, gains), heard)

    @property
    def messages(self) -> int:
        """Number of messages that came."""
        return self.states.messages + self._references.messages

    def set_idle(self, *, idle: bool) -> None:
        """Set whether the next message is to be reported at once."""
        self._first.armed = idle

    def keep(self) -> None:
        """Drain the topics, for later."""
        self.states.keep()
        self._references.keep()

    def behind(self, now: float) -> bool:
        """Whether messages still wait that came a while before a steady time [s]."""
        return now - self._oldest > _PENDING_PER_TICK

    def due_until(self, now: float) -> float:
        """Arrival of the last message that one tick processes, a steady time [s]."""
        return self._oldest + _PENDING_PER_TICK if self.behind(now) else math.inf

    def motion_until(self, until: float) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Samples and references of each joint that arrived until a steady time [s]."""
        # References last, so that they are no older than the samples that wait for them.
        samples = self.states.samples_until(until)
        return samples, self._references.samples_until(until)

    def close(self) -> None:
        """Close the subscriptions."""
        self._first.close()
        self.states.close()
        self._references.close()

    @property
    def _oldest(self) -> float:
        """Arrival of the oldest waiting message, a steady time [s]; infinite if none waits."""
        return min(self.states.backlog.oldest, self._references.backlog.oldest)
