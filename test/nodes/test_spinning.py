# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Ctrl-C in the middle of what ROS does."""

from __future__ import annotations

import os
import signal

import pytest
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from stickslip_ros.nodes.spinning import turn


def test_ctrl_c_waits_for_what_is_under_way(ros_domain: int) -> None:
    """`watch` ended with a traceback of rclpy's where Ctrl-C came while a message was converted."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    done: list[str] = []
    try:
        node = Node("interrupted")

        def interrupt() -> None:
            os.kill(os.getpid(), signal.SIGINT)
            done.append("what came after it")

        node.create_timer(0.01, interrupt)
        before = signal.getsignal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            turn(node, 5.0)
        assert done == ["what came after it"]
        assert signal.getsignal(signal.SIGINT) is before
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
