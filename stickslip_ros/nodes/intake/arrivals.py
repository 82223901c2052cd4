# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topics of motion while the node is active: what has arrived, in its order, and what still waits.

The desired motion comes as JointStates, or as the states that a controller of control_msgs publishes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import import_module
from time import monotonic
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.messages.content import MessageError, reference_rows, seconds, with_time
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.drain import ArrivalTimes, Backlog, DrainedSubscription, FirstMessage
from stickslip_ros.nodes.intake.joint_state_topic import JointStateTopic, joined
from stickslip_ros.nodes.intake.refusals import Refusals

STATES, REFERENCES = "joint_states", "joint_references"
_CONTROL_TYPES = ("JointTrajectoryControllerState", "MultiDOFStateStamped")
# Names of the types in the graph, and in the parameter `reference_type`.
REFERENCE_TYPES = {
    "sensor_msgs/msg/JointState": "JointState",
    **{f"control_msgs/msg/{name}": name for name in _CONTROL_TYPES},
}
_QUEUE = 5000  # depth of a queue, messages: five seconds at 1 kHz without a drain lose none
_PENDING_PER_TICK = 5.0  # span of waiting messages that one tick processes, s: a tick stays short


def reference_type_name(name: str) -> str:
    """Name of a reference type in the graph."""
    return next(full for full, word in REFERENCE_TYPES.items() if word == name)


def reference_message_type(name: str) -> type:
    """Message class of a reference type.

    Raises
    ------
    StickSlipError
        If there is no such type, or control_msgs is needed and not installed.
    """
    if name == "JointState":
        return JointState  # type: ignore[no-any-return]
    if name not in _CONTROL_TYPES:
        raise InvalidParameterError("reference_type", f"one of JointState, {', '.join(_CONTROL_TYPES)}", name)
    try:
        return getattr(import_module("control_msgs.msg"), name)  # type: ignore[no-any-return]
    except ImportError as error:
        raise StickSlipError(f"reference_type {name} needs the package control_msgs: {error}") from error


class ControllerStateTopic:
    """A topic of JointTrajectoryControllerState or MultiDOFStateStamped, which is decoded message by message.

    ``messages`` : number of messages.
    """

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile, refuse: Refusals) -> None:
        self._topic, self._refuse = topic, refuse
        self.subscription = DrainedSubscription(node, message_type, topic, qos)
        self._arrivals = ArrivalTimes(node)
        self.messages = 0
        self.backlog: Backlog[dict[str, FloatArray]] = Backlog()

    def samples_until(self, until: float) -> dict[str, FloatArray]:
        """Rows of time, position and velocity of each joint, of messages until a steady time [s]."""
        self.keep()
        return joined(self.backlog.pop_until(until))

    def keep(self) -> None:
        """Drain the messages that have arrived into the backlog."""
        taken = self.subscription.take_all()
        self.messages += len(taken)
        arrivals = self._arrivals.of([info for _, info in taken])
        rows: dict[str, list[tuple[float, float, float]]] = {}
        for (message, _), arrival in zip(taken, arrivals.tolist(), strict=True):
            self._process_message(message, arrival, rows)
        if rows:
            tables = {name: np.array(found) for name, found in rows.items()}
            self.backlog.add(monotonic(), tables, len(taken), sum(table.nbytes for table in tables.values()))

    def _process_message(self, message: Any, arrival: float, rows: dict[str, list[tuple[float, float, float]]]) -> None:
        try:
            found = reference_rows(message)
        except MessageError as error:
            self._refuse(f"{self._topic}: {error}")
            return
        time = with_time(seconds(message.header.stamp), arrival, self._arrivals.what, self._refuse_many)
        for name, (position, velocity) in found.items():
            rows.setdefault(name, []).append((time, position, velocity))

    def _refuse_many(self, reason: str, count: int) -> None:
        self._refuse(f"{self._topic}: {reason}", count)

    def close(self) -> None:
        """Close the subscription."""
        self.subscription.close()


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
        kind = reference_message_type(reference_type)
        self._references: JointStateTopic | ControllerStateTopic = (
            JointStateTopic(node, REFERENCES, qos, refuse)
            if kind is JointState
            else ControllerStateTopic(node, kind, REFERENCES, qos, refuse)
        )
        self.states = JointStateTopic(node, STATES, qos, refuse)
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
