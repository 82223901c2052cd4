# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Content of decoded messages, live or recorded: stamps, states, references and gains of joints, prismatic joints."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable
from typing import Any
from xml.sax.saxutils import quoteattr, unescape

import numpy as np

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.blocks import FloatArray
from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains

DESCRIPTION = "/robot_description"
DESCRIPTION_TYPE = "std_msgs/msg/String"
# Tags of joints in a URDF, by regular expressions: no parser of XML is trusted with a text of others.
_JOINT = re.compile(r"<joint\s([^<>]{1,1000})>")
_ATTRIBUTE = re.compile(r"\b(name|type)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_LONGEST_DESCRIPTION = 10_000_000  # characters of a URDF that are read: bounds the time
_ENTITIES = {"&quot;": '"', "&apos;": "'"}


class MessageError(StickSlipError, ValueError):
    """A message that cannot mean anything; the text says what is wrong with it."""


def seconds(stamp: Any) -> float:
    """A stamp as seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def with_times(stamps: FloatArray, others: FloatArray, what: str, refuse: Callable[[str, int], None]) -> FloatArray:
    """Stamps [s]; the other times where a stamp is zero, which means that nobody set it.

    Parameters
    ----------
    what : name of the other times' event, for people. refuse : called with the reason and the number of unset stamps.
    """
    unset = stamps == 0.0
    if not unset.any():
        return stamps
    refuse(f"stamp is zero; the time of {what} is used instead", int(unset.sum()))
    return np.where(unset, others, stamps)


def with_time(stamp: float, other: float, what: str, refuse: Callable[[str, int], None]) -> float:
    """One stamp [s], or the other time; see :func:`with_times`."""
    return float(with_times(np.array([stamp]), np.array([other]), what, refuse)[0])


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
    """Desired position and velocity of every joint in the state of a controller; NaN for what is missing.

    Raises
    ------
    MessageError
        If its arrays do not fit its names.
    """
    if hasattr(message, "dof_states"):
        return {state.name: (state.reference, math.nan) for state in message.dof_states}
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


def prismatic_joints(text: str) -> set[str]:
    """Names of the prismatic joints in a robot's description (URDF): their positions are in metres."""
    found = set()
    for joint in _JOINT.findall(text[:_LONGEST_DESCRIPTION]):
        attributes = {name: unescape(one or other, _ENTITIES) for name, one, other in _ATTRIBUTE.findall(joint)}
        if attributes.get("type") == "prismatic":
            found.add(attributes.get("name", ""))
    return found


def robot_description(names: Iterable[str], prismatic: Collection[str]) -> str:
    """Description of a robot (URDF) with no more than the joints and their types."""
    joints = [
        f'<joint name={quoteattr(name)} type="{"prismatic" if name in prismatic else "revolute"}"/>' for name in names
    ]
    return f'<robot name="robot">{"".join(joints)}</robot>'
