# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topics of motion while the node is active: drained in batches of bytes, decoded as the bags are.

rclpy's executor costs 60 to 190 µs a message however small the callback. Draining all waiting messages at once costs a
tenth of that, and loses none as long as the queue holds a drain period's worth.

The desired motion comes as JointStates, or as the states that a controller of control_msgs publishes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from time import monotonic, time
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.waitable import NumberOfEntities, Waitable
from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.messages.joint_states import (
    Block,
    FloatArray,
    Integers,
    JointRows,
    JointStateDecoder,
    MessageError,
    reference_rows,
    rows_by_joint,
    seconds,
    with_time,
    with_times,
)
from stickslip_ros.nodes.intake.publishers import NAMED, name_of
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.visible import listed

ARRIVAL = "arrival"
_BY_THE_SYSTEM = "arrival by the system's clock (use_sim_time is true, and nothing is heard on /clock)"
_MOST_AT_ONCE = 10_000  # number of messages in one drain, 1: more than any queue holds
_DRAIN = 0.02  # span over which the first messages are spread, s: a drain period
_MOST_BYTES = 256e6  # size of a backlog, bytes: minutes of messages while the node compiles
_LONGEST_GAP = 5000  # gap in the sequence numbers, messages: after a larger one another publisher is assumed
_MOST_STREAMS = 16  # number of publishers that are distinguished, 1: few topics have more than two
_COUNT_EVERY = 0.5  # time between two counts of publishers, s: several publishers of a joint are reported within it
_CONTESTED = 4  # steps back in a joint's sequence numbers between two scans, 1: a restart of its publisher makes one
_LONGEST_REASON = 300  # length of a reason, characters: it may quote names from the graph
STATES, REFERENCES = "joint_states", "joint_references"
_CONTROL_TYPES = ("JointTrajectoryControllerState", "MultiDOFStateStamped")
# Names of the types in the graph, and in the parameter `reference_type`.
REFERENCE_TYPES = {
    "sensor_msgs/msg/JointState": "JointState",
    **{f"control_msgs/msg/{name}": name for name in _CONTROL_TYPES},
}
_QUEUE = 5000  # depth of a queue, messages: five seconds at 1 kHz without a drain lose none
_PENDING_PER_TICK = 5.0  # span of waiting messages that one tick processes, s: a tick stays short
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


class SequenceNumbers:
    """Sequence numbers of the publishers on one topic; ``lost`` counts messages that never came.

    A message does not name its publisher. The number distinguishes publishers, unless several have sent about as many
    messages; a loss may then be missed.
    """

    def __init__(self) -> None:
        self._last: list[int] = []
        self.lost = 0

    def add_numbers(self, numbers: Sequence[int]) -> None:
        """Process sequence numbers in the order of arrival."""
        if len(self._last) == 1 and numbers[0] == self._last[0] + 1 and numbers[-1] == self._last[0] + len(numbers):
            self._last[0] = numbers[-1]
            return
        for number in numbers:
            before = [last for last in self._last if 0 < number - last <= _LONGEST_GAP]
            if before:
                nearest = max(before)
                self.lost += number - nearest - 1
                self._last.remove(nearest)
            self._last = [*self._last[-_MOST_STREAMS + 1 :], number]


class MotionTopic(Generic[Taken]):
    """A topic of motion. What is drained waits until it is due; the oldest is dropped where it becomes too much.

    Parameters
    ----------
    refuse : called with the reason why a message is refused.

    ``messages`` : number of messages.
    """

    def __init__(
        self, node: Node, message_type: type, topic: str, qos: QoSProfile, refuse: Refusals, *, raw: bool = False
    ) -> None:
        self._topic, self._refuse = topic, refuse
        self.subscription = DrainedSubscription(node, message_type, topic, qos, raw=raw)
        self._arrivals = ArrivalTimes(node)
        # When they were drained, a steady time [s], what was drained, number of messages, and size [bytes].
        self._backlog: deque[tuple[float, Taken, int, int]] = deque()
        self._bytes = 0
        self.messages = 0

    @property
    def waits_since(self) -> float:
        """When the oldest waiting messages were drained, a steady time [s]; infinite if none wait."""
        return self._backlog[0][0] if self._backlog else math.inf

    def keep(self) -> None:
        """Drain the messages that have arrived into the backlog; the middleware keeps no more than its queue holds."""
        taken = self.subscription.take_all()
        arrivals = self._arrivals.of([info for _, info in taken])
        if not taken:
            return
        self.messages += len(taken)
        drained, size = self._drained(taken, arrivals)
        self._backlog.append((monotonic(), drained, len(taken), size))
        self._bytes += size
        dropped = 0
        while self._bytes > _MOST_BYTES and len(self._backlog) > 1:
            dropped += self._backlog[0][2]
            self._bytes -= self._backlog.popleft()[3]
        if dropped:
            self._refuse_many("too many while the node compiled; the oldest were dropped", dropped)

    def samples_until(self, until: float) -> dict[str, FloatArray]:
        """Rows of time, position, velocity and perhaps effort of each joint, of messages until a steady time [s]."""
        self.keep()
        parts = []
        while self._backlog and self._backlog[0][0] <= until:
            _, drained, _, size = self._backlog.popleft()
            self._bytes -= size
            parts.append(self._rows(drained))
        return joined(parts)

    def _drained(self, taken: list[tuple[Any, dict[str, int]]], arrivals: FloatArray) -> tuple[Taken, int]:
        """What is kept of messages with their arrival times [s], and its size [bytes]."""
        raise NotImplementedError

    def _rows(self, drained: Taken) -> dict[str, FloatArray]:
        """Rows of each joint, of what was kept."""
        raise NotImplementedError

    def _refuse_many(self, reason: str, count: int) -> None:
        self._refuse(f"{self._topic}: {reason[:_LONGEST_REASON]}", count)

    def close(self) -> None:
        """Close the subscription."""
        self.subscription.close()


