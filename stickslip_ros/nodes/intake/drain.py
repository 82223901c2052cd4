# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Subscriptions that are drained on a timer instead of calling back for every message.

rclpy's executor costs 60-190 µs a message however small the callback; taking waiting messages in one
go costs a tenth of that and loses none as long as the queue holds a drain period's worth.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from stickslip_ros.errors import StickSlipError

_MOST_AT_ONCE = 10_000


class NeverExecuted(CallbackGroup):
    """Keeps the executor's hands off a subscription or service."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to do: nothing began."""


class DrainedSubscription:
    """A subscription whose messages wait until they are taken.

    Parameters
    ----------
    raw : whether messages are taken as the bytes that came.

    Raises
    ------
    StickSlipError
        If the parameters that override its quality of service make none.
    """

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile, *, raw: bool = False) -> None:
        self._node, self._type, self._raw = node, message_type, raw
        try:
            self._subscription = node.create_subscription(
                message_type,
                topic,
                lambda _: None,
                qos,
                callback_group=NeverExecuted(),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        except (RuntimeError, InvalidQosOverridesError) as error:
            if not node.context.ok():
                raise
            # What the defaults make is sound, so it is the overrides.
            where = f"qos_overrides.{node.resolve_topic_name(topic)}.subscription"
            raise StickSlipError(f"{where}: {' '.join(str(error).split())}") from error

    @property
    def publishers(self) -> int:
        """How many publish on the topic."""
        return int(self._node.count_publishers(self._subscription.topic_name))

    def take_all(self) -> list[tuple[Any, dict[str, int]]]:
        """The messages waiting, oldest first, each with its sequence number and the times of sending and arrival."""
        found = []
        with self._subscription.handle:
            take, message_type, raw = self._subscription.handle.take_message, self._type, self._raw
            # No more than were kept, or a publisher that is faster than this loop would never let it end.
            for _ in range(_MOST_AT_ONCE):
                taken = take(message_type, raw)
                if taken is None:
                    break
                found.append(taken)
        return found

    def close(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)
