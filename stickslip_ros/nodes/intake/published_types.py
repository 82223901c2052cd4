# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is really published on the topics that the node listens to: messages of another type never arrive."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rclpy.node import Node

from stickslip_ros.nodes.intake.publishers import NAMED, is_named, names_of
from stickslip_ros.nodes.intake.references import REFERENCE_TYPES
from stickslip_ros.visible import listed

REFERENCES = "joint_references"
_SCAN_EVERY = 1.0  # [s]


class PublishedTypes:
    """Looks at the graph now and then.

    Parameters
    ----------
    wanted : the type that is listened to, as in sensor_msgs/msg/JointState, by topic.

    ``troubles`` has a sentence for every topic on which something else is published.
    """

    def __init__(self, node: Node, wanted: Mapping[str, str]) -> None:
        self._node, self._wanted = node, wanted
        self._next_scan = -math.inf
        self._unnamed: set[str] = set()
        self.troubles: dict[str, str] = {}

    def poll(self, now: float) -> None:
        """Look again if it is time; ``now`` is a steady time [s]."""
        if now < self._next_scan:
            return
        self._next_scan = now + _SCAN_EVERY
        found = {topic: self._trouble(topic, wanted) for topic, wanted in self._wanted.items()}
        for topic, text in found.items():
            if text and topic not in self.troubles:
                self._node.get_logger().warning(text)
        self.troubles = {topic: text for topic, text in found.items() if text}

    def _trouble(self, topic: str, wanted: str) -> str:
        name = self._node.resolve_topic_name(topic)
        others = [one for one in self._node.get_publishers_info_by_topic(name) if one.topic_type != wanted]
        # A publisher can be known before the name of its node is; by the next look it is known, if ever.
        unnamed = not all(map(is_named, others))
        if unnamed and topic not in self._unnamed:
            self._unnamed.add(topic)
            return self.troubles.get(topic, "")
        if not unnamed:
            self._unnamed.discard(topic)
        if not others:
            return ""
        kinds = sorted({one.topic_type for one in others})
        nodes = listed(names_of(others), NAMED)
        return f"{name} carries {', '.join(kinds)} from {nodes}, and {_advice(topic, wanted, kinds)}"


def _advice(topic: str, wanted: str, kinds: list[str]) -> str:
    if topic != REFERENCES:
        return f"{wanted} is listened to: remap {topic}"
    word = wanted.rpartition("/")[2]
    fitting = next((REFERENCE_TYPES[kind] for kind in kinds if kind in REFERENCE_TYPES), "")
    what = f"set it to {fitting}" if fitting else f"remap {topic}, as no reference_type reads that"
    return f"reference_type is {word}: {what}"
