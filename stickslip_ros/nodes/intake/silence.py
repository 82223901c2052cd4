# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Topics on which nothing is heard for long: joint states, and the clock of a simulation."""

from __future__ import annotations

import math
import os

from rclpy.node import Node

from stickslip_ros.messages.joint_states import TYPE
from stickslip_ros.nodes.intake.publishers import NAMED, publishers_by_topic
from stickslip_ros.visible import listed

_PATIENCE = 10.0  # [s] without a message that are worth a warning
_CLOCK_PATIENCE = 5.0  # [s] from the start of the node to the first message on /clock
_INACTIVE = 2.0  # [s] between two looks, from which on the node was inactive meanwhile and could hear nothing
_SCAN_EVERY = 1.0  # [s] at the graph
_WORD = TYPE.rpartition("/")[2]


class SilentStates:
    """Looks for publishers of joint states while none are heard; the log has one line for each silence.

    Parameters
    ----------
    topic : as the node calls it, before remapping.

    ``text`` says what is listened to and what there is instead, "" while messages come.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self._topic = node, topic
        self._messages = 0
        self._heard_at = self._polled_at = -math.inf
        self._next_scan = -math.inf
        self.text = ""

    def poll(self, now: float, messages: int) -> None:
        """Compare how many messages have come since the node was activated with how many had.

        Parameters
        ----------
        now : a steady time [s].
        """
        anew = now - self._polled_at > _INACTIVE or messages < self._messages
        self._polled_at = now
        if anew or messages > self._messages:
            if self.text and not anew:
                self._node.get_logger().info(f"{self._node.resolve_topic_name(self._topic)} is heard")
            self._messages, self._heard_at, self.text = messages, now, ""
        elif now - self._heard_at >= _PATIENCE and now >= self._next_scan:
            self._next_scan = now + _SCAN_EVERY
            first, self.text = not self.text, self._sentence()
            if first:
                self._node.get_logger().warning(self.text)

    def _sentence(self) -> str:
        own = self._node.resolve_topic_name(self._topic)
        found = publishers_by_topic(self._node, TYPE)
        here = found.pop(own, [])
        others = [f"{topic} (by {listed(names, NAMED)})" for topic, names in sorted(found.items())]
        # Who publishes there is silent; without anybody another topic was meant.
        who = f"{listed(here, NAMED)} publishes there and sends nothing" if here else f"no node publishes {_WORD} there"
        if others:
            what = f"; {_WORD} is published on {listed(others, NAMED)}" + ("" if here else f": remap {self._topic}")
        else:
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            what = "" if here else f", and {_WORD} is on no other topic in ROS_DOMAIN_ID {domain}"
        since = "any more" if self._messages else "yet"
        return f"nothing is heard on {own} ({TYPE}) {since}, for {_PATIENCE:g} s: {who}{what}"


class SilentClock:
    """Sees that simulated time is asked for and never comes.

    ``text`` says so, "" otherwise.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, node.get_clock()
        self._began = math.nan
        self._logged = False
        self.text = ""

    def poll(self, now: float) -> None:
        """Look at the clock; ``now`` is a steady time [s]."""
        self.text = ""
        if not self._clock.ros_time_is_active or self._clock.now().nanoseconds:
            self._began = math.nan
            return
        self._began = now if math.isnan(self._began) else self._began
        if now - self._began < _CLOCK_PATIENCE:
            return
        self.text = "use_sim_time is true and nothing is heard on /clock: what is published has the stamp zero"
        if not self._logged:
            self._logged = True
            self._node.get_logger().warning(self.text)