@dataclass(frozen=True, kw_only=True)
class _Drained:
    """Messages of one drain, their arrival times [s], and their sequence numbers, None where there are none."""

    messages: Block
    arrivals: FloatArray
    numbers: list[int] | None


class JointStateTopic(MotionTopic[_Drained]):
    """Subscription of JointStates, and the rows of each joint.

    Attributes
    ----------
    waiting : largest number of messages in a drain since the last :meth:`reset_figures`.
    oldest : arrival of the oldest message since then, in the system's time [s]; NaN if none came.
    contested : joints that several publishers move at once, which gives no single motion.
    contest : sentence with the names of the publishers then, "" otherwise.
    """

    def __init__(self, node: Node, topic: str, qos: QoSProfile, refuse: Refusals) -> None:
        super().__init__(node, JointState, topic, qos, refuse, raw=True)
        self._decoder = JointStateDecoder()
        self._sequence = SequenceNumbers()
        self._scanned_at = 0.0
        self._last_number: dict[str, int] = {}
        self._steps_back: dict[str, int] = {}
        self.publishers = self.waiting = 0
        self.oldest = np.nan
        self.contested: frozenset[str] = frozenset()
        self.contest = ""

    @property
    def lost(self) -> int:
        """Number of messages that never came."""
        return self._sequence.lost

    def reset_figures(self) -> None:
        """Reset the figures of drains."""
        self.waiting, self.oldest = 0, np.nan

    def keep(self) -> None:
        """See :class:`MotionTopic`; what is known of the publishers is renewed."""
        self._scan_graph()
        super().keep()

    def _drained(self, taken: list[tuple[Any, dict[str, int]]], arrivals: FloatArray) -> tuple[_Drained, int]:
        self.waiting = max(self.waiting, len(taken))
        if not self.oldest <= self._arrivals.first:
            self.oldest = self._arrivals.first
        numbers = [number for _, info in taken if (number := info.get("publication_sequence_number")) is not None]
        numbered = len(numbers) == len(taken)
        if numbered:
            self._sequence.add_numbers(numbers)
        block = Block.of_messages(((0, 0, data) for data, _ in taken), {})
        return _Drained(messages=block, arrivals=arrivals, numbers=numbers if numbered else None), len(block.buffer)

    def _rows(self, drained: _Drained) -> dict[str, FloatArray]:
        block = drained.messages
        found = self._decoder.decode(block, np.arange(len(block)))
        for reason, count in self._decoder.refused.items():
            self._refuse_many(reason, count)
        self._decoder.refused.clear()
        if drained.numbers is not None and self.publishers > 1:
            self._count_steps_back(found, np.array(drained.numbers))
        return rows_by_joint(found, [self._times(rows, drained.arrivals) for rows in found])

    def _times(self, rows: JointRows, arrivals: FloatArray) -> FloatArray:
        """Stamps, or arrival times where there are none."""
        return with_times(rows.time, arrivals[rows.index], self._arrivals.what, self._refuse_many)

    def _scan_graph(self) -> None:
        now = monotonic()
        if now - self._scanned_at < _COUNT_EVERY:
            return
        self._scanned_at = now
        self.publishers = self.subscription.publishers
        self.contested = frozenset(name for name, steps in self._steps_back.items() if steps >= _CONTESTED)
        self.contest = self._who_contests() if self.contested else ""
        if self.publishers < 2:
            self._last_number.clear()
        self._steps_back.clear()

    def _who_contests(self) -> str:
        # Messages do not name their publisher; of more than two publishers any two may be the cause.
        names = listed(sorted(map(name_of, self.subscription.endpoints)), NAMED)
        return f"published by several nodes at once ({names}); remap all but one of them"

    def _count_steps_back(self, found: list[JointRows], numbers: Integers) -> None:
        """Count steps back in the sequence numbers of each joint's messages: one publisher's numbers only grow."""
        indices: dict[str, list[Integers]] = {}
        for rows in found:
            for name in rows.names:
                indices.setdefault(name, []).append(rows.index)
        for name, parts in indices.items():
            mine = numbers[np.sort(np.concatenate(parts))]
            steps = int((np.diff(mine, prepend=self._last_number.get(name, mine[0] - 1)) <= 0).sum())
            self._last_number[name] = int(mine[-1])
            if steps:
                self._steps_back[name] = self._steps_back.get(name, 0) + steps


