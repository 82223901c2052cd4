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

_MOST_AT_ONCE = 10_000
ARRIVAL = "arrival"
_BY_THE_SYSTEM = "arrival by the system's clock (use_sim_time is true, and nothing is heard on /clock)"
_DRAIN = 0.02  # [s] for the first messages ever
_MOST_BYTES = 256e6

Taken = TypeVar("Taken")


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


class ArrivalTimes:
    """Times of arrival by the node's clock; ``first`` is that of the oldest message given last, by the system's.

    The middleware tells when a message came by the system's clock. Where the node follows simulated time, the
    messages that waited are spread over the time since the ones before; while that time stands, all of them came at it.
    Before the first message on /clock the system's clock counts. ``what`` names the time, for people.
    """

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._before = np.nan
        self.first = np.nan
        self.what = ARRIVAL

    def of(self, infos: Sequence[dict[str, int]]) -> NDArray[np.float64]:
        """Times [s] of messages in the order of their arrival; to be called for every drain, also an empty one."""
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
    """What was drained, in order; the oldest goes where it becomes too much. ``dropped`` counts messages."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Taken, int, int]] = deque()
        self._bytes = 0
        self.dropped = 0

    def add(self, now: float, taken: Taken, count: int, size: int) -> None:
        """Keep so many messages of so many bytes, drained at a steady time [s]."""
        self._waiting.append((now, taken, count, size))
        self._bytes += size
        while self._bytes > _MOST_BYTES and len(self._waiting) > 1:
            self.dropped += self._waiting[0][2]
            self._bytes -= self._waiting.popleft()[3]

    def pop_until(self, until: float) -> list[Taken]:
        """What was drained until then, and waits no longer."""
        found = []
        while self._waiting and self._waiting[0][0] <= until:
            _, taken, _, size = self._waiting.popleft()
            self._bytes -= size
            found.append(taken)
        return found

    @property
    def oldest(self) -> float:
        """When the oldest was drained [s]; infinite if none waits."""
        return self._waiting[0][0] if self._waiting else math.inf
