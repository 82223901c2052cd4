# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A recording, and the monitor that watches it; ends when the recording does.

    ros2 launch stickslip_ros replay.launch.py recording:=/path/of/arm.mcap time_factor:=5.0

The recording is a bag, a table with time_s and position_rad, or the name of a known recording (slider). For the
whole answer in seconds: `stickslip analyze`.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def nodes(context: LaunchContext) -> list[Node | RegisterEventHandler]:
    """Replay and monitor, in a namespace of their own: the robot may be running."""
    names = ("recording", "states", "time_factor", "namespace", "params_file")
    given = {name: LaunchConfiguration(name).perform(context) for name in names}
    replay = Node(
        package="stickslip_ros",
        executable="replay",
        namespace=given["namespace"],
        parameters=[
            {
                "recording": given["recording"],
                "states": given["states"],
                "time_factor": float(given["time_factor"]),
            }
        ],
    )
    monitor = Node(
        package="stickslip_ros",
        executable="monitor",
        namespace=given["namespace"],
        # Every joint of the recording; what is learnt from it is not this robot's.
        parameters=[*filter(None, [given["params_file"]]), {"joints": [""], "state_file": "none"}],
    )
    at_the_end = OnProcessExit(target_action=replay, on_exit=[EmitEvent(event=Shutdown(reason="the recording ended"))])
    return [monitor, replay, RegisterEventHandler(at_the_end)]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            DeclareLaunchArgument("recording", description="path of a bag or table, or the name of a known recording"),
            DeclareLaunchArgument(
                "states", default_value="", description="topic of the joint states, if the bag has several"
            ),
            DeclareLaunchArgument(
                "time_factor", default_value="1.0", description="speed of the replay: recorded seconds per second"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="replay", description="namespace of the replay and the monitor"
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="path of a parameter file of the monitor, e.g. with gains of the recorded joints",
            ),
            OpaqueFunction(function=nodes),
        ]
    )
