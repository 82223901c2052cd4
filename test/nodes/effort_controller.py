# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A PD controller of one joint by efforts, as somebody's own node is: states in, efforts out, its reference told."""

from __future__ import annotations

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from stickslip_ros.nodes.running import run

SPEED = 0.005  # [rad/s]


class EffortController(Node):
    """Gains are the parameters gains.joint1.p and .d; it moves from where the joint is at first."""

    def __init__(self) -> None:
        super().__init__("effort_controller")
        self.declare_parameter("gains.joint1.p", 630.0)
        self.declare_parameter("gains.joint1.d", 0.0)
        self._begin: tuple[float, float] | None = None
        self._efforts = self.create_publisher(JointState, "joint_commands", 1)
        self._references = self.create_publisher(JointState, "joint_references", 1000)
        self.create_subscription(JointState, "joint_states", self._close_the_loop, 10)

    def _close_the_loop(self, message: JointState) -> None:
        now = rclpy.time.Time.from_msg(message.header.stamp).nanoseconds * 1e-9
        if self._begin is None:
            self._begin = (now, message.position[0])
        desired = self._begin[1] + SPEED * (now - self._begin[0])
        stiffness, damping = (self.get_parameter(f"gains.joint1.{key}").value for key in ("p", "d"))
        effort = stiffness * (desired - message.position[0]) + damping * (SPEED - message.velocity[0])
        self._efforts.publish(JointState(name=["joint1"], effort=[effort]))
        reference = JointState(name=["joint1"], position=[desired], velocity=[SPEED])
        reference.header.stamp = message.header.stamp
        self._references.publish(reference)


if __name__ == "__main__":
    raise SystemExit(run(EffortController, None))
