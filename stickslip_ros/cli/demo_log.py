# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the demo hears from the two nodes: a node of its own."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.content import seconds
from stickslip_ros.nodes.intake.drain import DrainedSubscription
from stickslip_ros.nodes.running import turn
from stickslip_ros.output.margin_table import MARGIN_FIELDS


class DemoError(StickSlipError):
    """The demo could not go on."""


@dataclass
class DemoData:
    """Rows as they came: states (time, position, velocity), references (time, position), margins, cycles."""

    states: list[tuple[float, float, float]] = field(default_factory=list)
    references: list[tuple[float, float]] = field(default_factory=list)
    margins: list[dict[str, float]] = field(default_factory=list)
    cycles: list[dict[str, float]] = field(default_factory=list)


class DemoListener:
    """Listens to joint, monitor and diagnostics; all waiting is bounded."""

    def __init__(self, joint: str) -> None:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node("stickslip_demo")
        self.joint = joint
        self.data = DemoData()
        self.diagnostic: DiagnosticStatus | None = None
        qos = QoSProfile(depth=5000)
        self._states = DrainedSubscription(self.node, JointState, "joint_states", qos)
        self._references = DrainedSubscription(self.node, JointState, "joint_references", qos)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.node.create_subscription(DiagnosticArray, "/stickslip_monitor/cycles", self._on_cycles, 1000)
        self.node.create_subscription(Float64MultiArray, "/stickslip_monitor/margins", self._on_margins, 100)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    @property
    def now(self) -> float:
        """Stamp of the latest joint state [s], NaN before the first."""
        return self.data.states[-1][0] if self.data.states else math.nan

    def listen(self, duration: float) -> None:
        """Take what comes for so many seconds."""
        until = time.monotonic() + duration
        while True:
            left = until - time.monotonic()
            if left <= 0:
                break
            turn(self.node, min(left, 0.05))
            for message, _ in self._states.take_all():
                if self.joint in message.name:
                    index = message.name.index(self.joint)
                    velocity = message.velocity[index] if len(message.velocity) else math.nan
                    self.data.states.append((seconds(message.header.stamp), message.position[index], velocity))
            for message, _ in self._references.take_all():
                if self.joint in message.name:
                    index = message.name.index(self.joint)
                    self.data.references.append((seconds(message.header.stamp), message.position[index]))

    def value(self, key: str) -> str:
        """A value of the joint's diagnostic, "" before the first."""
        if self.diagnostic is None:
            return ""
        return next((pair.value for pair in self.diagnostic.values if pair.key == key), "")

    @property
    def status(self) -> str:
        """The joint's status word."""
        return self.value("status")

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id == self.joint and status.name.startswith("stickslip_monitor"):
                self.diagnostic = status

    def _on_cycles(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id == self.joint:
                self.data.cycles.append({pair.key.split(" [")[0]: float(pair.value) for pair in status.values})

    def _on_margins(self, message: Float64MultiArray) -> None:
        joints = message.layout.dim[0].label.split(",")
        if self.joint in joints:
            begin = joints.index(self.joint) * len(MARGIN_FIELDS)
            row = dict(zip(MARGIN_FIELDS, message.data[begin : begin + len(MARGIN_FIELDS)], strict=True))
            self.data.margins.append({"time": self.now, **row})

    def apply_recommendation(self, monitor: str) -> Future:
        """Ask the monitor to apply its advice; the answer comes once it is done."""
        client = self.node.create_client(Trigger, f"{monitor}/apply_recommendation")
        if not client.wait_for_service(5.0):
            raise DemoError(f"{monitor} offers no service to apply its advice")
        return client.call_async(Trigger.Request())

    def reset(self, monitor: str) -> Future:
        """Let the monitor forget the motion it has seen."""
        client = self.node.create_client(Trigger, f"{monitor}/reset")
        if not client.wait_for_service(5.0):
            raise DemoError(f"{monitor} offers no service to reset it")
        return client.call_async(Trigger.Request())

    def set_parameters(self, node: str, values: Mapping[str, object]) -> Future:
        """Set parameters of a node."""
        client = AsyncParameterClient(self.node, node)
        if not client.wait_for_services(5.0):
            raise DemoError(f"{node} offers no service to set its parameters")
        return client.set_parameters([Parameter(name, value=value) for name, value in values.items()])
