# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Subscriptions that are drained on a timer, arrival times of their messages, and a backlog of what has to wait.

rclpy's executor costs 60 to 190 µs a message however small the callback. Draining all waiting messages at once costs a
tenth of that, and loses none as long as the queue holds a drain period's worth.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from time import time
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.waitable import NumberOfEntities, Waitable

from stickslip_ros.errors import StickSlipError

ARRIVAL = "arrival"
_BY_THE_SYSTEM = "arrival by the system's clock (use_sim_time is true, and nothing is heard on /clock)"
_MOST_AT_ONCE = 10_000  # number of messages in one drain, 1: more than any queue holds
_DRAIN = 0.02  # span over which the first messages are spread, s: a drain period
_MOST_BYTES = 256e6  # size of a backlog, bytes: minutes of messages while the node compiles

Taken = TypeVar("Taken")


class NeverExecuted(CallbackGroup):
    """Callback group that no executor executes, for a subscription or service that is drained."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing, because nothing began."""


class DrainedSubscription:
    """A subscription whose messages wait until they are drained.

    Parameters
    ----------
    raw : whether messages are returned as bytes.

    Raises
    ------
    StickSlipError
        If the parameters that override the quality of service are invalid.
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
            # The defaults are sound, so the overrides are the cause.
            where = f"qos_overrides.{node.resolve_topic_name(topic)}.subscription"
            raise StickSlipError(f"{where}: {' '.join(str(error).split())}") from error

    @property
    def publishers(self) -> int:
        """Number of publishers on the topic."""
        return int(self._node.count_publishers(self._subscription.topic_name))

    @property
    def endpoints(self) -> list[TopicEndpointInfo]:
        """Publishers on the topic, as the graph has them."""
        return list(self._node.get_publishers_info_by_topic(self._subscription.topic_name))

    def take_all(self) -> list[tuple[Any, dict[str, int]]]:
        """The messages waiting, oldest first, each with its sequence number and the times of sending and arrival."""
        found = []
        with self._subscription.handle:
            take_message, message_type, raw = self._subscription.handle.take_message, self._type, self._raw
            # A publisher that is faster than this loop would never let it end.
            for _ in range(_MOST_AT_ONCE):
                taken = take_message(message_type, raw)
                if taken is None:
                    break
                found.append(taken)
        return found

    def add_to(self, wait_set: Any) -> int:
        """Add the subscription to a wait set of the executor; returns its place."""
        with self._subscription.handle:
            return int(wait_set.add_subscription(self._subscription.handle))

    def close(self) -> None:
        """Close the subscription."""
        self._node.destroy_subscription(self._subscription)


class FirstMessage(Waitable):
    """Callback of the executor as soon as a message waits in one of the subscriptions, while it is armed.

    The message stays in its subscription until it is drained. An idle node can sleep long and still wake at once.

    Parameters
    ----------
    heard : called once; it may arm the callback again.
    """

    def __init__(self, node: Node, subscriptions: Sequence[DrainedSubscription], heard: Callable[[], None]) -> None:
        super().__init__(node.default_callback_group)
        self._node, self._subscriptions, self._heard = node, subscriptions, heard
        self._places: list[int] = []
        self.armed = False
        node.add_waitable(self)

    def __enter__(self) -> None:
        """Mark nothing as in use, as Jazzy's base class does; Kilted's has no such method."""

    def __exit__(self, *_: object) -> None:
        pass

    def get_num_entities(self) -> NumberOfEntities:
        """Number of subscriptions in the wait set."""
        return NumberOfEntities(num_subs=len(self._subscriptions) if self.armed else 0)

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Add the subscriptions."""
        self._places = [one.add_to(wait_set) for one in self._subscriptions] if self.armed else []

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a message waits in any subscription."""
        return any(wait_set.is_ready("subscription", place) for place in self._places)

    def take_data(self) -> None:
        """Leave the message in its subscription, which is drained later."""
        self.armed = False

    async def execute(self, taken_data: None) -> None:
        """Call back."""
        self._heard()

    def close(self) -> None:
        """Stop waiting; to be called before the subscriptions are closed."""
        self._node.remove_waitable(self)


class ArrivalTimes:
    """Arrival times by the node's clock; ``first`` is that of the oldest message of the last drain, by the system's.

    The middleware has the arrival of a message by the system's clock. Where the node follows simulated time, the
    messages of a drain are spread over the time since the drain before; while simulated time stands, all of them came
    at that time. Before the first message on /clock the system's clock counts. ``what`` names the clock, for people.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._before = np.nan
        self.first = np.nan
        self.what = ARRIVAL

    def of(self, infos: Sequence[dict[str, int]]) -> NDArray[np.float64]:
        """Arrival times [s] of messages, in their order; to be called for every drain, also an empty one."""
        simulated = self._clock.ros_time_is_active
        now = 1e-9 * self._clock.now().nanoseconds
        without_clock = simulated and now == 0.0
        self.what = _BY_THE_SYSTEM if without_clock else ARRIVAL
        if without_clock:
            simulated, now = False, time()
        before = self._before if self._before <= now else now - _DRAIN
        self._before = np.nan if without_clock else now
        if not infos:
            return np.empty(0)
        received = np.array([info.get("received_timestamp") or 0 for info in infos])
        self.first = 1e-9 * float(received[0]) if received[0] else np.nan
        if received.all() and not simulated:
            return received * 1e-9
        return np.linspace(before, now, len(infos) + 1)[1:]


class Backlog(Generic[Taken]):
    """Drained messages in order; the oldest are dropped where they become too many. ``dropped`` counts them."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Taken, int, int]] = deque()
        self._bytes = 0
        self.dropped = 0

    def add(self, now: float, taken: Taken, count: int, size: int) -> None:
        """Add ``count`` messages of ``size`` bytes, drained at a steady time [s]."""
        self._waiting.append((now, taken, count, size))
        self._bytes += size
        while self._bytes > _MOST_BYTES and len(self._waiting) > 1:
            self.dropped += self._waiting[0][2]
            self._bytes -= self._waiting.popleft()[3]

    def pop_until(self, until: float) -> list[Taken]:
        """The messages that were drained until a steady time [s]; they are removed."""
        found = []
        while self._waiting and self._waiting[0][0] <= until:
            _, taken, _, size = self._waiting.popleft()
            self._bytes -= size
            found.append(taken)
        return found

    @property
    def oldest(self) -> float:
        """When the oldest messages were drained, a steady time [s]; infinite if none wait."""
        return self._waiting[0][0] if self._waiting else math.inf
