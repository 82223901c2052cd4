# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor's parameters that concern no single joint, and what they make of its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.joint_settings import COMMON
from stickslip_ros.model._validation import require_positive
from stickslip_ros.nodes.joint_parameters import declare_specs
from stickslip_ros.nodes.state_file import default_path

Changes = Mapping[str, Parameter]


def declare(node: Node) -> None:
    """Declare them."""

    def parameter(name: str, default: object, text: str, **more: bool) -> None:
        node.declare_parameter(name, default, ParameterDescriptor(description=text, **more))

    parameter("joints", [""], "joints to watch; [''] for every joint heard of", read_only=True)
    parameter(
        "controller",
        "",
        "node whose parameters gains.<joint>.p/.i/.d are followed, or a list of such nodes; empty: none",
        dynamic_typing=True,
    )
    parameter(
        "reference_type",
        "JointState",
        "message on joint_references: JointState, or with control_msgs JointTrajectoryControllerState or "
        "MultiDOFStateStamped",
        read_only=True,
    )
    parameter("publish_rate", 25.0, "how often diagnostics and margins are published [Hz]", read_only=True)
    parameter("autostart", True, "whether the node configures and activates itself", read_only=True)
    parameter(
        "state_file",
        "",
        "where what was learnt is kept; empty: in ROS_HOME (~/.ros), by the node's name; none: nowhere",
        read_only=True,
    )
    parameter("allow_apply", False, "whether ~/apply_recommendation may write gains to the controller")
    parameter("apply_rate", 0.3, "relative change of gains a second while they are applied [1/s]")
    declare_specs(node, COMMON)


def _value(node: Node, name: str, changes: Changes | None) -> Any:
    return changes[name].value if changes and name in changes else node.get_parameter(name).value


def check(node: Node, changes: Changes | None = None) -> None:
    """Check what no joint's options hold, as it would be after the changes.

    Raises
    ------
    InvalidParameterError
        If a value cannot be.
    """
    require_positive("publish_rate", float(node.get_parameter("publish_rate").value))
    require_positive("apply_rate", float(_value(node, "apply_rate", changes)))
    controllers(node, changes)


def state_path(node: Node) -> Path | None:
    """The file that what was learnt is kept in, None for none.

    Raises
    ------
    InvalidParameterError
        If it is a folder.
    """
    given = str(node.get_parameter("state_file").value)
    if given == "none":
        return None
    path = Path(given).expanduser() if given else default_path(node.get_fully_qualified_name())
    if path.is_dir():
        raise InvalidParameterError("state_file", "the name of a file, not of a folder", given)
    return path


def controllers(node: Node, changes: Changes | None = None) -> list[str]:
    """Fully qualified names in the parameter `controller`: a name, or a list of names; "" is none.

    Raises
    ------
    InvalidParameterError
        If it is neither.
    """
    value = _value(node, "controller", changes)
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, Sequence) or not all(isinstance(name, str) for name in value):
        raise InvalidParameterError("controller", "the name of a node, or a list of names", value)
    names = [name.strip() for name in value]
    return [name if name.startswith("/") else f"{node.get_namespace().rstrip('/')}/{name}" for name in names if name]
