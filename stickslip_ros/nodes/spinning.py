# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Letting ROS work a little, in commands that end with Ctrl-C."""

from __future__ import annotations

import signal
import threading

import rclpy
from rclpy.node import Node


def turn(node: Node, timeout: float) -> None:
    """As :func:`rclpy.spin_once`, for at most so long [s]; Ctrl-C waits until it is done.

    In the middle of a message's conversion its exception would be lost, and be an error of rclpy's instead.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came meanwhile.
    """
    came: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        rclpy.spin_once(node, timeout_sec=timeout)
        return
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        rclpy.spin_once(node, timeout_sec=timeout)
    finally:
        signal.signal(signal.SIGINT, before)
    for number in came[:1]:
        before(number, None)
