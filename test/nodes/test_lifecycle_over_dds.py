# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor as a managed node, over real DDS: every transition, again and again; its end by a signal."""

from __future__ import annotations

import os
import signal
import time

import pytest
from conftest import LIMIT, nightly
from lifecycle_msgs.msg import Transition
from support_processes import children, command_line, memory, runs
from support_ros import play, probe, staircase

from stickslip_ros.cli.processes import NodeProcess

NODE = "stickslip_monitor"


def test_every_transition_again_and_again(ros_domain: int) -> None:
    """Issue 7: configure, activate, deactivate, cleanup, three times: the same entities, the same results, no leak."""
    parameters = {"joints": "[joint1]", "autostart": "false", "controller": "/nobody", "state_file": "none"}
    with NodeProcess("monitor", parameters) as monitor, probe() as one:
        assert one.state() == "unconfigured"
        assert "/joint_states" not in one.entities()["subscriptions"]
        sizes, graphs = [], []
        for _ in range(3):
            assert one.change_state(Transition.TRANSITION_CONFIGURE)
            assert one.state() == "inactive"
            assert "/joint_states" not in one.entities()["subscriptions"]
            assert one.change_state(Transition.TRANSITION_ACTIVATE)
            one.diagnostics.clear()
            one.cycles.clear()
            one.wait_for_monitor()
            # A busy machine learns of a node's topics a little later.
            one.wait(lambda: "/joint_states" in one.entities()["subscriptions"], "the node's topics")
            graphs.append(one.entities())
            play(one, "joint1", *staircase(2000), begin=100.0)
            one.wait(lambda: one.status("joint1") == "stick_slip" and len(one.cycles) >= 8, "stick-slip")
            # The count comes with the next status; one that began where it ended would be another.
            one.wait(lambda: one.diagnostics["joint1"][2]["cycles [1]"] == str(len(one.cycles)), "the count")
            assert one.change_state(Transition.TRANSITION_DEACTIVATE)
            inactive = time.time()
            one.wait(lambda: "/joint_states" not in one.entities()["subscriptions"], "the end of listening")
            one.spin(0.5)
            # By the stamp: on a busy machine what was published before is heard late.
            assert one.stamps[-1] < inactive, "an inactive node says nothing"
            assert one.change_state(Transition.TRANSITION_ACTIVATE)
            one.wait_for_monitor()
            assert one.change_state(Transition.TRANSITION_DEACTIVATE)
            assert one.change_state(Transition.TRANSITION_CLEANUP)
            assert one.state() == "unconfigured"
            assert "~/cycles" not in one.entities()["publishers"]
            sizes.append(memory(monitor.pid))
        assert graphs[0] == graphs[1] == graphs[2]
        assert sizes[2] - sizes[1] < 5.0
        assert one.change_state(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
        assert one.state() == "finalized"
        # Transitions that are not there are refused, and change nothing.
        assert not one.change_state(Transition.TRANSITION_ACTIVATE)
        assert monitor.stop() == 0


def test_parameters_that_make_no_joint_are_refused_at_configuring(ros_domain: int) -> None:
    """Issue 7: without autostart the node stays, unconfigured, and its log says why."""
    with NodeProcess("monitor", {"autostart": "false", "joints": "[a]", "model.a": "puma"}) as monitor, probe() as one:
        assert not one.change_state(Transition.TRANSITION_CONFIGURE)
        assert one.state() == "unconfigured"
        assert "unknown joint 'puma'" in monitor.output()
        assert monitor.stop() == 0


@pytest.mark.parametrize(
    ("number", "how"),
    [
        (signal.SIGTERM, "active"), (signal.SIGINT, "learning"), (signal.SIGTERM, "unconfigured"),
        nightly(signal.SIGINT, "active"), nightly(signal.SIGTERM, "learning"), nightly(signal.SIGINT, "unconfigured"),
    ],
)  # fmt: skip
def test_a_signal_ends_it(ros_domain: int, number: signal.Signals, how: str) -> None:
    """Issue 7: SIGINT and SIGTERM, also while a study is under way in the other process; nothing is left behind."""
    parameters = {"joints": "[joint1]", "autostart": str(how != "unconfigured").lower(), "gains.joint1.p": 630.0}
    with NodeProcess("monitor", parameters) as monitor, probe() as one:
        if how == "unconfigured":
            assert one.state() == "unconfigured"
        else:
            one.wait_for_monitor()
        if how == "learning":
            play(one, "joint1", *staircase(2000), begin=100.0)
            one.wait(lambda: float(one.diagnostics[NODE][2].get("memory of the worker [MB]", 0)) > 10, "the worker")
        left = children(monitor.pid)
        assert bool(left) == (how == "learning")
        os.kill(monitor.pid, number)
        assert monitor.wait(LIMIT) == 0
        assert "Traceback" not in monitor.output()
        one.wait(lambda: not any(map(runs, left)), "the end of the worker")


def test_a_worker_ends_with_a_node_that_is_killed(ros_domain: int) -> None:
    """Issue 7: kill -9 leaves no process behind; a worker that is killed is begun again."""
    with NodeProcess("monitor", {"joints": "[joint1]", "gains.joint1.p": 630.0}) as monitor, probe() as one:
        one.wait_for_monitor()
        play(one, "joint1", *staircase(2000), begin=100.0)

        def worker() -> list[int]:
            return [pid for pid in children(monitor.pid) if "spawn_main" in command_line(pid)]

        one.wait(lambda: bool(worker()), "the worker")
        first = worker()
        os.kill(first[0], signal.SIGKILL)
        one.wait(lambda: bool(worker()) and worker() != first, "another worker")
        one.wait(lambda: "study" not in one.diagnostics[NODE][1], "its work")
        second = worker()
        monitor.kill()
        one.wait(lambda: not any(map(runs, second)), "the end of the worker")
