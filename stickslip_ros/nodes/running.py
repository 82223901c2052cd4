# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Start and end of a node's process."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Callable

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from stickslip_ros.errors import StickSlipError
from stickslip_ros.visible import visible

RCLError = rclpy_implementation.RCLError
_PLACES = re.compile(r",? at \S+\.[ch](pp)?:\d+")  # in the middleware's own source
_ABOUT = "failed to initialize rcl: "
_LAYOUT = "ros__parameters"


def run(create: Callable[[], Node], args: list[str] | None, *, persevere: bool = False) -> int:
    """Spin a node until SIGINT or SIGTERM; returns the exit status.

    Parameters
    ----------
    persevere : whether to go on after an exception, once it is logged: what another node sent must not end this one.
    """
    try:
        _initialize(args)
        try:
            node = create()
        except RCLError as error:
            # No node can be had of the middleware: with DDS security asked for and not there, for one.
            raise StickSlipError(str(error).partition("\n")[0]) from error
        try:
            while node.context.ok():
                try:
                    rclpy.spin(node)
                except (KeyboardInterrupt, ExternalShutdownException):
                    raise
                except Exception:
                    if not persevere:
                        raise
                    # A signal in the middle of a callback makes its next publication fail: that is no error.
                    if node.context.ok():
                        node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
        finally:
            node.destroy_node()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (StickSlipError, ParameterException) as error:
        print(visible(f"error: {error}"), file=sys.stderr)
        return 2
    except Exception:
        # A signal while the node is being made, or ended, makes its next publication fail: that is no error either.
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()
    return 0


def _initialize(args: list[str] | None) -> None:
    """Begin to use ROS.

    Raises
    ------
    StickSlipError
        If the arguments, or a file that they name, cannot be used; the text names them.
    """
    try:
        rclpy.init(args=args)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise StickSlipError(f"unknown arguments of ROS: {error}") from error
    except RCLError as error:
        text = _PLACES.sub("", " ".join(str(error).split())).removeprefix(_ABOUT)
        if f"before {_LAYOUT}" in text:
            text += f" (ROS 2 has {_LAYOUT} between the name of a node and its parameters, ROS 1 had not)"
        raise StickSlipError(text) from error
