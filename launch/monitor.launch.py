# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor beside a robot's controller.

    ros2 launch stickslip_ros monitor.launch.py controller:=/pid_controller params_file:=my_joints.yaml

All names are relative to `namespace`, unless they begin with a slash.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def monitor(context: LaunchContext) -> list[Node]:
    """The node; without a controller here, that of the parameter file counts."""
    params_file, controller = (LaunchConfiguration(name).perform(context) for name in ("params_file", "controller"))
    topics = ("joint_states", "joint_references", "pd_gains")
    return [
        Node(
            package="stickslip_ros",
            executable="monitor",
            namespace=LaunchConfiguration("namespace"),
            parameters=[
                *filter(None, [params_file]),
                {"use_sim_time": LaunchConfiguration("use_sim_time").perform(context).lower() == "true"},
                *([{"controller": controller}] if controller else []),
            ],
            remappings=[(topic, LaunchConfiguration(topic)) for topic in topics],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="path of a parameter file, e.g. a changed copy of config/monitor.yaml; "
                "without one the monitor watches every joint that it hears, and learns its friction",
            ),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the robot, e.g. robot1"),
            DeclareLaunchArgument(
                "controller",
                default_value="",
                description="controller node whose gains the monitor reads, e.g. /pid_controller",
            ),
            DeclareLaunchArgument(
                "joint_states",
                default_value="joint_states",
                description="topic of the measured positions and velocities",
            ),
            DeclareLaunchArgument(
                "joint_references",
                default_value="joint_references",
                description="topic of the commanded positions and velocities",
            ),
            DeclareLaunchArgument(
                "pd_gains", default_value="pd_gains", description="topic of the gains, if a node publishes them"
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="true: take the time from /clock, as in simulation"
            ),
            OpaqueFunction(function=monitor),
        ]
    )
