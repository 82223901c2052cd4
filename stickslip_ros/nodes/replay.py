# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The node `replay`: publishes a recorded table or bag as joint states, references and gains, with its own stamps."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.storage.formats import is_read_as_bag
from stickslip_ros.bags.table import RecordingError, find_recording, load_recording
from stickslip_ros.bags.topics import TopicChoice, find_topics
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.running import run

_TIMER_PERIOD = 0.005  # period of publishing, s: five samples of a recording at 1 kHz
_MOST_AT_ONCE = 200  # number of messages in one period, 1: queues of listeners hold them
_LONGEST_STEP = 0.02  # time that is caught up after a pause of the process, s: more would flood the listeners
_SETTLED = 1.0  # time after a listener was found, s: the listener need not have found this node yet
_STAMP_OFFSET = 1.0  # offset of the stamps, s: a recording may begin at 0, which as a stamp means "not set"

# Time in the recording [s], topic, message or its bytes.
Recorded = tuple[float, str, Any]


class Replay(Node):
    """Node that waits for a listener, publishes every message once, and ends some time after the last."""

    def __init__(self) -> None:
        super().__init__("replay")

        def parameter(name: str, default: object, text: str) -> object:
            descriptor = ParameterDescriptor(description=text, read_only=True)
            return self.declare_parameter(name, default, descriptor).value

        name = str(
            parameter("recording", "", "a bag, a table (.csv, .parquet, .npz), or the name of a known recording")
        )
        joint = str(parameter("joint", "joint1", "name of the joint in a table"))
        states = str(parameter("states", "", "topic of a bag's joint states, where there are several"))
        self._factor = float(parameter("time_factor", 1.0, "recorded seconds a second [1]"))  # type: ignore[arg-type]
        self._linger = float(parameter("linger", 1.0, "how long to stay after the last sample [s]"))  # type: ignore[arg-type]
        require_positive("time_factor", self._factor)
        require_not_negative("linger", self._linger)
        if not joint:
            raise InvalidParameterError("joint", "the name of a joint", "''")
        self._messages = _of_bag(Path(name), states) if is_read_as_bag(Path(name)) else _of_table(name, joint)
        self._next = next(self._messages, None)
        self._first = self._next[0] if self._next else 0.0
        self._start = math.nan
        self._end = math.nan
        self._ticked = math.nan
        qos = QoSProfile(depth=5000)
        self._outputs = {
            "joint_states": self.create_publisher(JointState, "joint_states", qos),
            "joint_references": self.create_publisher(JointState, "joint_references", qos),
            "pd_gains": self.create_publisher(Float64MultiArray, "pd_gains", qos),
        }
        self.create_timer(_TIMER_PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        now = time.monotonic()
        if math.isnan(self._start):
            if all(publisher.get_subscription_count() for publisher in self._outputs.values()):
                self._start = self._ticked = now + _SETTLED
            return
        # After a pause of the process the recording goes on where it was.
        self._start += max(0.0, now - self._ticked - _LONGEST_STEP)
        self._ticked = now
        due = self._first + self._factor * (now - self._start)
        for _ in range(_MOST_AT_ONCE):
            if self._next is None or self._next[0] > due:
                break
            _, topic, message = self._next
            self._outputs[topic].publish(message)
            self._next = next(self._messages, None)
        if self._next is None:
            self._end = now if math.isnan(self._end) else self._end
            if now - self._end >= self._linger:
                # The node ends as if another process ended it.
                signal.raise_signal(signal.SIGTERM)


def _of_table(name: str, joint: str) -> Iterator[Recorded]:
    """Messages of a table, each reference before its sample."""
    batch = load_recording(find_recording(name)).batch
    with_reference = np.isfinite(batch.reference_position).any() or np.isfinite(batch.reference_velocity).any()
    for index, when in enumerate(batch.time.tolist()):
        message = JointState(name=[joint])
        message.header.stamp = stamp(_STAMP_OFFSET + when)
        if with_reference:
            message.position = [float(batch.reference_position[index])]
            message.velocity = [float(batch.reference_velocity[index])]
            yield when, "joint_references", message
        message.position = [float(batch.position[index])]
        message.velocity = [float(batch.velocity[index])]
        message.effort = [float(batch.effort[index])]
        yield when, "joint_states", message


def _of_bag(path: Path, states: str) -> Iterator[Recorded]:
    """Serialized joint states, references (if these are JointStates) and gains of a bag."""
    with Bag(path) as bag:
        try:
            topics = find_topics(bag.channels(), TopicChoice(states=states or None))
        except RecordingError as error:
            # The option of the commands is a parameter of the node.
            raise RecordingError(str(error).replace("--states", "the parameter states")) from error
        names = {topics.states: "joint_states"}
        names |= {channel: "joint_references" for channel in topics.references if channel.type == JOINT_STATE}
        names |= dict.fromkeys(topics.gains, "pd_gains")
        for block in bag.blocks(set(names)):
            wanted = {number: names[channel] for number, channel in block.channels.items() if channel in names}
            for index, number in enumerate(block.channel.tolist()):
                if number in wanted:
                    yield 1e-9 * float(block.log_time[index]), wanted[number], block.message(index)


def main(args: list[str] | None = None) -> int:
    """Run the node until the recording has been published."""
    return run(Replay, args)
