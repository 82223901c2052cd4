# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One monitor for each of several robots, by namespace: /robot1/joint_states, /robot2/joint_states, and so on.

    ros2 launch stickslip_ros fleet.launch.py robots:=robot1,robot2 controller:=pid_controller

Each keeps what it learnt in a file of its own. One monitor can watch several robots too, if their joints have different
names: remap their joint_states to one topic.
"""

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration


def monitors(context: LaunchContext) -> list[IncludeLaunchDescription]:
    """The monitors; the controller's name is relative to each robot's namespace."""
    robots = [robot.strip() for robot in LaunchConfiguration("robots").perform(context).split(",")]
    monitor = f"{get_package_share_directory('stickslip_ros')}/launch/monitor.launch.py"
    passed_on = {name: LaunchConfiguration(name) for name in ("params_file", "controller")}
    return [
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource(monitor), launch_arguments={"namespace": robot, **passed_on}.items()
        )
        for robot in robots
        if robot
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("robots", description="namespaces of the robots, separated by commas: robot1,robot2"),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="path of the parameter file of all monitors; "
                "without one they watch every joint that they hear, and learn its friction",
            ),
            DeclareLaunchArgument(
                "controller",
                default_value="",
                description="controller node in each namespace whose gains the monitor reads",
            ),
            OpaqueFunction(function=monitors),
        ]
    )
