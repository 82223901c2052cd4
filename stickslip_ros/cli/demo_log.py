# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the demo hears from its nodes, how it waits for what it shows (bounded, a line a second), and its picture."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from rich.console import Console
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from stickslip_ros.cli.monitor_client import MonitorClient, margins_of, values_of
from stickslip_ros.cli.processes import NodeProcess
from stickslip_ros.cli.terminal import status_text
from stickslip_ros.errors import StickSlipError
from stickslip_ros.files import whole_file
from stickslip_ros.output.plotting import BLUE, GREEN, GREY, RED
from stickslip_ros.output.published import RESERVE_FIELD
from stickslip_ros.settings.parameter_names import MONITOR

CONTROLLER = "/simulated_joint"
START_LIMIT = 60.0  # [s]: a node starts within seconds, but for a busy machine
_COLUMNS = (
    "[dim]Once a second: position; number of slips so far; damping reserve, the damping in excess of that at which\n"
    "stick-slip ends (below 0 the joint sticks); and the monitor's status, which is of the last seconds of motion.[/]"
)
_MOST_POINTS = 6000
_LINE = 0.06  # of the panel's height
_MOST_RESERVE = 120.0  # [%]: what is beyond is drawn at the edge


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


def last_line(text: str) -> str:
    """Of what a node printed."""
    return text.strip().splitlines()[-1] if text.strip() else "it said nothing"


def draw(data: DemoData, path: Path, *, title: str, marks: Sequence[tuple[float, str]] = (), unit: str) -> None:
    """Write the picture as the file's ending says (.png, .svg, .pdf).

    Parameters
    ----------
    marks : stamps of changes [s], and what was changed.
    unit : of position, "rad" or "m".
    """
    from matplotlib.figure import Figure

    states = np.array(data.states)
    states = states[np.argsort(states[:, 0], kind="stable")]
    states = states[:: max(1, len(states) // _MOST_POINTS)]
    start = states[0, 0]
    reserves = [
        (row["time"] - start, 100.0 * row[RESERVE_FIELD]) for row in data.margins if not np.isnan(row[RESERVE_FIELD])
    ]
    has_velocity = bool(np.isfinite(states[:, 2]).any())
    rows = 1 + has_velocity + bool(reserves)
    heights = [2.2] + [1.3] * has_velocity + [1.2] * bool(reserves)
    figure = Figure(figsize=(10, 2.3 + 2.1 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, height_ratios=heights, squeeze=False)
    panels = list(axes[:, 0])
    scale, prefix = (1e3, "m") if np.ptp(states[:, 1]) < 1.0 else (1.0, "")
    top = panels.pop(0)
    if data.references:
        references = np.array(data.references)
        references = references[:: max(1, len(references) // _MOST_POINTS)]
        top.plot(references[:, 0] - start, scale * references[:, 1], color=GREY, linewidth=1.2, label="reference")
    top.plot(states[:, 0] - start, scale * states[:, 1], color=BLUE, linewidth=1.6, label="measured position")
    for number, cycle in enumerate(data.cycles):
        begin, end = cycle["breakaway"] - start, cycle["arrest"] - start
        top.axvspan(
            begin, end, color=RED, alpha=0.12, linewidth=0, label="slip of a detected cycle" if number == 0 else None
        )
    top.set_ylabel(f"position [{prefix}{unit}]")
    top.legend(loc="lower right", frameon=False)  # where a joint that moves up leaves room
    top.set_title(title, loc="left")
    if has_velocity:
        panel = panels.pop(0)
        panel.plot(states[:, 0] - start, scale * states[:, 2], color=BLUE, linewidth=1.0)
        panel.set_ylabel(f"velocity [{prefix}{unit}/s]")
    if reserves:
        panel = panels.pop(0)
        times, values = np.array(reserves).T
        values = np.minimum(values, _MOST_RESERVE)
        panel.axhline(0.0, color=GREY, linewidth=0.8)
        for where, colour in ((values > 0, GREEN), (values <= 0, RED)):
            panel.fill_between(times, values, 0.0, where=where, color=colour, alpha=0.25, linewidth=0, step="post")
        panel.step(times, values, where="post", color=BLUE, linewidth=1.4)
        panel.set_ylim(-_MOST_RESERVE, _MOST_RESERVE)
        panel.set_ylabel("damping reserve [%]")
        at = 0.005 * (states[-1, 0] - start)
        # Beside the line at 0, of which they speak: a joint that sticks stays near the lower edge.
        panel.text(at, 5.0, "above 0: no stick-slip", fontsize=8, color=GREEN)
        panel.text(at, -5.0, "below 0: stick-slip", va="top", fontsize=8, color=RED)
    for panel in axes[:, 0]:
        for changed, _ in marks:
            panel.axvline(changed - start, color="black", linestyle="--", linewidth=1.0)
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    for number, (changed, text) in enumerate(marks):
        # One below the other, as they may be close together.
        top.annotate(
            f" {text}", (changed - start, 0.03 + _LINE * (len(marks) - 1 - number)), xycoords=("data", "axes fraction"),
            fontsize=9,
        )  # fmt: skip
    axes[-1, 0].set_xlabel("time [s]")
    axes[-1, 0].set_xlim(0.0, states[-1, 0] - start)
    with whole_file(path) as image:
        figure.savefig(image, dpi=110, format=path.suffix[1:])
