# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The per-joint parameters of the monitor, and those of the others that bear on how joints are judged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.parameter_table import GAIN_UNITS, PER_JOINT, RECOMMENDED, ParameterSpec
from stickslip_ros.settings.parameters import JointSettings, settings_of

Changes = Mapping[str, Parameter]


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


def declare(node: Node, name: str) -> None:
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


def read(node: Node, name: str, changes: Changes | None = None) -> JointSettings:
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
