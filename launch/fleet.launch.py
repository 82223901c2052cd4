# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One monitor for each of several robots, by namespace: /robot1/joint_states, /robot1/pid_controller, …

    ros2 launch stickslip_ros fleet.launch.py robots:=robot1,robot2 controller:=pid_controller

Each keeps what it learnt in a file of its own. One monitor can watch several robots too, if their joints have different
names: remap their joint_states to one topic.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def monitors(context: LaunchContext) -> list[Node]:
    """The nodes; the controller's name is relative to each robot's namespace."""
    robots = [robot.strip() for robot in LaunchConfiguration("robots").perform(context).split(",")]
    controller = LaunchConfiguration("controller").perform(context)
    return [
        Node(
            package="stickslip_ros",
            executable="monitor",
            namespace=robot,
            parameters=[LaunchConfiguration("params_file"), *([{"controller": controller}] if controller else [])],
        )
        for robot in robots
        if robot
    ]


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory("stickslip_ros"))
    return LaunchDescription(
        [
            DeclareLaunchArgument("robots", description="namespaces, joined by commas: robot1,robot2"),
            DeclareLaunchArgument(
                "params_file",
                default_value=str(share / "config" / "monitor.yaml"),
                description="parameters of the monitors",
            ),
            DeclareLaunchArgument(
                "controller", default_value="", description="node in each namespace whose gains are followed"
            ),
            OpaqueFunction(function=monitors),
        ]
    )
