# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Letting ROS work a little, in commands that end with Ctrl-C."""

from __future__ import annotations

import rclpy
from rclpy.node import Node

from stickslip_ros.interrupts import check


def turn(node: Node, timeout: float) -> None:
    """As :func:`rclpy.spin_once`, for at most so long [s].

    Raises
    ------
    Interrupted
        If the process was asked to end meanwhile; see :func:`stickslip_ros.interrupts.check`.
    """
    rclpy.spin_once(node, timeout_sec=timeout)
    check()
