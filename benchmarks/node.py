# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The running monitor against a bare rclpy node with an empty callback, on the same stream: processor, losses, delays.

As a command: python -m benchmarks.node [SECONDS [JOINTS RATE [STICKING]]]; with idle [SECONDS], the monitor without any
messages; with rest [SECONDS], what a joint costs that rests, and one that sticks.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from stickslip_ros.cli.monitor_client import values_of
from stickslip_ros.cli.processes import NodeProcess, isolate

_SECONDS = 20.0
_CASES = ((7, 1000.0, 1), (7, 5000.0, 1), (60, 1000.0, 3))  # joints, rate [Hz], how many of the joints stick
_WARM_UP = 45.0  # [s], in which the friction is learnt: studies grow rare
_PLAYED_ON = 5.0
_STARTS = 10.0  # [s] that a process takes to start, and to find that nothing comes
_BARE = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
rclpy.init()
node = Node("bare")
node.create_subscription(JointState, "joint_states", lambda _: None, 10)
rclpy.spin(node)
"""
_IMPORT = """
import time
begin = time.perf_counter()
import stickslip_ros.monitoring.joint_monitor
print(time.perf_counter() - begin)
"""
_TICKS = os.sysconf("SC_CLK_TCK")


class Listener:
    """What the monitor says, and when."""

    def __init__(self, node: Node) -> None:
        self._node = node
        qos = QoSProfile(depth=5000)
        self._subscriptions: list[Subscription] = [
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos),
            node.create_subscription(DiagnosticArray, "/stickslip_monitor/cycles", self._on_cycles, qos),
        ]
        self.own: dict[str, str] = {}
        self.latencies: list[float] = []
        self.delays: list[float] = []

    def listen(self, seconds: float) -> None:
        """For so long."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            rclpy.spin_once(self._node, timeout_sec=left)

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.hardware_id == "stickslip_monitor":
                self.own = values_of(status)
                self.latencies.append(float(self.own["latency from message to status [s]"]))

    def _on_cycles(self, array: DiagnosticArray) -> None:
        now = time.time()
        for status in array.status:
            self.delays.append(now - float(values_of(status)["arrest [s]"]))


