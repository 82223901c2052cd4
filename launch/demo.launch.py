# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A simulated joint that sticks and slips, and the monitor beside it."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    share = Path(get_package_share_directory("stickslip_ros"))
    return LaunchDescription(
        [
            Node(package="stickslip_ros", executable="simulated_joint"),
            Node(
                package="stickslip_ros",
                executable="monitor",
                parameters=[str(share / "config" / "monitor.yaml"), {"controller": "/simulated_joint"}],
            ),
        ]
    )
