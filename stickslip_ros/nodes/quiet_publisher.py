# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Publishers that cost nothing while nothing is published."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher


def quiet_publisher(node: LifecycleNode, message_type: type, topic: str, quality: Any) -> LifecyclePublisher:
    """Make a publisher that is silent while the node is inactive, and that has no events.

    By default a publisher has two events that only write a line to the log, and rclpy's executor goes through all
    events whenever it waits: they took half of what an idle monitor takes. The subscriber at the other end, whose
    quality of service or type does not fit, has the same line in its log.

    Parameters
    ----------
    quality : depth of the queue [1], or a quality of service.
    """
    without = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_lifecycle_publisher(message_type, topic, quality, event_callbacks=without)
