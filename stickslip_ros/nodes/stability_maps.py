# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topic `~/stability_map`: pictures of where joints stick, for as long as somebody looks at them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CompressedImage

from stickslip_ros.nodes.joints.watched_joint import WORTH_CHANGING
from stickslip_ros.nodes.publications import Findings
from stickslip_ros.nodes.worker.background import Background
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.output.stability_map import MapSubject, picture, subject_of

_ASK_EVERY = 10.0  # [s] a joint
_TO_BE_SEEN = 0.03  # relative change of a number that shows in a picture
_LATCHED = QoSProfile(depth=64, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class StabilityMaps:
    """See the module. A joint has a picture from when it first sticks or is at risk, and a new one on change.

    Nothing is drawn while nobody listens, and one picture at a time: each keeps the process for slow work for a second.
    """

    def __init__(self, node: LifecycleNode, work: SlowWork) -> None:
        self._node = node
        self._publisher = node.create_lifecycle_publisher(CompressedImage, "~/stability_map", _LATCHED)
        self._pictures: Background[MapSubject, bytes] = Background(work, "stability map", picture)
        self._asked_at: dict[str, float] = {}
        self._shown: dict[str, MapSubject] = {}
        self._drawn = ""  # the joint whose picture is being drawn
        self._listeners = 0

    def close(self) -> None:
        """Take the topic from the graph."""
        self._node.destroy_lifecycle_publisher(self._publisher)

    def attend(self, joints: Mapping[str, Findings], now: float) -> None:
        """Publish pictures that are ready, and begin the next one that is due at a steady time [s]."""
        before, self._listeners = self._listeners, self._publisher.get_subscription_count()
        if self._listeners == 0:
            return
        if self._listeners > before:
            # Not every viewer asks for what was published before it came.
            self._shown.clear()
        for name in joints:
            known = self._pictures.latest(name)
            if known is not None and self._shown.get(name) is not known[0]:
                self._publish(name, known[1])
                self._shown[name] = known[0]
        if self._pictures.under_way(self._drawn):
            return
        for name, one in joints.items():
            subject = self._due(name, one, now)
            if subject is not None:
                self._pictures.ask(name, subject)
                self._asked_at[name], self._drawn = now, name
                return

    def _due(self, name: str, one: Findings, now: float) -> MapSubject | None:
        """What to draw of a joint, None if it needs no picture, or no other one."""
        known = self._pictures.latest(name)
        if known is None and one.assessment.finding.status not in WORTH_CHANGING:
            return None
        if one.silent_for is not None or now - self._asked_at.get(name, -math.inf) < _ASK_EVERY:
            return None
        subject = subject_of(name, one.assessment, one.assessment.velocity)
        return None if known is not None and subject is not None and _look_alike(known[0], subject) else subject

    def _publish(self, name: str, image: bytes) -> None:
        message = CompressedImage(format="png", data=image)
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = name
        self._publisher.publish(message)


def _look_alike(one: MapSubject, other: MapSubject) -> bool:
    """Whether nobody could tell the two maps apart."""
    if (one.advised is None) != (other.advised is None) or one.per_inertia != other.per_inertia:
        return False
    if one.joint.friction.law != other.joint.friction.law:
        return False
    pairs = zip(_numbers(one), _numbers(other), strict=True)
    return all(math.isclose(first, second, rel_tol=_TO_BE_SEEN) for first, second in pairs)


def _numbers(subject: MapSubject) -> list[float]:
    gains = [each for each in (subject.gains, subject.advised) if each is not None]
    numbers = [abs(subject.velocity), float(subject.joint.inertia), *subject.joint.friction.numbers.values()]
    return [*map(float, numbers), *(float(value) for each in gains for value in astuple(each))]
