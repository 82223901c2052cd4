# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joints and gains from YAML files of ROS parameters: the monitor's own, or a controller's."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from stickslip_ros.errors import StickSlipError, reason
from stickslip_ros.messages.gain_parameters import (
    LAYOUT,
    elsewhere_text,
    gains_elsewhere,
    joint_and_kind,
    some,
    why_not_taken,
)
from stickslip_ros.regular_files import read_yaml
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_names import (
    EVERY_JOINT,
    MONITOR,
    SECTION,
    FileSection,
    flat,
    joint_of,
    misnamed_sections,
    nearest_joint,
    sections_of,
    unknown_name,
)
from stickslip_ros.settings.parameter_table import COMMON, PER_JOINT
from stickslip_ros.settings.parameters import JointSettings, settings_of

_NOTHING_READ = f"holds nothing that is read, neither {LAYOUT} of a controller nor parameters of {MONITOR}"


class ParameterFileError(StickSlipError, ValueError):
    """A file of parameters that cannot be used; the text says why."""


@dataclass(frozen=True)
class Parameters:
    """Parameters by name; "*" stands for every joint that has none of its own; else the defaults of the table.

    ``notes`` are sentences on what is in their files and not taken.
    """

    given: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def fingerprint(self) -> str:
        """What settings depend on, joint files included.

        Raises
        ------
        StickSlipError
            If a model cannot be loaded.
        """
        models = {
            value: load_joint(str(value)) for name, value in self.given.items() if name.startswith("model.") and value
        }
        return repr((sorted(self.given.items()), sorted(models.items()), self.notes))

    @staticmethod
    def of_files(paths: Iterable[Path], given: Mapping[str, Any] | None = None) -> Parameters:
        """The parameters in files, the later ones before the earlier, and what is given before all.

        Raises
        ------
        ParameterFileError
            If a file cannot be read, holds no `ros__parameters` or nothing that is read, gives a joint two values of a
            gain, or the monitor's section has a name it does not know.
        """
        found: dict[str, Any] = {}
        notes: list[str] = []
        for path in paths:
            parameters, more = _read(path)
            found |= parameters
            notes += more
        return Parameters(found | dict(given or {}), tuple(notes))

    def misnamed_joints(self, joints: Collection[str]) -> list[str]:
        """What was probably meant for one of these joints and has another name; a file may be for more robots."""
        texts = []
        for name in self.given:
            joint = joint_of(name)
            if joint in ("", EVERY_JOINT, *joints) or not nearest_joint(joint, joints):
                continue
            unknown = unknown_name(name, joints, "which was not recorded")
            texts += [unknown.text] if unknown is not None else []
        return texts

    def unused_gains(self, joints: Collection[str]) -> list[str]:
        """A sentence on gains where they are of none of these joints; a file may be for more robots."""
        named = {found[0] for name in self.given if (found := joint_and_kind(name)) is not None}
        if not named or named & {EVERY_JOINT, *joints}:
            return []
        return [f"the gains in --parameters are not used: they are of {some(sorted(named))}, and none was recorded"]

    def also_of(self, joint: str, other: str) -> Parameters:
        """The same, where what is said of a joint holds for another one too, unless something is said of that."""
        names = {spec.name.format(joint=other): spec.name.format(joint=joint) for spec in PER_JOINT}
        more = {name: self.given[known] for name, known in names.items() if known in self.given}
        return self if joint == other else Parameters(more | dict(self.given))

    def settings_of(self, joint: str) -> JointSettings:
        """What they say of a joint.

        Raises
        ------
        StickSlipError
            If they make no joint; the text names the value.
        """
        values = {spec.name: self.given.get(spec.name, spec.default) for spec in COMMON}
        for spec in PER_JOINT:
            every, own = spec.name.format(joint="*"), spec.name.format(joint=joint)
            values[own] = self.given.get(own, self.given.get(every, spec.default))

        def typed(own: str) -> str:
            every = own.replace(f".{joint}", ".*", 1)
            return every if own not in self.given and every in self.given else own

        return settings_of(joint, values.__getitem__, typed)


def _read(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Parameters of a file, and sentences on what is not taken."""
    try:
        content = read_yaml(path, unique=True)
    except (OSError, ValueError) as error:
        raise ParameterFileError(f"parameter file {path}: {reason(error)}") from error
    sections = sections_of(content)
    if not sections:
        raise ParameterFileError(f"parameter file {path}: {_without_sections(content)}")
    wrong = misnamed_sections(sections, f"/{MONITOR}") + _conflicts(sections)
    found: dict[str, Any] = {}
    notes: list[str] = []
    for section in sections:
        if section.base == MONITOR or (section.of_any_node and section.about_monitors):
            names = [unknown_name(name, None) for name in section.parameters]
            wrong += [one.text for one in names if one is not None]
        found |= _taken(section)
        notes += _notes_on(section)
    if not wrong and not any(map(_is_read, sections)):
        wrong = ["; ".join([_NOTHING_READ, *notes])]
    if wrong:
        raise ParameterFileError(f"parameter file {path}: {'; '.join(wrong)}")
    return found, [f"parameter file {path}: {note}" for note in notes]


def _taken(section: FileSection) -> dict[str, Any]:
    """The parameters of a section without gains that are none of efforts."""
    if not why_not_taken(section.parameters):
        return dict(section.parameters)
    return {name: value for name, value in section.parameters.items() if joint_and_kind(name) is None}


def _is_read(section: FileSection) -> bool:
    """Whether anything in a section counts for a joint."""
    own = section.base == MONITOR or section.about_monitors
    return own or any(joint_and_kind(name) is not None for name in _taken(section))


def _notes_on(section: FileSection) -> list[str]:
    """Sentences on gains in a section that are not taken."""
    notes = []
    refused = sorted(set(section.parameters) - set(_taken(section)))
    if refused:
        notes.append(f"{section.node}: {some(refused)} not taken: {why_not_taken(section.parameters)}")
    other_places = gains_elsewhere(name for name in section.parameters if unknown_name(name, None) is not None)
    if other_places:
        notes.append(f"{section.node}: {elsewhere_text(other_places, section.parameters)}")
    return notes


def _conflicts(sections: Iterable[FileSection]) -> list[str]:
    """Sentences on joints to which sections of different nodes give different gains."""
    first: dict[str, tuple[str, Any]] = {}
    texts = []
    for section in sections:
        # A section of any node holds where its own says nothing else.
        if section.of_any_node:
            continue
        for name, value in _taken(section).items():
            # NaN is not set, and equals nothing.
            if joint_and_kind(name) is None or value != value:
                continue
            node, known = first.setdefault(name, (section.node, value))
            if known != value:
                texts.append(
                    f"{name} is {known} in {node} and {value} in {section.node}: leave one of them out of the file"
                )
    return texts


def _without_sections(content: Any) -> str:
    """Why a file without ``ros__parameters`` is not read."""
    names = [name for name, _ in flat("", content)] if isinstance(content, Mapping) else []
    found = gains_elsewhere(names) or [name for name in names if joint_and_kind(name) is not None]
    text = f"holds no {SECTION}"
    if not found:
        return text
    return f"{text}, which ROS 2 has between the name of a node and its parameters, as {found[0]} (ROS 1 had not)"
