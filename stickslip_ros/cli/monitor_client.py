# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Clients of the monitor's topics, for the commands that show what it publishes: of one monitor, or of every one on the
graph, in whatever namespace.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from stickslip_ros.cli.watch_view import JointView
from stickslip_ros.messages.joint_states import seconds
from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.running import turn
from stickslip_ros.output.diagnosis import Level
from stickslip_ros.settings.parameter_names import MONITOR
from stickslip_ros.visible import full_name, visible

_LONGEST_TURN = 0.05  # [s]
_QUEUE = 5000  # messages of motion: some seconds of a fast joint
_STALE_AFTER = 3.0  # [s] without a status
_LOOK_EVERY = 1.0  # [s] for monitors that have come since
_KEPT = 2000  # samples a joint
_SET_BACK = 1.0  # [s] from which on stamps of before are another story
_TOPIC = "friction"


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


@dataclass
class _Heard:
    level: Level = Level.STALE
    message: str = ""
    values: dict[str, str] = field(default_factory=dict)
    at: float = -math.inf
    history: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def number(self, key: str) -> float:
        return number_of(self.values.get(key, ""))


class WatchListener(MonitorClient):
    """A client of every monitor on the graph."""

    def __init__(self) -> None:
        super().__init__("stickslip_watch")
        self._joints: dict[str, _Heard] = {}
        self._monitors: dict[str, _Heard] = {}
        self._topics: set[str] = set()
        self._look_at = -math.inf

    def poll(self) -> None:
        """Listen to the positions that monitors publish with the friction, once a second to those that have come."""
        if time.monotonic() < self._look_at:
            return
        self._look_at = time.monotonic() + _LOOK_EVERY
        names = {name for name, _ in self.node.get_topic_names_and_types()}
        for name in sorted(names - self._topics):
            monitor, _, last = name.rpartition("/")
            if last == _TOPIC and f"{monitor}/margins" in names:
                self._topics.add(name)
                robot = monitor.rpartition("/")[0].strip("/")
                self.node.create_subscription(
                    JointState, name, lambda message, robot=robot: self._on_positions(robot, message), 100
                )

    def _on_positions(self, robot: str, message: JointState) -> None:
        now = seconds(message.header.stamp)
        for name, position in zip(message.name, message.position, strict=False):
            heard = self._joints.setdefault(full_name(robot, name), _Heard())
            before = heard.history[-1][0] if heard.history else -math.inf
            if now < before - _SET_BACK:
                heard.history.clear()
                before = -math.inf
            if now > before and math.isfinite(position):
                heard.history.append((now, position))

    def note(self, status: DiagnosticStatus) -> None:
        """Keep the status of a monitor, or of a joint of one."""
        robot, named, rest = status.name.rpartition(MONITOR)
        if not named or (robot and not robot.endswith("/")):
            return
        if not rest:
            self._note(self._monitors.setdefault(visible(status.name), _Heard()), status)
        elif rest.startswith(": "):
            self._note(self._joints.setdefault(visible(status.hardware_id), _Heard()), status)

    @staticmethod
    def _note(heard: _Heard, status: DiagnosticStatus) -> None:
        heard.level, heard.message, heard.at = Level(status.level[0]), visible(status.message), time.monotonic()
        heard.values = {visible(key): visible(value) for key, value in values_of(status).items()}

    def joints(self) -> list[JointView]:
        """What is known of every joint now."""
        return [self._view(name, heard) for name, heard in self._joints.items() if heard.values]

    @property
    def silent_for(self) -> float:
        """How long no monitor has said anything [s]; infinite before the first word."""
        return time.monotonic() - max((heard.at for heard in self._monitors.values()), default=-math.inf)

    @staticmethod
    def _view(name: str, heard: _Heard) -> JointView:
        silent = time.monotonic() - heard.at
        gone = silent > _STALE_AFTER
        # A joint whose friction has no time to rise needs no damping: its reserve is boundless.
        reserve = heard.number("exact damping_reserve [1]")
        known = heard.values.get("margin applicable") == "true"
        return JointView(
            name=name,
            level=Level.STALE if gone else heard.level,
            status="no monitor" if gone else heard.values.get("status", "no data"),
            message=_silence(silent) if gone else heard.message,
            velocity=heard.number("velocity [rad/s]"),
            outcome="" if gone else heard.values.get("exact outcome", ""),
            reserve=reserve if known else math.nan,
            cycles=int(heard.values.get("cycles [1]", "0")),
            slip=heard.number("last slip_distance [rad]"),
            history=np.array(heard.history).reshape(-1, 2),
            values=heard.values,
        )

    @property
    def compiling(self) -> str:
        """What a monitor says that compiles before it can say anything else, "" if none does."""
        return next((text for heard in self._monitors.values() if (text := heard.values.get("compiling", ""))), "")

    @property
    def silent(self) -> list[str]:
        """Monitors that are on the graph."""
        return sorted(topic.rpartition("/")[0] for topic in self._topics)

    def header(self) -> str:
        """How the monitors are, in a line."""
        lines = []
        for name, heard in sorted(self._monitors.items()):
            if time.monotonic() - heard.at > _STALE_AFTER:
                lines.append(f"{name}: silent")
                continue
            rate, late = heard.number("message rate [Hz]"), heard.number("latency from message to status [s]")
            health = [f"{rate:.0f} messages/s"] if math.isfinite(rate) else []
            health += [f"status after {1e3 * late:.0f} ms"] if math.isfinite(late) else []
            health += [heard.message] if heard.message else []
            lines.append(f"{name}: {', '.join(health) or 'no messages yet'}")
        return "\n".join(lines)


def _silence(duration: float) -> str:
    """What to say of a joint without a status for so long [s]; infinite: it never had one."""
    since = "no status yet" if math.isinf(duration) else f"no status for {duration:.0f} s"
    return f"{since}: is its monitor running?"
