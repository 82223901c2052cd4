# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The node `replay`: publishes a recorded table as joint states and references, with the recording's own stamps."""

from __future__ import annotations

import math
import time

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.running import run
from stickslip_ros.recordings import find_recording, load_recording

_TIMER_PERIOD = 0.005
_MOST_AT_ONCE = 200
_STAMP_OFFSET = 1.0  # a recording may begin at 0, which as a stamp means "not set"


class Replay(Node):
    """Waits for a listener, publishes every sample once, and ends some time after the last."""

    def __init__(self) -> None:
        super().__init__("replay")

        def parameter(name: str, default: object, text: str) -> object:
            descriptor = ParameterDescriptor(description=text, read_only=True)
            return self.declare_parameter(name, default, descriptor).value

        path = find_recording(str(parameter("recording", "", "path of a .csv or .npz, or the name of a known one")))
        self._joint = str(parameter("joint", "joint1", "name of the joint"))
        self._factor = float(parameter("time_factor", 1.0, "recorded seconds a second [1]"))  # type: ignore[arg-type]
        self._linger = float(parameter("linger", 1.0, "how long to stay after the last sample [s]"))  # type: ignore[arg-type]
        self._batch = load_recording(path).batch
        self._next = 0
        self._start = math.nan
        self._end = math.nan
        self._with_reference = bool(
            np.isfinite(self._batch.reference_position).any() or np.isfinite(self._batch.reference_velocity).any()
        )
        qos = QoSProfile(depth=5000)
        self._states = self.create_publisher(JointState, "joint_states", qos)
        self._references = self.create_publisher(JointState, "joint_references", qos)
        self.create_timer(_TIMER_PERIOD, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _tick(self) -> None:
        now = time.monotonic()
        if math.isnan(self._start):
            listeners = self._states.get_subscription_count() and self._references.get_subscription_count()
            if not listeners:
                return
            self._start = now
        batch = self._batch
        due = int(np.searchsorted(batch.time - batch.time[0], self._factor * (now - self._start), side="right"))
        for index in range(self._next, min(due, self._next + _MOST_AT_ONCE)):
            self._publish(index)
        self._next = max(self._next, min(due, self._next + _MOST_AT_ONCE))
        if self._next == len(batch):
            self._end = now if math.isnan(self._end) else self._end
            if now - self._end >= self._linger:
                raise KeyboardInterrupt

    def _publish(self, index: int) -> None:
        batch = self._batch
        message = JointState(name=[self._joint])
        message.header.stamp = stamp(_STAMP_OFFSET + float(batch.time[index]))
        if self._with_reference:
            message.position = [float(batch.reference_position[index])]
            message.velocity = [float(batch.reference_velocity[index])]
            self._references.publish(message)
        message.position = [float(batch.position[index])]
        message.velocity = [float(batch.velocity[index])]
        message.effort = [float(batch.effort[index])]
        self._states.publish(message)


def main(args: list[str] | None = None) -> int:
    """Run the node until the recording has been published."""
    return run(Replay, args)


if __name__ == "__main__":
    raise SystemExit(main())
