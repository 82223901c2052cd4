# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 21: examples/ros2_control, on the real controller_manager; on machines without it only what can be read."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from builtin_interfaces.msg import Duration
from conftest import LIMIT, ROOT
from nodes.forked_nodes import NodeProcess
from sensor_msgs.msg import JointState
from support_ros import Probe, probe
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.parent_death import die_with_parent

EXAMPLE = ROOT / "examples" / "ros2_control"
NEEDED = (
    "controller_manager", "joint_state_broadcaster", "joint_state_topic_hardware_interface",
    "joint_trajectory_controller", "pid_controller", "robot_state_publisher", "stickslip_ros",
)  # fmt: skip
CONTROLLER = "/joint_trajectory_controller"


def missing() -> list[str]:
    """What the example needs and this machine has not."""
    folders = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    index = Path("share", "ament_index", "resource_index", "packages")
    found = [name for name in NEEDED if not any((folder / index / name).exists() for folder in folders)]
    return found if shutil.which("ros2") else ["ros2 launch", *found]


with_ros2_control = pytest.mark.skipif(bool(missing()), reason=f"not installed here: {', '.join(missing())}")


def read(name: str) -> dict[str, object]:
    """A parameter file of the example."""
    return yaml.safe_load((EXAMPLE / name).read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def test_the_example_agrees_with_itself() -> None:
    """Joints, topics and controllers have the same names in all its files."""
    robot = ElementTree.parse(EXAMPLE / "arm.urdf").getroot()
    joints = [joint.attrib["name"] for joint in robot.findall("joint")]
    assert [joint.attrib["name"] for joint in robot.findall("ros2_control/joint")] == joints
    topics = {one.attrib["name"]: one.text for one in robot.findall("ros2_control/hardware/param")}
    assert topics["joint_commands_topic"] == "/plant/joint_commands"
    assert topics["joint_states_topic"] == "/plant/joint_states"
    plant = read("plant.yaml")["/plant/simulated_joint"]["ros__parameters"]  # type: ignore[index]
    assert plant["joints"] == joints
    assert plant["command"] == "effort"
    controllers = read("controllers.yaml")
    managed = set(controllers["controller_manager"]["ros__parameters"]) - {"update_rate"}  # type: ignore[index]
    launch = (ROOT / "launch" / "ros2_control_demo.launch.py").read_text(encoding="utf-8")
    for controller in managed:
        assert f'"{controller}"' in launch
    for controller, key in (("joint_trajectory_controller", "joints"), ("pid_controller", "dof_names")):
        parameters = controllers[controller]["ros__parameters"]  # type: ignore[index]
        assert parameters[key] == joints
        assert list(parameters["gains"]) == joints
    watched = read("stickslip.yaml")["/**"]["ros__parameters"]  # type: ignore[index]
    assert watched["joints"] == joints
    assert list(watched["limits"]) == joints


def test_its_hardware_takes_efforts(ros_domain: int) -> None:
    """What the description names is there, and moves."""
    seen: list[JointState] = []
    plant = NodeProcess("simulated_joint", {}, {"__ns": "/plant"}, EXAMPLE / "plant.yaml")
    with plant, probe() as one:
        one.node.create_subscription(JointState, "/plant/joint_states", seen.append, 10)
        efforts = one.node.create_publisher(JointState, "/plant/joint_commands", 1)
        one.wait(lambda: bool(seen), "the joints' states")
        assert seen[-1].name == ["shoulder", "elbow"]

        def moves() -> bool:
            efforts.publish(JointState(name=["shoulder", "elbow"], effort=[12.0, 0.0]))
            return seen[-1].position[0] > 1e-3

        one.wait(moves, "the shoulder to move")
        assert seen[-1].position[1] == 0.0


@contextmanager
def demo(folder: Path) -> Iterator[Probe]:
    """The launch file, started as its user starts it; the folder has its log."""
    command = ["ros2", "launch", "stickslip_ros", "ros2_control_demo.launch.py"]
    # A pipe that nobody reads is full soon, and whoever writes to it stands still then: the robot, for one.
    with open(folder / "launch.log", "w") as log:
        process = subprocess.Popen(
            command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True, preexec_fn=die_with_parent
        )
    try:
        with probe() as one:
            yield one
    finally:
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)


def move(one: Probe, way: float, seconds: int) -> None:
    """Let the shoulder go this way [rad], as a planner does."""
    publisher = one.node.create_publisher(JointTrajectory, f"{CONTROLLER}/joint_trajectory", 10)
    one.wait(lambda: publisher.get_subscription_count() > 0, "the trajectory controller")
    point = JointTrajectoryPoint(positions=[way], time_from_start=Duration(sec=seconds))

    def moves() -> bool:
        # A controller that listens already may not be active yet, and forgets what it is told.
        publisher.publish(JointTrajectory(joint_names=["shoulder"], points=[point]))
        one.spin(3.0)
        return one.status("shoulder") != "at_rest"

    one.wait(moves, "the joint to be told to move")


@with_ros2_control
def test_it_sticks_and_is_cured(ros_domain: int, tmp_path: Path) -> None:
    """Gains and references are taken, stick-slip is found, narrow limits are refused, the advice is applied."""
    with demo(tmp_path) as one:
        one.wait_for_monitor()
        one.wait(lambda: one.margins.get("shoulder", {}).get("stiffness") == 630.0, "the controller's gains")
        move(one, 1.5, 300)
        one.wait(lambda: one.status("shoulder") == "stick_slip", "stick-slip")
        one.wait(lambda: one.diagnostics["shoulder"][2]["velocity is from"] == "reference", "the reference")
        one.wait(lambda: "recommended damping [N*m*s/rad]" in one.diagnostics["shoulder"][2], "advice")
        narrow = {"limits.shoulder.p_max": 640.0, "limits.shoulder.d_max": 1.0}
        assert one.set_parameters("/stickslip_monitor", narrow) == ["", ""]
        one.spin(2.0)
        refused = one.answer("apply_recommendation")
        assert not refused.success
        wide = {"limits.shoulder.p_max": 4000.0, "limits.shoulder.d_max": 200.0}
        assert one.set_parameters("/stickslip_monitor", wide) == ["", ""]
        one.wait(lambda: "recommended damping [N*m*s/rad]" in one.diagnostics["shoulder"][2], "advice")
        one.wait(lambda: one.status("shoulder") == "stick_slip", "stick-slip again")
        answer = one.answer("apply_recommendation")
        assert answer.success, answer.message
        assert one.get_parameters(CONTROLLER, ["gains.shoulder.d"])[0] > 0.0


@with_ros2_control
def test_identify_moves_it(ros_domain: int, tmp_path: Path) -> None:
    """The experiment is accepted by the controller, and finds the joint's friction."""
    with demo(tmp_path) as one:
        one.wait_for_monitor()
        one.wait(lambda: "shoulder" in one.margins, "the joint")
        command = [sys.executable, "-m", "stickslip_ros.cli.main", "identify", "--controller", CONTROLLER]
        command += ["--on", "shoulder", "--speeds", "0.005,0.02", "--json"]
        # At rest it may lag 0.016 rad, and two cores that run all this hold it up now and then.
        command += ["--largest-lag", "0.05"]
        found = subprocess.run(command, capture_output=True, text=True, timeout=400.0, check=False)
        assert found.returncode == 0, found.stdout + found.stderr
        coulomb = json.loads(found.stdout)["friction"]["coulomb"]
        assert coulomb["value"] == pytest.approx(8.43, rel=0.05)
