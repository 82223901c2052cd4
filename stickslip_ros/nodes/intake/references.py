# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The kinds of message that a desired motion comes in."""

from __future__ import annotations

from importlib import import_module

from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError, StickSlipError

_CONTROL_TYPES = ("JointTrajectoryControllerState", "MultiDOFStateStamped")
# What the graph calls them, and what the parameter does.
REFERENCE_TYPES = {
    "sensor_msgs/msg/JointState": "JointState",
    **{f"control_msgs/msg/{name}": name for name in _CONTROL_TYPES},
}


def reference_type_name(name: str) -> str:
    """What the graph calls a reference type."""
    return next(full for full, word in REFERENCE_TYPES.items() if word == name)


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
