# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Subscriptions that are drained on a timer instead of calling back for every message.

rclpy's executor costs 60-190 µs a message however small the callback; taking waiting messages in one
go costs a tenth of that and loses none as long as the queue holds a drain period's worth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.waitable import NumberOfEntities, Waitable

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
            # What the defaults make is sound, so it is the overrides.
            where = f"qos_overrides.{node.resolve_topic_name(topic)}.subscription"
            raise StickSlipError(f"{where}: {' '.join(str(error).split())}") from error

    @property
    def publishers(self) -> int:
        """How many publish on the topic."""
        return int(self._node.count_publishers(self._subscription.topic_name))

    @property
    def endpoints(self) -> list[TopicEndpointInfo]:
        """What the graph knows of them."""
        return list(self._node.get_publishers_info_by_topic(self._subscription.topic_name))

    def take_all(self) -> list[tuple[Any, dict[str, int]]]:
        """The messages waiting, oldest first, each with its sequence number and the times of sending and arrival."""
        found = []
        with self._subscription.handle:
            take_message, message_type, raw = self._subscription.handle.take_message, self._type, self._raw
            # No more than were kept, or a publisher that is faster than this loop would never let it end.
            for _ in range(_MOST_AT_ONCE):
                taken = take_message(message_type, raw)
                if taken is None:
                    break
                found.append(taken)
        return found

    def add_to(self, wait_set: Any) -> int:
        """Have the executor wait for the next message too; returns the place in its wait set."""
        with self._subscription.handle:
            return int(wait_set.add_subscription(self._subscription.handle))

    def close(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)


class FirstMessage(Waitable):
    """Lets the executor call back as soon as a message waits in one of some subscriptions, while it is armed.

    The message stays where it is until it is taken. With it a node that nothing is sent to can sleep long, and is awake
    at once.

    Parameters
    ----------
    heard : what is called, once; it may arm this anew.
    """

    def __init__(self, node: Node, subscriptions: Sequence[DrainedSubscription], heard: Callable[[], None]) -> None:
        super().__init__(node.default_callback_group)
        self._node, self._subscriptions, self._heard = node, subscriptions, heard
        self._places: list[int] = []
        self.armed = False
        node.add_waitable(self)

    def get_num_entities(self) -> NumberOfEntities:
        """How many subscriptions are waited for."""
        return NumberOfEntities(num_subs=len(self._subscriptions) if self.armed else 0)

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Wait for them."""
        self._places = [one.add_to(wait_set) for one in self._subscriptions] if self.armed else []

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a message waits in any."""
        return any(wait_set.is_ready("subscription", place) for place in self._places)

    def take_data(self) -> None:
        """Take no message: that is for those who drain them."""
        self.armed = False

    async def execute(self, taken_data: None) -> None:
        """Say so."""
        self._heard()

    def close(self) -> None:
        """Wait for nothing any more; before the subscriptions are closed."""
        self._node.remove_waitable(self)
