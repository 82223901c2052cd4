# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A signal in the middle of what ROS does."""

from __future__ import annotations

import subprocess
import sys

import pytest
from conftest import LIMIT
from rclpy.waitable import Waitable

from stickslip_ros.nodes.intake.arrivals import FirstMessage

_IN_A_CALLBACK = """
import os, signal
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from stickslip_ros.interrupts import Interrupted, take_signals
from stickslip_ros.nodes.running import turn

take_signals()
rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
node = Node("interrupted")

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    print("what came after it")

node.create_timer(0.01, interrupt)
try:
    turn(node, 5.0)
except Interrupted as interrupted:
    print(f"signal {interrupted.number}")
turn(node, 5.0)
print("and its end")
"""
_WHILE_NOTHING_COMES = """
import os, signal, threading
from rclpy.node import Node
from stickslip_ros.nodes.running import run

class Still(Node):
    def __init__(self):
        super().__init__("still")
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGTERM)).start()

print(f"status {run(lambda: Still(), [])}")
"""


def printed(code: str) -> str:
    """What a process prints that has nothing to complain of."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.stderr == ""
    return done.stdout


@pytest.mark.slow
def test_ctrl_c_waits_for_what_is_under_way(ros_domain: int) -> None:
    """`watch` ended with a traceback of rclpy's where Ctrl-C came while a message was converted."""
    expected = ["what came after it", "signal 2", "what came after it", "and its end"]
    assert printed(_IN_A_CALLBACK).splitlines() == expected


@pytest.mark.slow
def test_a_signal_wakes_a_node_to_which_nothing_comes(ros_domain: int) -> None:
    """Issue 35: the executor waits without a limit, and its process notices all the same."""
    assert printed(_WHILE_NOTHING_COMES) == "status 0\n"


def test_what_the_executor_calls_is_implemented_here() -> None:
    """Issue 40: in Kilted each method of the base class raises NotImplementedError; Jazzy's do nothing in two."""
    of_base = {name for name, one in vars(Waitable).items() if callable(one)}
    assert {"__enter__", "__exit__"} <= of_base
    assert of_base - {"__init__", "add_future", "remove_future"} <= set(vars(FirstMessage))
