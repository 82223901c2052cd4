# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor beside a robot's controller."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def monitor(context: LaunchContext) -> list[Node]:
    """The node; without a controller here, that of the parameter file counts."""
    controller = LaunchConfiguration("controller").perform(context)
    return [
        Node(
            package="stickslip_ros",
            executable="monitor",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), *([{"controller": controller}] if controller else [])],
        )
    ]


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory("stickslip_ros"))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params_file",
                default_value=str(share / "config" / "monitor.yaml"),
                description="parameters of the monitor",
            ),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the robot"),
            DeclareLaunchArgument(
                "controller", default_value="", description="node whose gains are followed, e.g. /pid_controller"
            ),
            OpaqueFunction(function=monitor),
        ]
    )
