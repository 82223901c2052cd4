# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the demo hears from its nodes, and how it waits for what it shows: bounded, with a line a second."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from rich.console import Console
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.cli.analysis_tables import status_text
from stickslip_ros.cli.monitor_client import MonitorClient, margins_of, values_of
from stickslip_ros.cli.processes import NodeProcess
from stickslip_ros.errors import StickSlipError
from stickslip_ros.output.published import RESERVE_FIELD
from stickslip_ros.settings.parameter_names import MONITOR

CONTROLLER = "/simulated_joint"
START_LIMIT = 60.0  # [s]: a node starts within seconds, but for a busy machine
_COLUMNS = (
    "[dim]Once a second: position; number of slips so far; damping reserve, the damping in excess of that at which\n"
    "stick-slip ends (below 0 the joint sticks); and the monitor's status, which is of the last seconds of motion.[/]"
)


@dataclass
class DemoData:
    """Rows as they came: states (time, position, velocity), references (time, position), margins, cycles."""

    states: list[list[float]] = field(default_factory=list)
    references: list[list[float]] = field(default_factory=list)
    margins: list[dict[str, float]] = field(default_factory=list)
    cycles: list[dict[str, float]] = field(default_factory=list)


class DemoListener(MonitorClient):
    """Client of joint, monitor and diagnostics; all waiting is bounded.

    Parameters
    ----------
    nodes : the processes without which the demo cannot go on. unit : of the positions.
    """

    def __init__(self, joint: str, console: Console, nodes: Sequence[NodeProcess], unit: str) -> None:
        super().__init__("stickslip_demo")
        self._console, self._nodes, self._unit = console, nodes, unit
        self._next, self._start = math.inf, math.nan
        self.joint = joint
        self.data = DemoData()
        self.diagnostic: dict[str, str] | None = None
        self._states, self._references = self.motion()
        self.node.create_subscription(DiagnosticArray, f"/{MONITOR}/cycles", self._on_cycles, 1000)
        self.node.create_subscription(Float64MultiArray, f"/{MONITOR}/margins", self._on_margins, 100)

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
        if status.hardware_id == self.joint and status.name.startswith(MONITOR):
            self.diagnostic = values_of(status)

    def _on_cycles(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id == self.joint:
                self.data.cycles.append({key.split(" [")[0]: float(text) for key, text in values_of(status).items()})

    def _on_margins(self, message: Float64MultiArray) -> None:
        if self.joint in (found := margins_of(message)):
            self.data.margins.append({"time": self.now, **found[self.joint]})

    def trigger(self, service: str, purpose: str) -> Future:
        """Call a service of the monitor; the answer comes once it is done."""
        client = self.node.create_client(Trigger, f"/{MONITOR}/{service}")
        if not client.wait_for_service(5.0):
            raise StickSlipError(f"/{MONITOR} offers no service to {purpose}")
        return client.call_async(Trigger.Request())

    def set_parameters(self, values: Mapping[str, object]) -> Future:
        """Set parameters of the simulated joint."""
        client = AsyncParameterClient(self.node, CONTROLLER)
        if not client.wait_for_services(5.0):
            raise StickSlipError(f"{CONTROLLER} offers no service to set its parameters")
        return client.set_parameters([Parameter(name, value=value) for name, value in values.items()])

    def wait_for_nodes(self, heard: Callable[[], bool]) -> None:
        """Wait until the nodes are heard; from then on there is a line a second."""
        self.wait(heard, START_LIMIT, "the nodes to be heard")
        self._next = time.monotonic() + 1.0

    def wait(self, reached: Callable[[], bool], limit: float, what: str) -> None:
        """Listen until the goal is reached, with a line a second on where things stand once the nodes are heard.

        Raises
        ------
        StickSlipError
            If the time limit [s] has passed, or a node has ended.
        """
        until = time.monotonic() + limit
        while not reached():
            self.listen(0.1)
            self._print_state()
            for node in self._nodes:
                if not node.running:
                    raise StickSlipError(f"the node {node.module} ended: {last_line(node.output())}")
            if time.monotonic() > until:
                status = self.status or "not heard"
                raise StickSlipError(f"waited {limit:.0f} s in vain for {what}; the joint is {status}")

    def _print_state(self) -> None:
        if time.monotonic() < self._next or math.isnan(self.now):
            return
        self._next = time.monotonic() + 1.0
        if math.isnan(self._start):
            self._start = self.data.states[0][0]
            self._console.print(_COLUMNS)
        reserve = self.data.margins[-1][RESERVE_FIELD] if self.data.margins else math.nan
        text = f"reserve {100.0 * reserve:+5.0f} %" if math.isfinite(reserve) else "reserve     –  "
        reason = f": {self.value('reason')}" if self.value("reason") else ""
        self._console.print(
            f"  {self.now - self._start:5.1f} s  position {1e3 * self.data.states[-1][1]:9.2f} m{self._unit}  "
            f"slips {len(self.data.cycles):3d}  {text}  "
            f"{status_text(self.status or 'no status yet')}[dim]{reason}[/]"
        )


@contextmanager
def two_nodes(
    console: Console, joint: str, parameters: Mapping[str, object], of_joint: Mapping[str, object]
) -> Iterator[DemoListener]:
    """Processes of a simulated joint and of its monitor, and the listener to both.

    Parameters
    ----------
    parameters : of the monitor. of_joint : of the simulated joint.
    """
    with (
        NodeProcess("simulated_joint", {"joints": f"[{joint}]", **of_joint}) as simulated,
        NodeProcess("monitor", {**parameters, "controller": CONTROLLER}) as monitor,
        closing(DemoListener(joint, console, [simulated, monitor], "rad")) as listener,
    ):
        console.print(
            "Two nodes started: [bold]simulated_joint[/] (PUMA 560 joint 1, the paper's friction) and [bold]monitor[/]."
        )
        yield listener


def last_line(text: str) -> str:
    """Of what a node printed."""
    return text.strip().splitlines()[-1] if text.strip() else "it said nothing"
