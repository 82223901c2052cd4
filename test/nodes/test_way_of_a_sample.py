# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The files that a sample enters between the subscription and /diagnostics: few, and those that design.md names."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from statistics import median_low

import pytest
from conftest import LIMIT

_DESIGN = Path(__file__).parents[2] / "docs" / "design.md"
_MOST, _MOST_AT_A_SLIP = 15, 18  # files, 1: fewer are welcome
# A monitor in a process of its own, and a joint that sticks and slips. Each line is one sample: the functions entered
# until the second status after it, in their order, and how many cycles were published.
_MONITOR = """
import json, sys, time
import numpy as np, rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.monitor import Monitor
from stickslip_ros.settings.known_joints import load_joint

STEPS = {"_process_motion", "_assess", "publish_statuses"}  # no polls, no status of the node itself
RATE, BEFORE, LAST = 100.0, 1500, 300  # Hz; samples before those that are followed, and of these
SPEED = float(sys.argv[1])  # rad/s
times = np.arange(BEFORE + LAST) / RATE
speeds = np.full(times.shape, SPEED)
joint, gains = load_joint("puma560_joint1").joint, Gains(stiffness=630.0)
found = simulate(joint, gains, SPEED * times, speeds, period=1.0 / RATE)
positions = 2.5e-5 * np.round(found.position / 2.5e-5)
set_ = ["joints:=[joint1]", "state_file:=none", "model.joint1:=puma560_joint1", "gains.joint1.p:=630.0",
        "publish_rate:=50.0"]
rclpy.init(args=["--ros-args", *(word for one in set_ for word in ("-p", one))])
monitor, node = Monitor(), Node("source")
monitor.start()
states, references = (node.create_publisher(JointState, f"joint_{one}", 1000) for one in ("states", "references"))
statuses, cycles = [], []
node.create_subscription(DiagnosticArray, "/diagnostics", lambda one: statuses.append(one), 1000)
node.create_subscription(DiagnosticArray, "/stickslip_monitor/cycles", lambda one: cycles.append(one), 1000)
executor = SingleThreadedExecutor()
for one in (monitor, node):
    executor.add_node(one)
entered, depth, package = {}, 0, "/stickslip_ros/"

def note(frame, event, _):
    global depth
    code = frame.f_code
    if package in code.co_filename and event in ("call", "return"):
        file = code.co_filename.rpartition(package)[2]
        step = code.co_name in STEPS and file in ("nodes/session.py", "nodes/publications.py")
        depth += step and event == "call"
        if depth:
            entered.setdefault(f"{file}:{code.co_name}")
        depth -= step and event == "return"

def send(index):
    for topic, position, velocity in ((references, SPEED * times[index], [SPEED]), (states, positions[index], [])):
        message = JointState(name=["joint1"], position=[float(position)], velocity=velocity)
        message.header.stamp = stamp(begun + times[index])
        topic.publish(message)

def spin(count):
    end = len(statuses) + count
    while len(statuses) < end:
        executor.spin_once(timeout_sec=0.1)

while not (statuses and states.get_subscription_count() and references.get_subscription_count()) or (
    ("compiling", "") not in [(one.key, one.value) for one in statuses[-1].status[0].values]
):
    spin(1)
begun = time.time()
for index in range(BEFORE):
    send(index)
    if index % 10 == 0:
        spin(1)
while not any(one.key == "exact smooth" for one in statuses[-1].status[-1].values):
    spin(1)
spin(100)  # studies end
for index in range(BEFORE, BEFORE + LAST):
    entered, before = {}, len(cycles)
    sys.setprofile(note)
    send(index)
    spin(2)
    sys.setprofile(None)
    print(json.dumps([list(entered), len(cycles) - before]))
monitor.destroy_node()
"""


def _files(functions: list[str]) -> dict[str, list[str]]:
    """Files entered, in their order, and the functions of each."""
    files: dict[str, list[str]] = {}
    for function in functions:
        file, _, name = function.partition(":")
        files.setdefault(file, []).append(name)
    return files


def _drawing(files: dict[str, list[str]]) -> str:
    return "\n".join([f"{len(files)} files", *(f"  {file}: {', '.join(names)}" for file, names in files.items())])


def _ways(speed: float) -> tuple[dict[str, list[str]], list[dict[str, list[str]]]]:
    """Way of an ordinary sample at a speed [rad/s], and the ways of those with which a cycle was published."""
    command = [sys.executable, "-c", _MONITOR, str(speed)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=True)
    samples = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[[")]
    ordinary = [_files(functions) for functions, cycles in samples if not cycles]
    usual = median_low(map(len, ordinary))
    return next(one for one in ordinary if len(one) == usual), [_files(functions) for functions, n in samples if n]


def _drawn() -> set[str]:
    table = _DESIGN.read_text(encoding="utf-8").partition("| step | files |")[2].partition("\n\n")[0]
    return set(re.findall(r"`([\w/]+\.py)`", table))


def _entered(sample: dict[str, list[str]]) -> set[str]:
    """The files; from Python 3.13 on a profiler does not see compiled functions, and those that are drawn count."""
    unseen = sys.version_info >= (3, 13)
    return {*sample, *(file for file in _drawn() if unseen and file.endswith("_kernel.py"))}


@pytest.mark.slow
def test_the_way_of_a_sample_is_the_one_that_is_drawn(ros_domain: int) -> None:
    """Issue 40, item 1: no file joins the way unnoticed, between two slips and at the end of one."""
    sample, slips = _ways(0.005)
    assert _entered(sample) == _drawn(), _drawing(sample)
    assert len(_entered(sample)) <= _MOST, _drawing(sample)
    slip = min(slips, key=len)
    assert len(_entered(slip)) <= _MOST_AT_A_SLIP, _drawing(slip)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_way_of_a_sample_in_steady_motion(ros_domain: int) -> None:
    """Issue 40, item 1: its damping reserve is looked at besides."""
    sample, slips = _ways(0.1)
    assert not slips
    assert _entered(sample) == _drawn() | {"model/dimensionless.py"}, _drawing(sample)
