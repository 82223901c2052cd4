# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the demo hears from the two nodes: a node of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.cli.monitor_client import MonitorClient, margins_of, values_of
from stickslip_ros.errors import StickSlipError


@dataclass
class DemoData:
    """Rows as they came: states (time, position, velocity), references (time, position), margins, cycles."""

    states: list[list[float]] = field(default_factory=list)
    references: list[list[float]] = field(default_factory=list)
    margins: list[dict[str, float]] = field(default_factory=list)
    cycles: list[dict[str, float]] = field(default_factory=list)


class DemoListener(MonitorClient):
    """Listens to joint, monitor and diagnostics; all waiting is bounded."""

    def __init__(self, joint: str) -> None:
        super().__init__("stickslip_demo")
        self.joint = joint
        self.data = DemoData()
        self.diagnostic: dict[str, str] | None = None
        self._states, self._references = self.motion()
        self.node.create_subscription(DiagnosticArray, "/stickslip_monitor/cycles", self._on_cycles, 1000)
        self.node.create_subscription(Float64MultiArray, "/stickslip_monitor/margins", self._on_margins, 100)

    @property
    def now(self) -> float:
        """Stamp of the latest joint state [s], NaN before the first."""
        return self.data.states[-1][0] if self.data.states else math.nan

    def poll(self) -> None:
        """Take the motion that has come."""
        if self.joint in (states := self._states.samples_until(math.inf)):
            self.data.states += states[self.joint][:, :3].tolist()
        if self.joint in (references := self._references.samples_until(math.inf)):
            self.data.references += references[self.joint][:, :2].tolist()

    def value(self, key: str) -> str:
        """A value of the joint's diagnostic, "" before the first."""
        return (self.diagnostic or {}).get(key, "")

    @property
    def status(self) -> str:
        """The joint's status word."""
        return self.value("status")

    def note(self, status: DiagnosticStatus) -> None:
        """Keep the joint's status."""
        if status.hardware_id == self.joint and status.name.startswith("stickslip_monitor"):
            self.diagnostic = values_of(status)

    def _on_cycles(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id == self.joint:
                self.data.cycles.append({key.split(" [")[0]: float(text) for key, text in values_of(status).items()})

    def _on_margins(self, message: Float64MultiArray) -> None:
        if self.joint in (found := margins_of(message)):
            self.data.margins.append({"time": self.now, **found[self.joint]})

    def trigger(self, monitor: str, service: str, purpose: str) -> Future:
        """Call a service of the monitor; the answer comes once it is done."""
        client = self.node.create_client(Trigger, f"{monitor}/{service}")
        if not client.wait_for_service(5.0):
            raise StickSlipError(f"{monitor} offers no service to {purpose}")
        return client.call_async(Trigger.Request())

    def set_parameters(self, node: str, values: Mapping[str, object]) -> Future:
        """Set parameters of a node."""
        client = AsyncParameterClient(self.node, node)
        if not client.wait_for_services(5.0):
            raise StickSlipError(f"{node} offers no service to set its parameters")
        return client.set_parameters([Parameter(name, value=value) for name, value in values.items()])
