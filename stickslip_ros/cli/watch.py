# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip watch`: watch every joint that a running monitor watches, live in the terminal or, with --browser, in a
page: status, speed, damping reserve, slips, advice.

It listens to all monitors with the same ROS_DOMAIN_ID, in any namespace, and needs nothing else. The worst joints come
first. Ctrl-C ends it.

Examples:
    stickslip watch
    stickslip watch --browser --port 5007
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import time
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.live import Live
from rich.status import Status

from stickslip_ros.cli.options import add_flag, add_number, add_option, refuse_given
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.cli.watch_view import view
from stickslip_ros.errors import InvalidParameterError, StickSlipError, optional_packages
from stickslip_ros.interrupts import Interrupted

if TYPE_CHECKING:
    from stickslip_ros.cli.monitor_client import WatchListener

_LISTENING = "Listening for a monitor"
_REFRESH = 0.25  # [s]
_LARGEST_PORT = 65535
_LONGEST = 60.0  # [s] of motion
# Options that have no effect on the other view, and their defaults.
_OF_PAGE = {"port": 5006, "address": "127.0.0.1"}
_OF_TERMINAL = {"once": False, "seconds": 10.0, "patience": 30.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_flag(parser, "--browser", "serve a live page instead, with sliders to try other gains")
    add_option(parser, "--port", "N", "port of the page", _OF_PAGE["port"], type=int)
    served = f"address that the page is served at (default: {_OF_PAGE['address']}, for this machine only)"
    parser.add_argument("--address", metavar="IP", default=_OF_PAGE["address"], help=served)
    add_flag(parser, "--once", "print one view and end; also done when the output is a pipe")
    add_number(parser, "--seconds", "S", "seconds of motion to show", _OF_TERMINAL["seconds"])
    add_number(parser, "--patience", "S", "how long to wait for a monitor before giving up", _OF_TERMINAL["patience"])


def run(options: argparse.Namespace) -> int:
    """Show the view until it is interrupted, or once."""
    if not 0 < options.seconds <= _LONGEST:
        raise InvalidParameterError("--seconds", f"> 0 and <= {_LONGEST:g}", options.seconds)
    if not (math.isfinite(options.patience) and options.patience > 0):
        raise InvalidParameterError("--patience", "finite and > 0", options.patience)
    if not 0 < options.port <= _LARGEST_PORT:
        raise InvalidParameterError("--port", f"from 1 to {_LARGEST_PORT}", options.port)
    if options.browser:
        refuse_given(options, _OF_TERMINAL, "given without --browser")
    else:
        refuse_given(options, _OF_PAGE, "given together with --browser")
    try:
        from stickslip_ros.cli.monitor_client import WatchListener
    except ImportError as error:
        raise StickSlipError(f"watch needs ROS 2 (rclpy): {error}") from error
    try:
        if options.browser:
            with optional_packages("--browser"):
                from stickslip_ros.cli.live_page import serve
            serve(options.address, options.port)
        else:
            _show(WatchListener(), options)
    except Interrupted as interrupted:
        if interrupted.number != signal.SIGINT:
            raise
    return 0


def _show(listener: WatchListener, options: argparse.Namespace) -> None:
    """Show the view in the terminal."""
    console = Terminal(highlight=False)

    def shown(height: int | None) -> RenderableType:
        return view(listener.joints(), listener.header(), console, duration=options.seconds, height=height)

    try:
        with console.status(_LISTENING) as status:
            _wait(listener, options.patience, status)
        if options.once or not console.is_terminal:
            listener.listen(options.seconds)
            console.print(shown(None))
            return
        with Live(shown(console.height), console=console, screen=True, auto_refresh=False) as live:
            while True:
                listener.listen(_REFRESH)
                live.update(shown(console.height), refresh=True)
    finally:
        listener.close()


def _wait(listener: Any, patience: float, status: Status) -> None:
    until = time.monotonic() + patience
    while listener.compiling or not listener.joints():
        listener.listen(0.1)
        status.update(f"The monitor says: {listener.compiling}" if listener.compiling else _LISTENING)
        if listener.compiling:
            until = time.monotonic() + patience
        if time.monotonic() > until:
            heard, there = listener.header(), ", ".join(listener.silent)
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            if heard:
                raise StickSlipError(
                    f"A monitor runs, but no joint states have reached it for {patience:g} s ({heard})."
                )
            if there:
                raise StickSlipError(
                    f"{there} runs, but has published nothing for {patience:g} s. Is it active (ros2 lifecycle get)?"
                )
            raise StickSlipError(
                f"No monitor found within {patience:g} s in ROS domain {domain}. Is one running, with the same "
                "ROS_DOMAIN_ID?"
            )
