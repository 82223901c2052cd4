# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The kinds of message that a desired motion comes in."""

from __future__ import annotations

import math
from importlib import import_module
from typing import Any

from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.nodes.conversion import MessageError, joint_rows

_CONTROL_TYPES = ("JointTrajectoryControllerState", "MultiDOFStateStamped")


def reference_message_type(name: str) -> type:
    """The message class of a reference type.

    Raises
    ------
    StickSlipError
        If there is no such type, or control_msgs is needed and not installed.
    """
    if name == "JointState":
        return JointState  # type: ignore[no-any-return]
    if name not in _CONTROL_TYPES:
        raise InvalidParameterError("reference_type", f"one of JointState, {', '.join(_CONTROL_TYPES)}", name)
    try:
        return getattr(import_module("control_msgs.msg"), name)  # type: ignore[no-any-return]
    except ImportError as error:
        raise StickSlipError(f"reference_type {name} needs the package control_msgs: {error}") from error


def reference_rows(message: Any) -> dict[str, tuple[float, float]]:
    """Desired position and velocity of every joint in a message of any of the kinds; NaN for what is missing.

    Raises
    ------
    MessageError
        If its arrays do not fit its names.
    """
    if hasattr(message, "dof_states"):
        return {state.name: (state.reference, math.nan) for state in message.dof_states}
    if hasattr(message, "joint_names"):
        names, point = message.joint_names, message.reference
        if len(point.positions) != len(names):
            raise MessageError(f"reference has {len(point.positions)} positions for {len(names)} joints")
        known = len(point.velocities) == len(names)
        velocities = point.velocities if known else [math.nan] * len(names)
        return dict(zip(names, zip(point.positions, velocities, strict=True), strict=True))
    return {name: (position, velocity) for name, (position, velocity, _) in joint_rows(message).items()}
