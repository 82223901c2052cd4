# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The monitor's parameters: declared, checked and read; and an answer to every request to set them.

In rclpy an exception in a callback leaves a request without answer.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType, SetParametersResult
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.messages.gain_parameters import joint_and_kind, why_not_taken
from stickslip_ros.model._validation import require_positive
from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameter_names import EVERY_JOINT, joint_of
from stickslip_ros.settings.parameter_table import (
    COMMON,
    GAIN_UNITS,
    OF_THE_NODE,
    PER_JOINT,
    RECOMMENDED,
    ParameterSpec,
)
from stickslip_ros.settings.parameters import JointSettings, settings_of
from stickslip_ros.visible import visible

_LONGEST_SERVICE = "set_parameters_atomically"  # longest name of a service that is requested of another node
_JOINT_NAME = re.compile(r"[^\s,.]{1,128}")  # dots separate the words of parameter names
_LONGEST_REASON = 500  # length of a reason, characters: it may quote a value of any length

Check = Callable[[list[Parameter]], None]
Changes = Mapping[str, Parameter]


def refuse_by(node: Node, check: Check) -> None:
    """Refuse parameters for which a check raises; the text of the exception is the reason.

    Parameters
    ----------
    check : called with the parameters as they would be. It raises StickSlipError for invalid values.
    """

    def answer(parameters: list[Parameter]) -> SetParametersResult:
        try:
            for parameter in parameters:
                if parameter.type_ == Parameter.Type.NOT_SET and node.has_parameter(parameter.name):
                    raise StickSlipError(f"{parameter.name} cannot be deleted")
            check(parameters)
        except StickSlipError as error:
            return SetParametersResult(successful=False, reason=_printable(str(error)))
        except Exception as error:
            node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)
            return SetParametersResult(successful=False, reason=_printable(f"{type(error).__name__}: {error}"))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(answer)


def follow_by(node: Node, apply: Check) -> None:
    """Apply parameters that were set; an error is logged, because the answer must not wait for it."""

    def followed(parameters: list[Parameter]) -> None:
        try:
            apply(parameters)
        except Exception:
            node.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)

    node.add_post_set_parameters_callback(followed)


def _printable(text: str) -> str:
    """Reason that any message can hold: bounded, and valid UTF-8."""
    return " ".join(text.encode("utf-8", "replace").decode("utf-8").split())[:_LONGEST_REASON]


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
    if len(set(names)) < len(names) or not all(_JOINT_NAME.fullmatch(name) and visible(name) == name for name in names):
        raise InvalidParameterError(
            "joints",
            "[''], or different names of at most 128 visible characters without blanks, commas and dots",
            str(names)[:200],
        )
    return tuple(names)


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


class OwnChange:
    """A context in which the node itself sets parameters that others may not; ``active`` within it."""

    def __init__(self) -> None:
        self.active = False

    def __enter__(self) -> None:
        self.active = True

    def __exit__(self, *_: object) -> None:
        self.active = False


def declare_specs(node: Node, specs: Iterable[ParameterSpec], joint: str = "") -> None:
    """Declare parameters of the table, of one joint where they are a joint's."""
    for spec in specs:
        if node.has_parameter(spec.name.format(joint=joint)):
            continue
        descriptor = ParameterDescriptor(
            description=spec.description, read_only=spec.read_only, dynamic_typing=spec.dynamic_typing
        )
        node.declare_parameter(spec.name.format(joint=joint), spec.default, descriptor)


def declare_joint(node: Node, name: str) -> None:
    """Declare one joint's parameters; a parameter that is not set stays open (NaN or empty)."""
    declare_specs(node, PER_JOINT, name)
    for key in RECOMMENDED:
        if not node.has_parameter(recommended_name(name, key)):
            node.declare_parameter(
                recommended_name(name, key),
                math.nan,
                _recommended_descriptor(node, name, key),
                ignore_override=True,
            )


def recommended_name(name: str, key: str) -> str:
    """Name of the parameter that holds the advice."""
    return f"recommended.{name}.{key}"


def describe_recommended(node: Node, name: str) -> None:
    """Set the present limits in the descriptors of the advice."""
    for key in RECOMMENDED:
        node.set_descriptor(recommended_name(name, key), _recommended_descriptor(node, name, key))


def _recommended_descriptor(node: Node, name: str, key: str) -> ParameterDescriptor:
    least, largest = (node.get_parameter(f"limits.{name}.{key}_{end}").value for end in ("min", "max"))
    # A floating_point_range would forbid nan, which stands for no advice.
    return ParameterDescriptor(
        name=recommended_name(name, key),
        type=ParameterType.PARAMETER_DOUBLE,
        description=f"recommended {RECOMMENDED[key]} [{GAIN_UNITS[key]}]; range {least:g} to {largest:g}; nan: none",
        additional_constraints="written by the monitor alone; set the controller's gains instead",
    )


def set_recommended(node: Node, advised: Mapping[str, Gains | None]) -> None:
    """Set the parameters `recommended.<joint>.p` and `.d` to the advice, where it has changed."""
    changed = []
    for name, gains in advised.items():
        numbers = (math.nan, math.nan) if gains is None else (float(gains.stiffness), float(gains.damping))
        for key, value in zip(RECOMMENDED, numbers, strict=True):
            parameter = recommended_name(name, key)
            old = float(node.get_parameter(parameter).value)
            if old != value and not (math.isnan(old) and math.isnan(value)):
                changed.append(Parameter(parameter, Parameter.Type.DOUBLE, value))
    if changed:
        node.set_parameters(changed)


def read_joint(node: Node, name: str, changes: Changes | None = None) -> JointSettings:
    """Read one joint's parameters, as they would be after the changes.

    Raises
    ------
    StickSlipError
        If they make no joint; the text names the value.
    """
    return settings_of(name, lambda parameter: value_of(node, parameter, changes))


def value_of(node: Node, parameter: str, changes: Changes | None = None) -> Any:
    """Value of a parameter, as it would be after the changes."""
    changed = changes.get(parameter) if changes else None
    return node.get_parameter(parameter).value if changed is None else changed.value
