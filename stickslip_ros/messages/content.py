# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What messages mean: states, references and gains of joints, whoever decoded them (rclpy, or a bag's reader)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains


class MessageError(StickSlipError, ValueError):
    """A message that cannot mean anything; the text says what is wrong with it."""


def seconds(stamp: Any) -> float:
    """A stamp as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def joint_rows(message: Any) -> dict[str, tuple[float, float, float]]:
    """Position, velocity and effort of every joint in a message; NaN for what is missing.

    Raises
    ------
    MessageError
        If an array is neither empty nor as long as the names, or a name occurs twice.
    """
    names = message.name
    fields = ("position", "velocity", "effort")
    check_joint_row(names, {field: len(getattr(message, field)) for field in fields})
    columns = [getattr(message, field) for field in fields]
    columns = [values if len(values) else [math.nan] * len(names) for values in columns]
    return dict(zip(names, zip(*columns, strict=True), strict=True))


def check_joint_row(names: Sequence[str], counts: Mapping[str, int]) -> None:
    """Check names, and how many values each field has for them.

    Raises
    ------
    MessageError
        If a field has neither none nor as many, or a name occurs twice.
    """
    for field, count in counts.items():
        if count not in (0, len(names)):
            raise MessageError(f"{field} has {count} values for {len(names)} names; it must have as many or none")
    if len(set(names)) != len(names):
        raise MessageError(f"a joint name occurs twice in {', '.join(names)}")


def gains_from_message(message: Any) -> dict[str, Gains]:
    """Gains of every joint in a `pd_gains` message.

    Raises
    ------
    MessageError
        If the layout is not [joint (names joined by commas), gain ("p,d" or "p,i,d")], or a gain is
        not finite.
    """
    dimensions = message.layout.dim
    if len(dimensions) != 2:
        raise MessageError(f"pd_gains needs layout.dim = [joints, gains], got {len(dimensions)} dimensions")
    joints = [name.strip() for name in dimensions[0].label.split(",")]
    kinds = [name.strip() for name in dimensions[1].label.split(",")]
    if kinds not in (["p", "d"], ["p", "i", "d"]):
        raise MessageError(f"the gains' label must be 'p,d' or 'p,i,d': {dimensions[1].label!r}")
    expected = len(joints) * len(kinds)
    if len(message.data) != expected:
        raise MessageError(
            f"pd_gains needs {expected} values for {len(joints)} joints by {len(kinds)} gains, got {len(message.data)}"
        )
    gains = {}
    for index, joint in enumerate(joints):
        row = dict(zip(kinds, message.data[index * len(kinds) : (index + 1) * len(kinds)], strict=True))
        for kind, value in row.items():
            if not abs(value) < LARGEST:
                raise MessageError(f"gain {kind} of {joint} must be finite and less than {LARGEST:g}: {value}")
        gains[joint] = Gains(stiffness=row["p"], damping=row["d"], integral=row.get("i", 0.0))
    return gains


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
        names = message.joint_names
        # Older definitions have `desired` alone; newer ones have both, of which publishers fill one.
        points = [getattr(message, name) for name in ("reference", "desired") if hasattr(message, name)]
        if not points:
            raise MessageError("it has neither a field reference nor a field desired")
        point = next((point for point in points if len(point.positions)), points[0])
        if len(point.positions) != len(names):
            raise MessageError(f"reference has {len(point.positions)} positions for {len(names)} joints")
        known = len(point.velocities) == len(names)
        velocities = point.velocities if known else [math.nan] * len(names)
        return dict(zip(names, zip(point.positions, velocities, strict=True), strict=True))
    return {name: (position, velocity) for name, (position, velocity, _) in joint_rows(message).items()}
