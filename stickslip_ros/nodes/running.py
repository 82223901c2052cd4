# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Start and end of a node's process, its compiled functions, and loops of commands that use ROS and end with Ctrl-C."""

from __future__ import annotations

import gc
import re
import sys
import traceback
from collections.abc import Callable
from time import monotonic

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from stickslip_ros.compilation import NOT_KEPT, cache_folder, without_linear_algebra
from stickslip_ros.errors import StickSlipError
from stickslip_ros.interrupts import Interrupted, came, check, take_signals, woken
from stickslip_ros.visible import visible
from stickslip_ros.warm_up import Compilation, compile_ahead, is_warm, load_for_node

RCLError = rclpy_implementation.RCLError
_PLACES = re.compile(r",? at \S+\.[ch](pp)?:\d+")  # in the middleware's own source
_ABOUT = "failed to initialize rcl: "
_LAYOUT = "ros__parameters"
_REPORT_EVERY = 10.0  # time between two lines in the log, s: compiling takes half a minute
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


class CompiledParts:
    """Compiled functions of the node; :meth:`poll` is called now and then.

    Attributes
    ----------
    ready : whether all functions can be called. state : what is being done, in words, "" if nothing is being compiled.
    """

    def __init__(self, log: RcutilsLogger) -> None:
        self._log = log
        self._compilation: Compilation | None = None
        self._began = monotonic()
        self.ready, self.state = False, ""
        if is_warm():
            self._load()
            return
        folder = cache_folder()
        if not folder.permanent:
            log.warning(f"{NOT_KEPT}; until then it is compiled at every start")
        self._compilation = Compilation()
        self._report()

    def poll(self, now: float) -> None:
        """Report what is being done, and load the functions once they are compiled; ``now`` is a steady time [s]."""
        if self._compilation is None or self.ready:
            return
        if self._compilation.running:
            self._report()
            return
        failure = self._compilation.failure
        self.close()
        if failure:
            self._log.error(f"compiling ahead failed, and is done in this process instead: {failure}")
        else:
            self._log.info(f"compiled in {now - self._began:.0f} s")
        self._load()

    def _report(self) -> None:
        self.state = str(self._compilation)
        self._log.info(self.state, throttle_duration_sec=_REPORT_EVERY)

    def _load(self) -> None:
        without_linear_algebra()
        load_for_node()
        # The loaded objects stay. Searching these for garbage again and again would hold up intake for 0.1 s.
        gc.collect()
        gc.freeze()
        self.ready, self.state = True, ""

    def close(self) -> None:
        """End the other process."""
        if self._compilation is not None:
            self._compilation.close()
            self._compilation = None


def wait_until_compiled(node: Node) -> None:
    """Wait until everything is compiled, with a line in the log now and then.

    Raises
    ------
    Interrupted
        If the process is asked to end meanwhile.
    """
    log = node.get_logger()
    failure = compile_ahead(lambda text: log.info(text, throttle_duration_sec=_REPORT_EVERY))
    if failure:
        log.error(f"compiling ahead failed, and is done in this process instead: {failure}")
    without_linear_algebra()
