# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Descriptions of robots (URDF) in bags, as far as they say which joints are prismatic: positions in metres."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from xml.sax.saxutils import quoteattr, unescape

DESCRIPTION = "/robot_description"
TYPE = "std_msgs/msg/String"
# Of a text of others only the joints' own tags are looked at: no parser of XML has to be trusted with it.
_JOINT = re.compile(r"<joint\s([^<>]{1,1000})>")
_ATTRIBUTE = re.compile(r"\b(name|type)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_LARGEST = 10_000_000  # characters
_ENTITIES = {"&quot;": '"', "&apos;": "'"}


def prismatic_joints(text: str) -> set[str]:
    """The names of the prismatic joints in a description."""
    found = set()
    for joint in _JOINT.findall(text[:_LARGEST]):
        attributes = {name: unescape(one or other, _ENTITIES) for name, one, other in _ATTRIBUTE.findall(joint)}
        if attributes.get("type") == "prismatic":
            found.add(attributes.get("name", ""))
    return found


def description(names: Iterable[str], prismatic: Collection[str]) -> str:
    """A description that has no more than the joints and their types."""
    joints = [
        f'<joint name={quoteattr(name)} type="{"prismatic" if name in prismatic else "revolute"}"/>' for name in names
    ]
    return f'<robot name="robot">{"".join(joints)}</robot>'
