# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Start and end of a node's process."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from stickslip_ros.errors import StickSlipError


def run(create: Callable[[], Node], args: list[str] | None) -> int:
    """Spin a node until SIGINT or SIGTERM; returns the exit status."""
    rclpy.init(args=args)
    try:
        node = create()
        try:
            rclpy.spin(node)
        finally:
            node.destroy_node()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (StickSlipError, ParameterException) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
    return 0
