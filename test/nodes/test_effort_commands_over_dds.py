# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 21: the simulated joint as a drive that takes efforts, beside a controller in another process."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from conftest import LIMIT
from nodes.forked_nodes import NodeProcess
from sensor_msgs.msg import JointState
from support_ros import probe

CONTROLLER = str(Path(__file__).parent / "effort_controller.py")
DRIVE = {"command": "effort", "rate": 500.0, "encoder_resolution.joint1": 1e-5}
BREAKAWAY = 10.03  # [N·m] Coulomb and Stribeck friction of the PUMA's joint


def test_a_loop_closed_by_another_node(ros_domain: int) -> None:
    """It sticks under that node's gains, which the monitor follows; damping there cures it."""
    monitor = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "controller": "/effort_controller"}
    with (
        NodeProcess("monitor", {**monitor, "state_file": "none", "learn": "false"}),
        NodeProcess("simulated_joint", DRIVE),
        NodeProcess(CONTROLLER, {}),
        probe() as one,
    ):
        one.wait_for_monitor()
        one.wait(lambda: one.margins.get("joint1", {}).get("stiffness") == 630.0, "the controller's gains")
        one.wait(lambda: one.status("joint1") == "stick_slip", "stick-slip")
        assert one.set_parameters("/effort_controller", {"gains.joint1.p": 1500.0, "gains.joint1.d": 150.0}) == ["", ""]
        one.wait(lambda: one.status("joint1") == "smooth", "smooth motion")


def test_efforts_move_the_joint_only_as_long_as_they_come(ros_domain: int) -> None:
    """Below its static friction it stands, above it slides; without a controller it comes to rest."""
    seen: list[JointState] = []
    with NodeProcess("simulated_joint", DRIVE), probe() as one:
        one.node.create_subscription(JointState, "joint_states", seen.append, 100)
        efforts = one.node.create_publisher(JointState, "joint_commands", 1)
        one.wait(lambda: len(seen) > 100, "the joint's states")

        def push(effort: float, seconds: float) -> None:
            # Until it has arrived too, which takes as long as the nodes need to find each other.
            until = time.monotonic() + seconds
            while time.monotonic() < until or seen[-1].effort[0] != pytest.approx(effort):
                assert time.monotonic() < until + 10.0, f"the joint has {seen[-1].effort[0]}, not {effort}"
                efforts.publish(JointState(name=["joint1"], effort=[effort]))
                one.spin(0.02)

        push(BREAKAWAY - 0.5, 1.0)
        assert seen[-1].position[0] == 0.0
        assert seen[-1].effort[0] == pytest.approx(BREAKAWAY - 0.5)
        push(BREAKAWAY + 0.5, 1.0)
        one.wait(lambda: seen[-1].position[0] > 1e-3, "motion")
        one.wait(lambda: seen[-1].effort[0] == 0.0 and seen[-1].velocity[0] == 0.0, "rest")
        # It has no controller of its own, and says so.
        names = [name for name, _ in one.node.get_publisher_names_and_types_by_node("simulated_joint", "/")]
        assert "/joint_states" in names
        assert "/joint_references" not in names


def test_another_command_is_refused(ros_domain: int) -> None:
    """In the words that were typed."""
    with NodeProcess("simulated_joint", {"command": "torque"}) as joint:
        assert joint.wait(LIMIT) != 0
        assert "'command' must be one of reference, effort: torque" in joint.output()
