# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction learnt by the real node, and by the guided experiment, over real DDS."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from conftest import LIMIT
from nodes.forked_nodes import NodeProcess
from rclpy.node import Node
from sensor_msgs.msg import JointState
from support_ros import probe
from trajectory_msgs.msg import JointTrajectory

from stickslip_ros.cli.main import main
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.nodes.speed_ladder import LadderNode, speed_ladder
from stickslip_ros.settings.known_joints import load_joint

FAST = {"rate": 500.0, "time_factor": 2.0}


def test_the_monitor_learns_while_the_joint_moves(ros_domain: int) -> None:
    """Issue 4, items 3 and 4: inertia and friction with errors in the diagnostics, the margin's error, ~/friction."""
    friction: list[JointState] = []
    with (
        NodeProcess("simulated_joint", FAST),
        NodeProcess("monitor", {"joints": "[joint1]", "controller": "/simulated_joint"}),
        probe() as one,
    ):
        one.node.create_subscription(JointState, "/stickslip_monitor/friction", friction.append, 10)
        one.wait_for_monitor()

        def keys() -> dict[str, str]:
            return one.diagnostics["joint1"][2] if "joint1" in one.diagnostics else {}

        one.wait(lambda: "inertia [kg*m^2]" in keys(), "the friction to be learnt")
        one.wait(lambda: abs(float(keys()["inertia [kg*m^2]"]) - 6.3) < 0.15, "the right inertia")
        said = keys()
        assert float(said["inertia std [kg*m^2]"]) < 1.0
        assert said["margin rests on"].startswith("friction estimated from")
        assert math.isfinite(float(said["energy_margin std [M*stribeck_velocity^2]"]))
        one.wait(lambda: 0.0 <= one.margins["joint1"]["stick_slip_probability"] <= 1.0, "the probability")
        assert "inertia 6." in said["friction learnt"]
        assert " ± " in said["friction learnt"]
        # Not only of the moments at which the joint rests.
        one.wait(lambda: any(abs(message.effort[0]) > 8.0 for message in friction), "the friction of the motion")
        assert friction[-1].name == ["joint1"]


def test_the_experiment_identifies_a_simulated_joint(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 4, item 6: the ladder of speeds makes everything identifiable, gains and load included."""
    out = tmp_path / "waist.yaml"
    with NodeProcess("simulated_joint", {**FAST, "profile.joint1": "hold"}):
        ladder = ["--simulated", "/simulated_joint", "--speeds", "0.0058,0.011", "--step-time", "6", "--rest", "0.5"]
        # Where the machine has no time for the node for 5 s the command ends, as it should; a reader asks again.
        for _ in range(3):
            status = main(["identify", *ladder, "--out", str(out), "--name", "waist"])
            said = capsys.readouterr()
            if "has not answered" not in said.err:
                break
    assert status == 0, said.err
    joint = load_joint(str(out)).joint
    assert joint.inertia == pytest.approx(6.3, rel=0.02)
    for name, value in (("coulomb", 8.43), ("stribeck", 1.6), ("stribeck_velocity", 0.0058), ("lag", 0.05)):
        assert getattr(joint.friction, name) == pytest.approx(value, rel=0.05), name
    assert "Constant load" in said.out


class _FollowsTrajectories(Node):
    """What a joint_trajectory_controller does with points that have positions alone: straight lines between them."""

    def __init__(self) -> None:
        super().__init__("joint_trajectory_controller")
        self.declare_parameter("joints", ["elbow"])
        self.received: list[JointTrajectory] = []
        self.create_subscription(
            JointTrajectory, "/joint_trajectory_controller/joint_trajectory", self.received.append, 10
        )
        self.states = self.create_publisher(JointState, "joint_states", 100)
        self._count = 0
        self.create_timer(0.01, self._tick)

    def _tick(self) -> None:
        self._count += 1
        message = JointState(name=["elbow"], position=[0.5])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(10_000_000 * self._count, 1_000_000_000)
        self.states.publish(message)


def test_a_controller_is_sent_one_trajectory_and_then_told_to_hold(ros_domain: int) -> None:
    """Issue 4, item 6: the ladder begins and ends where the joint is, at constant speeds; a hold follows it."""
    rclpy.init()
    try:
        controller = _FollowsTrajectories()
        # This joint stands, whatever it is told.
        ladder = LadderNode("elbow", controller="/joint_trajectory_controller", largest_lag=1.0)
        executor = rclpy.executors.SingleThreadedExecutor()
        executor.add_node(controller)
        follower = threading.Thread(target=executor.spin, daemon=True)
        follower.start()
        steps = speed_ladder([0.1, 0.2], duration=0.2, rest=0.1)
        batch = ladder.run(steps, lambda *_: None)
        until = time.monotonic() + LIMIT
        while len(controller.received) < 2 and time.monotonic() < until:
            time.sleep(0.01)
        executor.shutdown(timeout_sec=5.0)
        follower.join(5.0)
        trajectory, hold = controller.received
        times = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in trajectory.points]
        positions = np.array([point.positions[0] for point in trajectory.points])
        assert positions[0] == positions[-1] == pytest.approx(0.5)
        assert positions.max() == pytest.approx(0.56)
        speeds = np.diff(positions) / np.diff(times)
        assert speeds == pytest.approx([step.velocity for step in steps])
        assert all(not point.velocities for point in trajectory.points)
        assert hold.points[0].positions[0] == pytest.approx(0.5)
        assert len(batch) > 20
        ladder.destroy_node()
        controller.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_effort_without_gains_gives_a_factor(ros_domain: int) -> None:
    """Issue 15: joint states with effort, no controller: margin and factors come; gains are not claimed or applied."""
    rate, count = 200.0, 9_000
    times = np.arange(count) / rate
    velocities = np.full(count, 0.0058)
    motion = simulate(
        load_joint("puma560_joint1").joint, Gains(stiffness=630.0), 0.0058 * times, velocities, period=1.0 / rate
    )
    with (
        NodeProcess("monitor", {"joints": "[elbow]", "allow_apply": "true"}),
        probe() as one,
    ):
        one.wait_for_monitor()
        for index in range(count):
            position = 2.5e-5 * round(float(motion.position[index]) / 2.5e-5)
            one.publish(["elbow"], 100.0 + times[index], position=[position], effort=[float(motion.effort[index])])
            if index % 20 == 0:
                one.spin(0.01)
        one.wait(lambda: math.isfinite(one.margins["elbow"]["damping_factor"]), "a factor as advice")
        row, said = one.margins["elbow"], one.diagnostics["elbow"][2]
        assert row["energy_margin"] < 0.0
        assert math.isnan(row["stiffness"])
        assert " × " in said["recommendation"]
        assert "of the controller estimated from the effort" in said["margin rests on"]
        assert abs(float(said["inertia [kg*m^2]"]) - 6.3) < 0.3
        assert one.recommended is None or not np.isfinite(one.recommended.data).any()
        answer = one.answer("apply_recommendation")
        assert not answer.success
        assert "its gains are not known" in answer.message
