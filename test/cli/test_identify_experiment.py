# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip identify --controller` beside a controller of several joints: it moves one, or says why it does not."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import rclpy
from conftest import LIMIT, ROOT, begun, nightly
from nodes.forked_nodes import NodeProcess
from rclpy.node import Node
from sensor_msgs.msg import JointState

from stickslip_ros.cli.main import main

CONTROLLER = "/joint_trajectory_controller"
LADDER = ["identify", "--controller", CONTROLLER, "--speeds", "0.02", "--step-time", "3", "--rest", "1"]
START = {"shoulder": 0.2, "elbow": 0.5, "wrist": -0.3}


@contextmanager
def robot(**parameters: object) -> Iterator[None]:
    """The stand-in for robot and controller, as a process of its own."""
    with NodeProcess(str(ROOT / "test" / "nodes" / "several_joints.py"), parameters):
        yield


def positions(seconds: float) -> np.ndarray:
    """Where the joints are for so long; of shape (samples, 3)."""
    rclpy.init()
    try:
        node = Node("watcher")
        rows: list[list[float]] = []
        node.create_subscription(JointState, "joint_states", lambda message: rows.append(list(message.position)), 100)
        until = time.monotonic() + LIMIT
        while not rows and time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.05)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.05)
        node.destroy_node()
        return np.array(rows)
    finally:
        rclpy.try_shutdown()


def failed(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> tuple[str, float]:
    """The line that an experiment ended with, and how long it took [s]."""
    begin = time.monotonic()
    assert main(arguments) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[-1].startswith("stickslip: ")
    return lines[-1], time.monotonic() - begin


def test_one_of_several_joints_is_moved(ros_domain: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 15: all the controller's joints are in the trajectory: one climbs the ladder, the others hold."""
    with robot():
        # A motion without friction shows none: status 1 says that the whole ladder was climbed.
        assert main([*LADDER, "--on", "elbow"]) == 1, capsys.readouterr().err
        assert "Friction could not be estimated" in capsys.readouterr().out
        after = positions(0.5)
        assert after == pytest.approx(np.tile(list(START.values()), (len(after), 1)), abs=2e-3)


@pytest.mark.parametrize(
    ("parameters", "joint", "said"),
    [
        nightly({"manner": "ignore"}, "elbow", "elbow does not move and is 0.0"),
        (
            {"refuse_all": "true"},
            "elbow",
            f"{CONTROLLER} says: Can't accept new trajectories. Controller is not active",
        ),
        ({"manner": "swing"}, "elbow", "elbow moves already"),
        nightly({"manner": "swing"}, "wrist", "elbow moves already"),
        ({"manner": "disturb"}, "elbow", "something else moves it"),
        nightly({}, "ankle", "ankle"),
        nightly(
            {"joints": "[shoulder, wrist]"}, "elbow", f"elbow is none of the joints of {CONTROLLER}: shoulder, wrist"
        ),
        nightly({"joints": "[shoulder, elbow, tail]"}, "elbow", "joint_states, of these joints"),
        ({"joints": "7"}, "elbow", f"{CONTROLLER} has no parameter 'joints'"),
    ],
)
def test_a_joint_that_does_not_do_as_told_ends_the_experiment(
    ros_domain: int,
    capsys: pytest.CaptureFixture[str],
    parameters: dict[str, object],
    joint: str,
    said: str,
) -> None:
    """Issue 15: refused, ignored, disturbed: one line says it within seconds, nothing is judged, the joint stands."""
    with robot(**parameters):
        line, _ = failed(capsys, [*LADDER, "--on", joint])
        assert said in line
        if parameters.get("manner") != "swing":
            stands = positions(0.5)
            assert np.ptp(stands, axis=0).max() < 1e-3


def test_a_refusal_is_noticed_soon(ros_domain: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 15: a ladder of minutes that is ignored ends two seconds after the joint should have moved by 0.02 rad."""
    with robot(manner="ignore"):
        _, took = failed(capsys, [*LADDER[:-4], "--step-time", "60", "--rest", "1", "--on", "elbow"])
    assert took < LIMIT  # most of it to find the controller, and to see the joint stand


@pytest.mark.parametrize("number", [signal.SIGINT, nightly(signal.SIGTERM)])
def test_ctrl_c_leaves_no_joint_moving(ros_domain: int, number: signal.Signals) -> None:
    """Issue 15: Ctrl-C, and an end from outside, in the middle of the way: the joint stands where it is."""
    with robot():
        command = [sys.executable, "-m", "stickslip_ros.cli.main", *LADDER[:-4], "--step-time", "15", "--rest", "1"]
        with begun([*command, "--on", "elbow"], stderr=subprocess.PIPE, text=True) as experiment:
            until = time.monotonic() + LIMIT
            while positions(0.1)[-1, 1] < 0.52:
                assert time.monotonic() < until, "waited for the joint to move"
            experiment.send_signal(number)
            assert experiment.wait(LIMIT) == 130
        stands = positions(1.0)
        assert np.ptp(stands, axis=0).max() < 1e-3
        # It is told to stand where it was seen last, which on a busy machine is some time ago.
        assert stands[-1, 1] > 0.51


def test_another_trajectory_is_not_judged_as_ours(ros_domain: int) -> None:
    """Issue 15: somebody sends the controller another trajectory meanwhile: the experiment says so and ends."""
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    with robot():
        command = [sys.executable, "-m", "stickslip_ros.cli.main", *LADDER, "--on", "elbow"]
        with begun(command, stderr=subprocess.PIPE, text=True) as experiment:
            rclpy.init()
            try:
                node = Node("somebody")
                publisher = node.create_publisher(JointTrajectory, f"{CONTROLLER}/joint_trajectory", 10)
                heard: list[JointState] = []
                node.create_subscription(JointState, "joint_states", heard.append, 100)
                until = time.monotonic() + LIMIT
                # The controller, and the experiment itself.
                while not heard or heard[-1].position[1] < 0.51 or publisher.get_subscription_count() < 2:
                    assert time.monotonic() < until, "waited for the joint to move"
                    rclpy.spin_once(node, timeout_sec=0.05)
                point = JointTrajectoryPoint(positions=[0.0, 0.0, 0.0])
                point.time_from_start.sec = 20
                publisher.publish(JointTrajectory(joint_names=list(START), points=[point]))
                assert experiment.wait(LIMIT) == 2
            finally:
                rclpy.try_shutdown()
            assert experiment.stderr is not None
            assert f"another trajectory was sent to {CONTROLLER}" in experiment.stderr.read()
        assert np.ptp(positions(1.0), axis=0).max() < 1e-3
