# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The files that a sample enters between the subscription and /diagnostics are those that design.md names."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import LIMIT

_DESIGN = Path(__file__).parents[2] / "docs" / "design.md"
_MOST = 50  # files, 1: fewer are welcome
_MONITOR = """
import sys, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.monitor import Monitor

STEPS = {"session.py": {"_process_motion"}, "reports.py": {"_assess", "_publish_statuses"}}  # no polls
joint = ["joints:=[joint1]", "state_file:=none", "model.joint1:=puma560_joint1", "gains.joint1.p:=630.0"]
rclpy.init(args=["--ros-args", *(word for one in joint for word in ("-p", one))])
monitor = Monitor()
monitor.start()
node = Node("source")
publisher = node.create_publisher(JointState, "joint_states", 1000)
executor = SingleThreadedExecutor()
executor.add_node(monitor)
entered, depth, package = set(), 0, "/stickslip_ros/"

def note(frame, event, _):
    global depth
    code = frame.f_code
    if package in code.co_filename and event in ("call", "return"):
        step = code.co_name in STEPS.get(code.co_filename.rpartition("/nodes/")[2], ())
        depth += step and event == "call"
        if depth:
            entered.add(code.co_filename.rpartition(package)[2])
        depth -= step and event == "return"

begun, count = time.time(), 0
while time.time() < begun + 8.0:
    if time.time() > begun + 7.0:
        sys.setprofile(note)
    # At even times, however busy the machine is: a gap would be another motion.
    while (now := begun + 0.01 * count) <= time.time():
        message = JointState(name=["joint1"], position=[0.02 * now], velocity=[0.02])
        message.header.stamp = stamp(now)
        publisher.publish(message)
        count += 1
    executor.spin_once(timeout_sec=0.01)
sys.setprofile(None)
print(*sorted(entered))
monitor.destroy_node()
"""


@pytest.mark.slow
def test_the_way_of_a_sample_is_the_one_that_is_drawn(ros_domain: int) -> None:
    """Issue 40, item 1: no file joins the way unnoticed."""
    table = _DESIGN.read_text(encoding="utf-8").partition("| step | files |")[2].partition("\n\n")[0]
    drawn = set(re.findall(r"`([\w/]+\.py)`", table))
    assert len(drawn) <= _MOST
    done = subprocess.run([sys.executable, "-c", _MONITOR], capture_output=True, text=True, timeout=LIMIT, check=True)
    entered = set(done.stdout.split("\n")[-2].split())
    assert len(entered) > 30, done.stdout
    assert entered <= drawn
