# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor's parameters that concern no single joint, and what they make of its options."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.messages.gain_parameters import joint_and_kind, why_not_taken
from stickslip_ros.model._validation import require_positive
from stickslip_ros.nodes.joints.joint_parameters import Changes, declare_specs, value_of
from stickslip_ros.nodes.state.state_file import default_path
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameter_names import EVERY_JOINT, joint_of
from stickslip_ros.settings.parameter_table import COMMON, OF_THE_NODE
from stickslip_ros.visible import visible

_LONGEST_SERVICE = "set_parameters_atomically"  # longest name of a service that is requested of another node
_JOINT_NAME = re.compile(r"[^\s,.]{1,128}")  # dots separate the words of parameter names


def declare(node: Node) -> None:
    """Declare the parameters that concern no single joint."""
    declare_specs(node, (*OF_THE_NODE, *COMMON))


def check(node: Node, changes: Changes | None = None) -> None:
    """Check the parameters as they would be after the changes.

    Raises
    ------
    StickSlipError
        If a value is invalid.
    """
    joint_names(node)
    _check_what_is_given(node, changes)
    require_positive("publish_rate", float(node.get_parameter("publish_rate").value))
    require_positive("apply_rate", float(value_of(node, "apply_rate", changes)))
    controllers(node, changes)


def state_path(node: Node) -> Path | None:
    """Path of the state file, None for no file.

    Raises
    ------
    InvalidParameterError
        If there is a folder or a device of that name, or no file can have it.
    """
    given = str(node.get_parameter("state_file").value)
    if given == "none":
        return None
    try:
        path = Path(given).expanduser() if given else default_path(node.get_fully_qualified_name())
        no_file = path.exists() and not path.is_file()
    except (OSError, RuntimeError, ValueError) as error:
        raise InvalidParameterError("state_file", f"the name of a file ({error})", f"{given[:80]!r}") from error
    if no_file:
        raise InvalidParameterError("state_file", "the name of a regular file, not of a folder or a device", given)
    return path


def controllers(node: Node, changes: Changes | None = None) -> list[str]:
    """Fully qualified names in the parameter `controller`: a name, or a list of names; "" is none.

    Raises
    ------
    InvalidParameterError
        If the value is neither, no node can have the name, or a name occurs twice.
    """
    given = value_of(node, "controller", changes)
    # An empty list in a parameter file has no type, and comes as None.
    words = [given] if isinstance(given, str) else [] if given is None else given
    if not isinstance(words, Sequence) or not all(isinstance(word, str) for word in words):
        raise InvalidParameterError("controller", "the name of a node, or a list of names", given)
    names = []
    for word in (word.strip() for word in words):
        name = word if word.startswith("/") or not word else f"{node.get_namespace().rstrip('/')}/{word}"
        if name:
            _check_name(word, name)
            if name == node.get_fully_qualified_name():
                # A ramp would write the monitor's own parameters, and read them back as the gains in force.
                raise InvalidParameterError("controller", "the name of another node", word)
            names.append(name)
    if len(set(names)) < len(names):
        raise InvalidParameterError("controller", "names of different nodes", list(words))
    return names


def _check_name(word: str, name: str) -> None:
    """Check that a node can have the name that was given as a word."""
    space, _, own = name.rpartition("/")
    try:
        validate_namespace(space or "/")
        validate_node_name(own)
        validate_full_topic_name(f"{name}/{_LONGEST_SERVICE}", is_service=True)
    except NameValidationException as error:
        why = str(error).splitlines()[0].rstrip(":")
        why = why[:1].lower() + why[1:]
        raise InvalidParameterError("controller", f"a name that a node can have ({why})", f"{word[:80]!r}") from error
    except TypeError as error:
        # rclpy refuses a text that is no UTF-8.
        raise InvalidParameterError("controller", "a name that a node can have", ascii(word[:80])) from error


def joint_names(node: Node) -> tuple[str, ...]:
    """The joints to watch; () for every one that is heard of.

    Raises
    ------
    InvalidParameterError
        If no joint can have a name, or a name occurs twice.
    """
    names = list(node.get_parameter("joints").value)
    if names == [""]:
        return ()
    if len(set(names)) < len(names) or not all(_can_be_a_name(name) for name in names):
        raise InvalidParameterError(
            "joints",
            "[''], or different names of at most 128 visible characters without blanks, commas and dots",
            str(names)[:200],
        )
    return tuple(names)


def _can_be_a_name(name: str) -> bool:
    return _JOINT_NAME.fullmatch(name) is not None and visible(name) == name


def _check_what_is_given(node: Node, changes: Changes | None) -> None:
    """Check the values for every joint, and for joints that are not heard of yet: errors are reported now."""
    given = {spec.name: value_of(node, spec.name, changes) for spec in COMMON}
    # A managed node that waits to be configured stays, and reports errors of its joints at configuring.
    if changes is None and node.get_parameter("autostart").value:
        given = {name: value.value for name, value in node._parameter_overrides.items() if joint_of(name)} | given
    _refuse_gains_of_other_commands(node)
    parameters = Parameters(given)
    for joint in sorted({joint_of(name) for name in given}):
        parameters.settings_of(joint or EVERY_JOINT)


def _refuse_gains_of_other_commands(node: Node) -> None:
    """Refuse gains of other commands than efforts: a section of all nodes may be about a controller."""
    given = {name: value.value for name, value in node._parameter_overrides.items()}
    gains = [name for name, value in given.items() if joint_and_kind(name) and value == value]
    reason = why_not_taken(given)
    if gains and reason:
        raise StickSlipError(f"{', '.join(sorted(gains))}: {reason}")
