# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topic `~/stability_map`: pictures of where joints stick, for as long as somebody looks at them."""

from __future__ import annotations

import math
from dataclasses import astuple

from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import CompressedImage

from stickslip_ros.nodes.publications import Findings
from stickslip_ros.nodes.while_listened import WhileListened
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.output.stability_map import MapSubject, picture, subject_of

_TO_BE_SEEN = 0.03  # relative change of a number that shows in a picture


def stability_maps(node: LifecycleNode, work: SlowWork) -> WhileListened[MapSubject, bytes]:
    """The topic."""

    def message(name: str, _: MapSubject, image: bytes) -> CompressedImage:
        found = CompressedImage(format="png", data=image)
        found.header.stamp = node.get_clock().now().to_msg()
        found.header.frame_id = name
        return found

    return WhileListened(
        node, work, "~/stability_map", CompressedImage,
        kind="stability map", answer=picture, question=_subject, similar=_similar, message=message,
    )  # fmt: skip


def _subject(name: str, one: Findings) -> MapSubject | None:
    return subject_of(name, one.assessment, one.assessment.velocity)


def _similar(one: MapSubject, other: MapSubject) -> bool:
    """Whether nobody could tell the two maps apart."""
    if (one.advised is None) != (other.advised is None) or one.per_inertia != other.per_inertia:
        return False
    if one.joint.friction.law != other.joint.friction.law:
        return False
    pairs = zip(_numbers(one), _numbers(other), strict=True)
    return all(math.isclose(first, second, rel_tol=_TO_BE_SEEN) for first, second in pairs)


def _numbers(subject: MapSubject) -> list[float]:
    gains = [each for each in (subject.gains, subject.advised) if each is not None]
    numbers = [abs(subject.velocity), *subject.joint.numbers.values()]
    return [*map(float, numbers), *(float(value) for each in gains for value in astuple(each))]
