# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Client of the monitor's topics, for the commands that show what it publishes: a node, and messages as plain data."""

from __future__ import annotations

import math
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64MultiArray

from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.running import turn

_LONGEST_TURN = 0.05  # [s]
_QUEUE = 5000  # messages of motion: some seconds of a fast joint


class MonitorClient:
    """A node that only listens; a command's own client inherits from it."""

    def __init__(self, name: str) -> None:
        # Ctrl-C is the command's: rclpy's own handler would end the context in the middle of a call.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(name)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    def listen(self, duration: float) -> None:
        """Take what comes for so many seconds."""
        until = time.monotonic() + duration
        while (left := until - time.monotonic()) > 0:
            turn(self.node, min(left, _LONGEST_TURN))
            self.poll()

    def note(self, status: DiagnosticStatus) -> None:
        """Called with every diagnostic status, of whatever node."""

    def poll(self) -> None:
        """Called many times a second."""

    def motion(
        self, robot: str = "", reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    ) -> tuple[JointStateTopic, JointStateTopic]:
        """Joint states and references of a robot from now on, "" for the one without a name."""
        qos, refuse = QoSProfile(depth=_QUEUE, reliability=reliability), Refusals(lambda _: None)
        names = (f"/{robot}/{name}" if robot else f"/{name}" for name in ("joint_states", "joint_references"))
        states, references = (JointStateTopic(self.node, name, qos, refuse) for name in names)
        return states, references

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.note(status)


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """The values of a diagnostic status, or of a cycle, by key."""
    return {pair.key: pair.value for pair in status.values}


def number_of(text: str) -> float:
    """Number in a diagnostic's text; NaN where there is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def margins_of(message: Float64MultiArray) -> dict[str, dict[str, float]]:
    """Rows of `~/margins` by joint, each by the names of its fields."""
    joints, fields = (one.label.split(",") for one in message.layout.dim)
    values = iter(message.data)
    return {joint: {field: next(values) for field in fields} for joint in joints}
