# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Parameters that were given to the node and are unknown to it, logged once with the nearest known name."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from rclpy.node import Node

from stickslip_ros.errors import reason
from stickslip_ros.messages.gain_layouts import gains_elsewhere
from stickslip_ros.regular_files import read_yaml
from stickslip_ros.settings.nearest_name import did_you_mean, nearest_name
from stickslip_ros.settings.parameter_names import (
    FileSection,
    UnknownName,
    misnamed_sections,
    sections_of,
    unknown_name,
)

_FILE = "--params-file"
_PATIENCE = 5.0  # time until a joint is heard for the first time, s: its parameters are unknown only after it
_QOS = "qos_overrides."
_NEARLY = 0.85  # similarity of a name in a section of all nodes, 1: a less similar name is another node's
_LEAST_LETTERS = 6  # length of such a name, letters: shorter names are similar by chance


class UnknownParameters:
    """Unknown parameters of the node.

    Parameters
    ----------
    arguments : arguments of the process, as ROS has them; None for its own.

    ``texts`` has a sentence for every parameter that is unknown now.
    """

    def __init__(self, node: Node, arguments: Sequence[str] | None = None) -> None:
        self._node = node
        given = sys.argv if arguments is None else arguments
        self._sections = list(_given_sections(given))
        self._in_files = misnamed_sections(self._sections, node.get_fully_qualified_name())
        self._in_files += [
            text for option, path in _given(given) if option == _FILE for text in _repeated_in(Path(path))
        ]
        self._logged: set[str] = set()
        self._unheard: set[str] = set()  # joints of unknown parameters, "" for none
        self._began = math.nan
        self._seen: object = None
        self.texts: list[str] = []

    def poll(self, joints: Collection[str], now: float, *, others_may_come: bool) -> None:
        """Compare the given parameters with the known ones; ``now`` is a steady time [s].

        Parameters
        ----------
        joints : watched joints. others_may_come : whether more joints are watched once they are heard.
        """
        if math.isnan(self._began):
            self._began = now
        waiting = others_may_come and now - self._began < _PATIENCE
        seen = (frozenset(joints), waiting)
        if seen == self._seen:
            return
        self._seen = seen
        where = "which has not been heard of yet" if others_may_come else "which is not watched"
        unknown = [one for one in self._unknown(joints, where) if not (waiting and one.joint)]
        self.texts = [*self._in_files, *(one.text for one in unknown)]
        for text in self.texts:
            if text not in self._logged:
                self._logged.add(text)
                self._node.get_logger().warning(text)
        for joint in sorted(self._unheard.intersection(joints)):
            self._node.get_logger().info(f"the joint {joint!r} is heard now, and its parameters count")
        self._unheard = self._unheard.difference(joints) | {one.joint for one in unknown}

    def _unknown(self, joints: Collection[str], where: str) -> Iterator[UnknownName]:
        for name in sorted(self._node._parameter_overrides):
            if name.startswith(_QOS):
                known = [f"{_QOS}{key}" for key in self._node.get_parameters_by_prefix(_QOS.rstrip("."))]
                found = None if name in known else UnknownName(
                    name, f"parameter {name!r} is not known{did_you_mean(name, known)}"
                )  # fmt: skip
            elif self._node.has_parameter(name) and not name.startswith("recommended."):
                found = None
            else:
                found = unknown_name(name, joints, where)
            if found is not None and self._meant_for_this_node(found):
                yield found

    def _meant_for_this_node(self, found: UnknownName) -> bool:
        """Whether a name is meant for the monitor: a section of all nodes may be about others."""
        own = self._node.get_fully_qualified_name()
        homes = [one for one in self._sections if found.name in one.parameters and one.is_for(own)]
        if not homes or any(not one.of_any_node or one.about_monitors for one in homes):
            return True
        known = list(self._node._parameters)
        if gains_elsewhere([found.name]):
            return True
        return len(found.name) >= _LEAST_LETTERS and bool(nearest_name(found.name, known, _NEARLY))


def _given(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Options among ROS's arguments, each with the word that follows."""
    ours, words = False, list(arguments)
    for word, behind in zip(words, [*words[1:], ""], strict=True):
        if word == "--ros-args":
            ours = True
        elif word == "--":
            ours = False
        elif ours and behind:
            yield word, behind


def _given_sections(arguments: Sequence[str]) -> Iterator[FileSection]:
    """Sections of --params-file and -p node:name:=value, among ROS's arguments."""
    for option, value in _given(arguments):
        if option == _FILE:
            yield from _sections_in(Path(value))
        elif option in ("-p", "--param"):
            node, colon, parameter = value.partition(":=")[0].rpartition(":")
            if colon:
                yield FileSection(f"/{node.lstrip('/')}", {parameter: None})


def _sections_in(path: Path) -> list[FileSection]:
    try:
        return sections_of(read_yaml(path))
    except (OSError, ValueError, RecursionError):
        # rcl has read the file, and reports what is wrong with it.
        return []


def _repeated_in(path: Path) -> list[str]:
    """Sentence on a key that occurs twice in a file that can be read: one value counts, and the other is lost."""
    try:
        read_yaml(path)
    except (OSError, ValueError, RecursionError):
        return []
    try:
        read_yaml(path, unique=True)
    except ValueError as error:
        return [f"parameter file {path}: {reason(error)}"]
    return []
