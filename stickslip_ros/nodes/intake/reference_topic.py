# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The desired motion: JointStates, or the states that a controller of control_msgs publishes."""

from __future__ import annotations

from importlib import import_module
from time import monotonic
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.messages.content import MessageError, reference_rows, seconds, with_time
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.intake.drain import ArrivalTimes, Backlog, DrainedSubscription
from stickslip_ros.nodes.intake.joint_state_topic import JointStateTopic, joined
from stickslip_ros.nodes.intake.refusals import Refusals

_CONTROL_TYPES = ("JointTrajectoryControllerState", "MultiDOFStateStamped")
# Names of the types in the graph, and in the parameter `reference_type`.
REFERENCE_TYPES = {
    "sensor_msgs/msg/JointState": "JointState",
    **{f"control_msgs/msg/{name}": name for name in _CONTROL_TYPES},
}


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


def reference_topic(
    node: Node, kind: str, topic: str, qos: QoSProfile, refuse: Refusals
) -> JointStateTopic | ControllerStateTopic:
    """Topic of a reference type; its rows begin with time, position and velocity.

    Raises
    ------
    StickSlipError
        If there is no such type, or its package is not installed.
    """
    if kind == "JointState":
        return JointStateTopic(node, topic, qos, refuse)
    return ControllerStateTopic(node, reference_message_type(kind), topic, qos, refuse)
