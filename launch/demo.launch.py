# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A simulated joint that sticks and slips, and the monitor beside it.

    ros2 launch stickslip_ros demo.launch.py
    ros2 launch stickslip_ros demo.launch.py stiffness:=2000.0 damping:=30.0 velocity:=0.003

Then `stickslip watch`, or `ros2 param set /simulated_joint gains.joint1.d 95.0`.
"""

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

PARAMETERS = {"velocity": "velocity.joint1", "stiffness": "gains.joint1.p", "damping": "gains.joint1.d"}


def nodes(context: LaunchContext) -> list[Node]:
    """Joint and monitor; what is not given is the model's."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ("model", "namespace", *PARAMETERS)}
    chosen = {parameter: float(given[name]) for name, parameter in PARAMETERS.items() if given[name]}
    model = {"model.joint1": given["model"]}
    share = get_package_share_directory("stickslip_ros")
    return [
        Node(
            package="stickslip_ros",
            executable="simulated_joint",
            namespace=given["namespace"],
            parameters=[{**model, **chosen}],
        ),
        Node(
            package="stickslip_ros",
            executable="monitor",
            namespace=given["namespace"],
            parameters=[f"{share}/config/monitor.yaml", {**model, "controller": "simulated_joint"}],
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "model",
                default_value="puma560_joint1",
                description="simulated joint: a name in config/joints, or the path of a joint file",
            ),
            DeclareLaunchArgument(
                "velocity", default_value="", description="commanded velocity [rad/s], without one that of the joint"
            ),
            DeclareLaunchArgument(
                "stiffness", default_value="", description="stiffness, gain p of the controller [N*m/rad]"
            ),
            DeclareLaunchArgument(
                "damping", default_value="", description="damping, gain d of the controller [N*m*s/rad]"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of the simulated joint and the monitor"
            ),
            OpaqueFunction(function=nodes),
        ]
    )
