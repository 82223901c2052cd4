# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains of controllers in parameter files: those that are taken, and sentences on the others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from stickslip_ros.messages.gain_layouts import LAYOUT, elsewhere_text, gains_elsewhere, some, why_not_taken
from stickslip_ros.messages.gain_parameters import joint_and_kind
from stickslip_ros.settings.parameter_names import MONITOR, SECTION, FileSection, flat, unknown_name

NOTHING_READ = f"holds nothing that is read, neither {LAYOUT} of a controller nor parameters of {MONITOR}"


def taken(section: FileSection) -> dict[str, Any]:
    """The parameters of a section without gains that are none of efforts."""
    if not why_not_taken(section.parameters):
        return dict(section.parameters)
    return {name: value for name, value in section.parameters.items() if joint_and_kind(name) is None}


def is_read(section: FileSection) -> bool:
    """Whether anything in a section counts for a joint."""
    own = section.base == MONITOR or section.about_monitors
    return own or any(joint_and_kind(name) is not None for name in taken(section))


def notes_on(section: FileSection) -> list[str]:
    """Sentences on gains in a section that are not taken."""
    notes = []
    refused = sorted(set(section.parameters) - set(taken(section)))
    if refused:
        notes.append(f"{section.node}: {some(refused)} not taken: {why_not_taken(section.parameters)}")
    other_places = gains_elsewhere(name for name in section.parameters if unknown_name(name, None) is not None)
    if other_places:
        notes.append(f"{section.node}: {elsewhere_text(other_places, section.parameters)}")
    return notes


def conflicts(sections: Iterable[FileSection]) -> list[str]:
    """Sentences on joints to which sections of different nodes give different gains."""
    first: dict[str, tuple[str, Any]] = {}
    texts = []
    for section in sections:
        # A section of any node holds where its own says nothing else.
        if section.of_any_node:
            continue
        for name, value in taken(section).items():
            # NaN is not set, and equals nothing.
            if joint_and_kind(name) is None or value != value:
                continue
            node, known = first.setdefault(name, (section.node, value))
            if known != value:
                texts.append(
                    f"{name} is {known} in {node} and {value} in {section.node}: leave one of them out of the file"
                )
    return texts


def without_sections(content: Any) -> str:
    """Why a file without ``ros__parameters`` is not read."""
    names = [name for name, _ in flat("", content)] if isinstance(content, Mapping) else []
    found = gains_elsewhere(names) or [name for name in names if joint_and_kind(name) is not None]
    text = f"holds no {SECTION}"
    if not found:
        return text
    return f"{text}, which ROS 2 has between the name of a node and its parameters, as {found[0]} (ROS 1 had not)"