def processor_time(pid: int) -> float:
    """Of a process and its children [s]."""
    total = 0.0
    for one in (pid, *_children(pid)):
        fields = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
        total += (int(fields[11]) + int(fields[12])) / _TICKS
    return total


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def resident(pid: int) -> float:
    """Memory of a process [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@contextmanager
def stream(
    joints: int, rate: float, seconds: float, sticking: int, resting: int = 0
) -> Iterator[subprocess.Popen[str]]:
    """A publisher of joint states in a process of its own."""
    numbers = map(str, (joints, rate, seconds, sticking, resting))
    command = [sys.executable, "-m", "benchmarks.joint_stream", *numbers]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def run(seconds: float = _SECONDS, cases: tuple[tuple[int, float, int], ...] = _CASES) -> None:
    """Every case: the monitor first, then the bare node, for as long."""
    isolate()
    rclpy.init(args=[])
    node = Node("listener")
    try:
        _run_start(node)
        for case in cases:
            _run_case(node, seconds, *case)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _run_start(node: Node) -> None:
    """From the start of the process to the first status, and the import of the floors."""
    listener, begin = Listener(node), time.monotonic()
    with NodeProcess("monitor", {"joints": "[joint1]", "state_file": "none"}):
        while not listener.own:
            listener.listen(0.02)
        first = time.monotonic() - begin
    runs = [
        subprocess.run([sys.executable, "-c", _IMPORT], capture_output=True, text=True, check=True) for _ in range(3)
    ]
    floors = min(float(run.stdout) for run in runs)
    print(f"monitor, start to first status {first:.1f} s; import of model and monitoring {floors:.2f} s", flush=True)


def _run_case(node: Node, seconds: float, joints: int, rate: float, sticking: int) -> None:
    listener = Listener(node)
    with NodeProcess("monitor", {"joints": "['']", "state_file": "none"}) as monitor:
        listener.listen(4.0)
        with stream(joints, rate, _WARM_UP + seconds, sticking) as publisher:
            listener.listen(_WARM_UP)
            before, memory, begin = processor_time(monitor.pid), resident(monitor.pid), time.monotonic()
            listener.latencies.clear()
            listener.delays.clear()
            listener.listen(seconds)
            used = (processor_time(monitor.pid) - before) / (time.monotonic() - begin)
            grown = resident(monitor.pid) - memory
            listener.listen(_PLAYED_ON)
            assert publisher.stdout is not None
            sent = int(publisher.stdout.readline())
        received = int(listener.own["messages received [1]"])
    with subprocess.Popen([sys.executable, "-c", _BARE]) as bare, stream(joints, rate, 5.0 + seconds, sticking):
        time.sleep(5.0)
        before, begin = processor_time(bare.pid), time.monotonic()
        time.sleep(seconds)
        alternative = (processor_time(bare.pid) - before) / (time.monotonic() - begin)
        bare.kill()
    latency = float(np.nanquantile(listener.latencies, 0.99)) if listener.latencies else np.nan
    delays = np.array(listener.delays or [np.nan])
    print(
        f"monitor, {joints} joints at {rate:g} Hz, {sticking} sticking: processor {100 * used:.0f} %, "
        f"{used / alternative:.2f} of a bare subscriber's; lost {sent - received} of {sent}; "
        f"message to status p99 {1000 * latency:.0f} ms; arrest to cycle median {1000 * np.median(delays):.0f} ms, "
        f"p90 {1000 * np.quantile(delays, 0.9):.0f} ms ({len(listener.delays)} cycles); "
        f"memory {memory:.0f} MB {grown:+.1f} MB in {seconds:g} s",
        flush=True,
    )


def run_idle(seconds: float) -> None:
    """The monitor and the bare node, where nothing is published."""
    isolate()
    with NodeProcess("monitor", {"joints": "['']", "state_file": "none"}) as monitor:
        used = _used(monitor.pid, seconds)
    with subprocess.Popen([sys.executable, "-c", _BARE]) as bare:
        alternative = _used(bare.pid, seconds)
        bare.kill()
    print(f"idle: monitor {100 * used:.2f} % of a core, bare rclpy node {100 * alternative:.2f} %")


def run_rest(seconds: float, joints: int = 20, rate: float = 1000.0) -> None:
    """One joint at rest, many at rest, and many that stick: by how much each more costs."""
    isolate()
    shares = {}
    for count, sticking in ((1, 0), (joints, 0), (joints, joints)):
        with (
            NodeProcess("monitor", {"joints": "['']", "state_file": "none"}) as monitor,
            stream(count, rate, _STARTS + _WARM_UP + 2.0 * seconds, sticking, count - sticking),
        ):
            shares[count, sticking] = _used(monitor.pid, seconds, _STARTS + _WARM_UP)
    one = shares[1, 0]
    rests, sticks = ((shares[joints, sticking] - one) / (joints - 1) for sticking in (0, joints))
    print(f"{joints} joints at {rate:g} Hz: one more that rests takes {100 * rests:.3f} % of a core, one that sticks "
          f"{100 * sticks:.3f} %: a share of {rests / sticks:.2f}; a single one at rest {100 * one:.1f} %")  # fmt: skip


def _used(pid: int, seconds: float, after: float = _STARTS) -> float:
    """Share of a core that a process and its children take, after some time."""
    time.sleep(after)
    before, begin = processor_time(pid), time.monotonic()
    time.sleep(seconds)
    return (processor_time(pid) - before) / (time.monotonic() - begin)


if __name__ == "__main__":
    if sys.argv[1:2] in (["idle"], ["rest"]):
        length = float(sys.argv[2]) if len(sys.argv) > 2 else 2.0 * _SECONDS
        run_idle(length) if sys.argv[1] == "idle" else run_rest(length)
        sys.exit()
    given = [float(argument) for argument in sys.argv[1:]]
    case = (int(given[1]), given[2], int(given[3]) if len(given) > 3 else 1) if len(given) > 2 else None
    run(given[0] if given else _SECONDS, (case,) if case else _CASES)