def joined(parts: list[dict[str, FloatArray]]) -> dict[str, FloatArray]:
    """Rows of each joint, joined from several drains in their order."""
    if len(parts) == 1:
        return parts[0]
    return {
        name: np.concatenate([part[name] for part in parts if name in part])
        for name in dict.fromkeys(name for part in parts for name in part)
    }


def reference_type_name(name: str) -> str:
    """Name of a reference type in the graph."""
    return next(full for full, word in REFERENCE_TYPES.items() if word == name)


def reference_message_type(name: str) -> type:
    """Message class of a reference type.

    Raises
    ------
    StickSlipError
        If there is no such type, or control_msgs is needed and not installed.
    """
    if name == "JointState":
        return JointState  # type: ignore[no-any-return]
    if name not in _CONTROL_TYPES:
        raise InvalidParameterError("reference_type", f"one of JointState, {', '.join(_CONTROL_TYPES)}", name)
    try:
        return getattr(import_module("control_msgs.msg"), name)  # type: ignore[no-any-return]
    except ImportError as error:
        raise StickSlipError(f"reference_type {name} needs the package control_msgs: {error}") from error


class ControllerStateTopic(MotionTopic[dict[str, FloatArray]]):
    """A topic of JointTrajectoryControllerState or MultiDOFStateStamped, which is decoded message by message."""

    def _drained(
        self, taken: list[tuple[Any, dict[str, int]]], arrivals: FloatArray
    ) -> tuple[dict[str, FloatArray], int]:
        rows: dict[str, list[tuple[float, float, float]]] = {}
        for (message, _), arrival in zip(taken, arrivals.tolist(), strict=True):
            try:
                found = reference_rows(message)
            except MessageError as error:
                self._refuse(f"{self._topic}: {error}")
                continue
            time = with_time(seconds(message.header.stamp), arrival, self._arrivals.what, self._refuse_many)
            for name, (position, velocity) in found.items():
                rows.setdefault(name, []).append((time, position, velocity))
        tables = {name: np.array(found) for name, found in rows.items()}
        return tables, sum(table.nbytes for table in tables.values())

    def _rows(self, drained: dict[str, FloatArray]) -> dict[str, FloatArray]:
        return drained


class Arrivals:
    """Messages of joint states and references.

    Parameters
    ----------
    gains : topic of gains, whose messages end an idle time too.
    refuse : called with the reason why a message is refused.
    heard : called when the first message comes in an idle time, see :meth:`set_idle`.
    """

    def __init__(
        self,
        node: Node,
        reference_type: str,
        gains: DrainedSubscription,
        refuse: Refusals,
        heard: Callable[[], None],
    ) -> None:
        qos = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        kind = reference_message_type(reference_type)
        self._references: JointStateTopic | ControllerStateTopic = (
            JointStateTopic(node, REFERENCES, qos, refuse)
            if kind is JointState
            else ControllerStateTopic(node, kind, REFERENCES, qos, refuse)
        )
        self.states = JointStateTopic(node, STATES, qos, refuse)
        self._first = FirstMessage(node, (self.states.subscription, self._references.subscription, gains), heard)

    @property
    def messages(self) -> int:
        """Number of messages that came."""
        return self.states.messages + self._references.messages

    def set_idle(self, *, idle: bool) -> None:
        """Set whether the next message is to be reported at once."""
        self._first.armed = idle

    def keep(self) -> None:
        """Drain the topics, for later."""
        self.states.keep()
        self._references.keep()

    def behind(self, now: float) -> bool:
        """Whether messages still wait that came a while before a steady time [s]."""
        return now - self._oldest > _PENDING_PER_TICK

    def due_until(self, now: float) -> float:
        """Arrival of the last message that one tick processes, a steady time [s]."""
        return self._oldest + _PENDING_PER_TICK if self.behind(now) else math.inf

    def motion_until(self, until: float) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        """Samples and references of each joint that arrived until a steady time [s]."""
        # References last, so that they are no older than the samples that wait for them.
        samples = self.states.samples_until(until)
        return samples, self._references.samples_until(until)

    def close(self) -> None:
        """Close the subscriptions."""
        self._first.close()
        self.states.close()
        self._references.close()

    @property
    def _oldest(self) -> float:
        """Arrival of the oldest waiting message, a steady time [s]; infinite if none waits."""
        return min(self.states.waits_since, self._references.waits_since)
