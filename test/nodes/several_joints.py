# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A stand-in for a joint_trajectory_controller with three joints, and for the robot: it moves as it is told, or not.

Like the real one it takes a message only if that names all its joints, has positions for each and times that rise,
and says of a refusal nothing but a line in its log.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.running import run

JOINTS = ["shoulder", "elbow", "wrist"]
START = [0.2, 0.5, -0.3]
PERIOD = 0.01
SWING, RATE = 0.1, 3.0  # [rad], [1/s] of what else moves the elbow


class SeveralJoints(Node):
    """The parameter `manner` is follow, ignore (silently), swing (the elbow, at all times) or disturb (after 2 s)."""

    def __init__(self) -> None:
        super().__init__("joint_trajectory_controller")
        self.declare_parameter("manner", "follow")
        self.declare_parameter("joints", JOINTS, ParameterDescriptor(dynamic_typing=True))
        self.declare_parameter("allow_partial_joints_goal", False)
        self.declare_parameter("refuse_all", False)
        self._states = self.create_publisher(JointState, "/joint_states", 100)
        self.create_subscription(JointTrajectory, "~/joint_trajectory", self._take, 10)
        self._positions = np.array(START)
        self._times, self._ways = np.zeros(1), self._positions[None]
        self._begin, self._taken = 0.0, 0
        self.create_timer(PERIOD, self._tick)

    def _now(self) -> float:
        return 1e-9 * float(self.get_clock().now().nanoseconds)

    def _take(self, message: JointTrajectory) -> None:
        manner = self.get_parameter("manner").value
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
        if manner == "ignore":
            return
        if self.get_parameter("refuse_all").value:
            self.get_logger().error("Can't accept new trajectories. Controller is not active.")
        elif sorted(message.joint_names) != sorted(JOINTS):
            self.get_logger().error("Joints on incoming trajectory don't match the controller joints.")
        elif not times or any(one >= other for one, other in itertools.pairwise(times)):
            self.get_logger().error("Time between points is not strictly increasing")
        elif any(len(point.positions) != len(JOINTS) for point in message.points):
            self.get_logger().error("Mismatch between joint_names size and positions")
        else:
            order = [message.joint_names.index(name) for name in JOINTS]
            ways = np.array([point.positions for point in message.points])[:, order]
            self._begin, self._times = self._now(), np.array([0.0, *times])
            self._ways = np.vstack([self._positions, ways])
            self._taken += 1

    def _tick(self) -> None:
        now = self._now()
        manner = self.get_parameter("manner").value
        since = now - self._begin
        self._positions = np.array([np.interp(since, self._times, way) for way in self._ways.T])
        shown = self._positions.copy()
        if manner == "swing" or (manner == "disturb" and self._taken == 1 and since > 2.0):
            shown[1] += SWING * math.sin(RATE * now)
        message = JointState(name=JOINTS, position=shown.tolist())
        message.header.stamp = stamp(now)
        self._states.publish(message)


if __name__ == "__main__":
    raise SystemExit(run(SeveralJoints, None))
