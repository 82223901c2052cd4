# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Which names of parameters and of sections the monitor understands, and what was meant by the others."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from stickslip_ros.messages.gain_parameters import LAYOUT, gains_elsewhere
from stickslip_ros.settings.parameter_table import COMMON, OF_THE_NODE, PER_JOINT, RECOMMENDED

MONITOR = "stickslip_monitor"
SECTION = "ros__parameters"
EVERY_JOINT = "*"
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_QOS = "qos_overrides."
_CONTROLLERS = (*_OF_EVERY_NODE, _QOS, "gains.", "joints", "controller")  # names that a monitor shares with them
_OUR_NODES = (MONITOR, "simulated_joint", "replay")
_SAID_FOR_IT = ("monitor", "stickslip", "stickslip_ros")  # names of the executable and the package
_SAME_NODE = 0.85  # of difflib's ratio
_WHOLE = frozenset((*_OF_EVERY_NODE, *(spec.name for spec in (*OF_THE_NODE, *COMMON))))
_ADVICE = tuple(f"recommended.{{joint}}.{key}" for key in RECOMMENDED)
_TEMPLATES = (*(spec.name for spec in PER_JOINT), *_ADVICE)
_ALIKE = 0.7  # of difflib's ratio


@dataclass(frozen=True)
class UnknownName:
    """A parameter that means nothing here. ``joint`` : that it would be of, "" if it is the name that is wrong."""

    name: str
    text: str
    joint: str = ""


def joint_of(name: str) -> str:
    """The joint that a parameter is about, "" if it is a joint's in no form that there is."""
    for template in _TEMPLATES:
        before, _, after = template.partition("{joint}")
        middle = name[len(before) : len(name) - len(after)]
        if middle and name == f"{before}{middle}{after}":
            return middle
    return ""


def unknown_name(name: str, joints: Collection[str] | None, where: str = "which is not watched") -> UnknownName | None:
    """What is wrong with the name of a parameter, None if nothing is.

    Parameters
    ----------
    joints : names of those there are, None where any may be. where : what is the case with a joint of another name.
    """
    if name in _WHOLE or name.startswith(_QOS):
        return None
    joint = joint_of(name)
    if joint and name.startswith("recommended."):
        return UnknownName(name, f"{name!r} is the monitor's advice and cannot be set")
    if joint:
        if joints is None or joint in joints:
            return None
        return UnknownName(
            name, f"{name!r} names the joint {joint!r}, {where}{did_you_mean(nearest_joint(joint, joints))}", joint
        )
    # Words of the name may be the joint's: the rest can be told from those.
    words = {word for word in name.split(".")[1:2] if word} | set(joints or ())
    known = _WHOLE | {spec.name.format(joint=word) for spec in PER_JOINT for word in words}
    meant = did_you_mean(nearest_name(name, known)) or (
        f"; of gains, {LAYOUT} are read" if gains_elsewhere([name]) else ""
    )
    return UnknownName(name, f"parameter {name!r} is not known{meant}")


def nearest_joint(joint: str, joints: Iterable[str]) -> str:
    """The joint that was probably meant, "" if none is alike: joint7 is no slip of the pen for joint1."""
    return nearest_name(joint, (one for one in joints if _digits(one) == _digits(joint)))


def _digits(name: str) -> str:
    return "".join(letter for letter in name if letter.isdigit())


@dataclass(frozen=True)
class FileSection:
    """A section of a parameter file: the node that it is for, fully qualified or with wildcards, and what it sets."""

    node: str
    parameters: Mapping[str, Any]

    @property
    def base(self) -> str:
        """The node's name without its namespace."""
        return self.node.rpartition("/")[2]

    @property
    def of_any_node(self) -> bool:
        """Whether it is for nodes of every name."""
        return self.base in ("*", "**")

    @property
    def about_monitors(self) -> bool:
        """Whether something in it is a monitor's alone: a section of any node may be about others altogether."""
        return any(unknown_name(name, None) is None and not name.startswith(_CONTROLLERS) for name in self.parameters)

    def is_for(self, node: str) -> bool:
        """Whether a node of this fully qualified name gets it, by ROS's rules: * one word, ** any number."""
        return _matches(self.node.strip("/").split("/"), node.strip("/").split("/"))


def sections_of(content: Any) -> list[FileSection]:
    """The sections of a parameter file's content, parameters flat."""
    return [FileSection(node or "/**", dict(flat("", found))) for node, found in _sections("", content)]


def misnamed_sections(sections: Iterable[FileSection], node: str) -> list[str]:
    """What is wrong with sections that were probably meant for a node, and are not.

    Parameters
    ----------
    node : fully qualified name of the node.
    """
    found, others = list(sections), []
    name = node.rpartition("/")[2]
    served = any(section.is_for(node) for section in found)
    for section in found:
        if section.is_for(node) or section.of_any_node:
            continue
        base = section.base
        if base == name and not served:
            others.append(f"section {section.node!r} is not for this node, which is {node!r}")
        # A further monitor may have this one's name with something behind it.
        elif base not in _OUR_NODES and not base.startswith(name) and (
            nearest_name(base, (name, MONITOR), _SAME_NODE) or (base in _SAID_FOR_IT and not served)
        ):  # fmt: skip
            others.append(f"section {section.node.strip('/')!r} is of no node that is known; did you mean {name!r}?")
    return others


def _matches(pattern: list[str], words: list[str]) -> bool:
    if not pattern:
        return not words
    if pattern[0] == "**":
        return any(_matches(pattern[1:], words[skipped:]) for skipped in range(len(words) + 1))
    return bool(words) and pattern[0] in ("*", words[0]) and _matches(pattern[1:], words[1:])


def _sections(node: str, content: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(content, Mapping):
        for key, value in content.items():
            if key == SECTION:
                yield node, value
            else:
                yield from _sections(f"{node}/{key}".replace("//", "/"), value)


def flat(prefix: str, content: Any) -> Iterable[tuple[str, Any]]:
    """Nested parameters as names with dots, and their values."""
    if isinstance(content, Mapping):
        for key, value in content.items():
            yield from flat(f"{prefix}.{key}" if prefix else str(key), value)
    elif prefix:
        yield prefix, content


def nearest_name(name: str, known: Iterable[str], similarity: float = _ALIKE) -> str:
    """The known name that is most like another, "" if none is alike.

    Parameters
    ----------
    similarity : the least one as of :class:`difflib.SequenceMatcher`, 0 to 1.
    """
    found = get_close_matches(name, sorted(set(known) - {name}), n=1, cutoff=similarity)
    return found[0] if found else ""


def did_you_mean(near: str) -> str:
    """What to add to a sentence about a name that is not known: the nearest one; "" if that is ""."""
    return f"; did you mean {near!r}?" if near else ""
