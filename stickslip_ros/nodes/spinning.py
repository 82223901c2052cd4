# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Letting ROS work a little, in commands that end with Ctrl-C."""

from __future__ import annotations

import rclpy
from rclpy.node import Node

from stickslip_ros.interrupts import interrupts


def turn(node: Node, timeout: float) -> None:
    """As :func:`rclpy.spin_once`, for at most so long [s]; Ctrl-C waits until it is done.

    In the middle of a message's conversion its exception would be lost, and be an error of rclpy's instead.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came meanwhile.
    """
    with interrupts(held=True):
        rclpy.spin_once(node, timeout_sec=timeout)
