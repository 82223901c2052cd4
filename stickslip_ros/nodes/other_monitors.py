# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Other monitors that run, and have this one's name or watch the same joints: for status, log, and ramps of gains."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Collection
from datetime import datetime, timezone

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from stickslip_ros.messages.gain_parameters import some
from stickslip_ros.nodes.intake.arrivals import DrainedSubscription
from stickslip_ros.nodes.intake.publishers import SCAN_EVERY
from stickslip_ros.visible import visible

_MONITOR, _STATES, _JOINTS = "this monitor", "joint_states", "joints"  # keys in the status of a monitor
_MARGINS = "margins"  # topic that every monitor has, by its last word
_GONE = 3.0  # time without a status of a monitor, s: an idle one publishes one a second
_QUEUE = 200  # depth of the queue, messages: two monitors publish fewer between two scans
_LONGEST = 200  # length of a monitor's name that is repeated, characters: it comes from the graph


class OtherMonitors:
    """Monitors other than the own one.

    A monitor that was killed stays on the graph for some seconds, in which its successor starts. So the graph only
    shows that there may be another monitor; a monitor that runs publishes its status, which is then listened to.

    Parameters
    ----------
    joints : names of the watched joints, which may grow.
    """

    def __init__(self, node: Node, joints: Collection[str]) -> None:
        self._node, self._joints = node, joints
        self._name, self._topic = node.get_fully_qualified_name(), node.resolve_topic_name(_STATES)
        since = datetime.now(timezone.utc).isoformat(sep=" ", timespec="milliseconds")
        # Processes in containers can have the same number on one host.
        self._own = f"{self._name} (process {os.getpid()} on {socket.gethostname()}, since {since})"
        self._next_scan = -math.inf
        self._diagnostics: DrainedSubscription | None = None
        self._heard: dict[str, tuple[float, frozenset[str]]] = {}  # last status, a steady time [s], and joints
        self._logged: set[tuple[str, bool]] = set()

    def values(self) -> list[tuple[str, object]]:
        """Keys and values in the node's own status, by which monitors find each other."""
        return [(_MONITOR, self._own), (_STATES, self._topic), (_JOINTS, ", ".join(self._joints))]

    def poll(self, now: float) -> None:
        """Scan the graph, and read what others publish, if it is time; ``now`` is a steady time [s]."""
        if now < self._next_scan:
            return
        self._next_scan = now + SCAN_EVERY
        if not self._may_be_there():
            self.close()
        elif self._diagnostics is None:
            self._diagnostics = DrainedSubscription(
                self._node, DiagnosticArray, "/diagnostics", QoSProfile(depth=_QUEUE), raw=True
            )
        else:
            for data, _ in self._diagnostics.take_all():
                self._read(data, now)
        self._heard = {other: one for other, one in self._heard.items() if now - one[0] < _GONE}
        for key, text in self._texts().items():
            if key not in self._logged:
                self._logged.add(key)
                self._node.get_logger().warning(text)

    @property
    def trouble(self) -> str:
        """Sentence on each monitor that has the own name or watches the same joints, "" for none."""
        return "; ".join(self._texts().values())

    def watching(self, joint: str) -> str:
        """Another monitor that watches a joint, "" if none does."""
        return next((other for other, (_, joints) in self._heard.items() if joint in joints), "")

    def close(self) -> None:
        """Stop listening."""
        if self._diagnostics is not None:
            self._diagnostics.close()
            self._diagnostics = None
        self._heard.clear()

    def _texts(self) -> dict[tuple[str, bool], str]:
        """Sentences on the other monitors, by monitor and whether it watches the same joints."""
        texts = {}
        for other, (_, joints) in self._heard.items():
            both = sorted(joints.intersection(self._joints))
            if both:
                texts[other, True] = f"another monitor watches {some(both)} too: {other}; end one of them"
            elif other.startswith(f"{self._name} ("):
                texts[other, False] = f"another monitor has this one's name: {other}; give one of them another name"
        return texts

    def _may_be_there(self) -> bool:
        """Whether the graph has another monitor of the own name, or one that subscribes to the same joint states."""
        names = [topic.rpartition("/") for topic, _ in self._node.get_topic_names_and_types()]
        monitors = [name for name, _, last in names if last == _MARGINS]
        return self._node.count_publishers(f"{self._name}/{_MARGINS}") > 1 or any(
            self._subscribes(name) for name in monitors if name != self._name
        )

    def _subscribes(self, monitor: str) -> bool:
        space, _, name = monitor.rpartition("/")
        try:
            topics = self._node.get_subscriber_names_and_types_by_node(name, space or "/")
        except NodeNameNonExistentError:
            return False
        return any(topic == self._topic for topic, _ in topics)

    def _read(self, data: bytes, now: float) -> None:
        # Most messages are the node's own.
        if _MONITOR.encode() not in data or self._own.encode() in data:
            return
        for status in deserialize_message(data, DiagnosticArray).status:
            values = {pair.key: pair.value for pair in status.values}
            other = visible(values.get(_MONITOR, ""))[:_LONGEST]
            if other:
                same = values.get(_STATES) == self._topic
                self._heard[other] = now, frozenset(values.get(_JOINTS, "").split(", ") if same else ())
