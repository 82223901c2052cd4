# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Start and end of a node's process, and the loops of commands that use ROS and end with Ctrl-C."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Callable

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from stickslip_ros.errors import StickSlipError
from stickslip_ros.interrupts import Interrupted, came, check, take_signals, woken
from stickslip_ros.visible import visible

RCLError = rclpy_implementation.RCLError
_PLACES = re.compile(r",? at \S+\.[ch](pp)?:\d+")  # in the middleware's own source
_ABOUT = "failed to initialize rcl: "
_LAYOUT = "ros__parameters"
_LONGEST_CALLBACK = 4.0  # duration of a callback on a busy machine, s: ros2 launch kills a node after 5 s


def run(create: Callable[[], Node], args: list[str] | None, *, persevere: bool = False) -> int:
    """Spin a node until SIGINT or SIGTERM; returns the exit status.

    Parameters
    ----------
    persevere : whether to go on after an exception, once it is logged: another node's message must not end this node.
    """
    take_signals(status=0)
    try:
        _initialize(args)
        check()
        try:
            node = create()
        except RCLError as error:
            # The middleware makes no node, for example where DDS security is requested and missing.
            raise StickSlipError(str(error).partition("\n")[0]) from error
        try:
            _spin(node, persevere=persevere)
        finally:
            node.destroy_node()
    except Interrupted:
        pass
    except (StickSlipError, ParameterException) as error:
        print(visible(f"error: {error}"), file=sys.stderr)
        return 2
    finally:
        rclpy.try_shutdown()
    return 0


def _spin(node: Node, *, persevere: bool) -> None:
    """Execute callbacks until the process is asked to end; the present callback is finished."""
    executor = rclpy.get_global_executor()
    executor.add_node(node)
    # The guard condition needs a callback: the executor leaves its wait for nothing else.
    ending = node.create_guard_condition(lambda: None)
    with woken(ending.trigger, patience=_LONGEST_CALLBACK):
        while node.context.ok() and not came():
            try:
                executor.spin_once()
            except Exception:
                if not persevere:
                    raise
                node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
    executor.remove_node(node)


def _initialize(args: list[str] | None) -> None:
    """Begin to use ROS.

    Raises
    ------
    StickSlipError
        If the arguments, or a file in them, cannot be used; the text names them.
    """
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.UnknownROSArgsError as error:
        raise StickSlipError(f"unknown arguments of ROS: {error}") from error
    except RCLError as error:
        text = _PLACES.sub("", " ".join(str(error).split())).removeprefix(_ABOUT)
        if f"before {_LAYOUT}" in text:
            text += f" (ROS 2 has {_LAYOUT} between the name of a node and its parameters, ROS 1 had not)"
        raise StickSlipError(text) from error


def turn(node: Node, timeout: float) -> None:
    """Execute one callback, as :func:`rclpy.spin_once`, waiting ``timeout`` seconds at most.

    Raises
    ------
    Interrupted
        If the process was asked to end meanwhile; see :func:`stickslip_ros.interrupts.check`.
    """
    rclpy.spin_once(node, timeout_sec=timeout)
    check()
