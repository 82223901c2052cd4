# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A real controller_manager with a joint that sticks and slips, and the monitor beside it; no robot is needed.

    ros2 launch stickslip_ros ros2_control_demo.launch.py
    ros2 launch stickslip_ros ros2_control_demo.launch.py controller:=pid_controller

Hardware is simulated_joint, which takes efforts; examples/ros2_control has its description and all parameters. The
packages needed for it are in docs/how_to/beside_your_robot.md.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

REFERENCE_TYPES = {
    "joint_trajectory_controller": "JointTrajectoryControllerState",
    "pid_controller": "MultiDOFStateStamped",
}


def nodes(context: LaunchContext) -> list[Node]:
    """Hardware, controllers and monitor."""
    controller = LaunchConfiguration("controller").perform(context)
    example = Path(get_package_share_directory("stickslip_ros"), "examples", "ros2_control")
    controllers = str(example / "controllers.yaml")
    return [
        Node(
            package="stickslip_ros",
            executable="simulated_joint",
            namespace="plant",
            parameters=[str(example / "plant.yaml")],
            output="screen",
        ),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": (example / "arm.urdf").read_text(encoding="utf-8")}],
        ),
        Node(package="controller_manager", executable="ros2_control_node", parameters=[controllers], output="screen"),
        Node(
            package="controller_manager",
            executable="spawner",
            arguments=["joint_state_broadcaster", controller, "--param-file", controllers],
            output="screen",
        ),
        Node(
            package="stickslip_ros",
            executable="monitor",
            parameters=[
                str(example / "stickslip.yaml"),
                {"controller": f"/{controller}", "reference_type": REFERENCE_TYPES[controller]},
            ],
            remappings=[("joint_references", f"/{controller}/controller_state")],
            output="screen",
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "controller",
                default_value="joint_trajectory_controller",
                choices=sorted(REFERENCE_TYPES),
                description="which controller closes the position loop",
            ),
            OpaqueFunction(function=nodes),
        ]
    )
