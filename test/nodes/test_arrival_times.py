# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34, item 14: times of arrival where a simulation has no clock yet, pauses, goes on and begins anew."""

from __future__ import annotations

import time

import rclpy
from conftest import LIMIT
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.intake.arrivals import ArrivalTimes

TWO = [{"received_timestamp": 5_000_000_000}, {"received_timestamp": 6_000_000_000}]


def test_times_under_a_simulated_clock(ros_domain: int) -> None:
    """They are the system's until the first message on /clock, and never go backwards unless the clock does."""
    rclpy.init(args=[])
    node = Node("simulated", parameter_overrides=[Parameter("use_sim_time", value=True)])
    try:
        clock = node.create_publisher(Clock, "/clock", 1)
        arrivals = ArrivalTimes(node)
        assert arrivals.of([]).tolist() == []
        assert arrivals.of(TWO).tolist() == [5.0, 6.0]
        assert "by the system's clock (use_sim_time is true, and nothing is heard on /clock)" in arrivals.what

        def at(now: float) -> list[float]:
            until = time.monotonic() + LIMIT
            while node.get_clock().now().nanoseconds != round(1e9 * now):
                assert time.monotonic() < until
                clock.publish(Clock(clock=stamp(now)))
                rclpy.spin_once(node, timeout_sec=0.1)
            return [round(one, 6) for one in arrivals.of(TWO).tolist()]

        assert at(10.0) == [9.99, 10.0]
        assert arrivals.what == "arrival"
        assert at(10.0) == [10.0, 10.0]
        assert at(11.0) == [10.5, 11.0]
        assert at(3.0) == [2.99, 3.0]
    finally:
        node.destroy_node()
        rclpy.shutdown()
