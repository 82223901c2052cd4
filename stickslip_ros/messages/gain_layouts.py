# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains among a node's parameters that are not taken: under other names, or of a controller that commands no effort."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from stickslip_ros.messages.gain_parameters import joint_and_kind
from stickslip_ros.visible import listed, visible

INTERFACES = ("command_interfaces", "command_interface")  # of joint_trajectory_controller, of pid_controller
LAYOUT = "gains.<joint>.p, .i and .d"
_JOINTS = ("joints", "joint_names", "dof_names")  # names that controllers have for the list of their joints
_UNITS = {"position": "1", "velocity": "1/s", "acceleration": "1/s²"}  # a command of this kind over a position error
_GAIN = re.compile(r"[pid]|k_?([a-z]+_)?[pidv]|([a-z]+_)?(gains?|stiffness|damping|pid)")  # the last word of a name
_NAMED, _LONGEST = 6, 80  # names that are listed, and characters of each
_TEXT, _TEXTS = 4, 9  # of rcl_interfaces/ParameterType


def texts_in(value: Any) -> list[str]:
    """The texts in a parameter's value, of rcl_interfaces/ParameterValue or as Python has it; [] if it has none."""
    if hasattr(value, "string_array_value"):
        value = {_TEXT: [value.string_value], _TEXTS: value.string_array_value}.get(value.type, ())
    found = [value] if isinstance(value, str) else list(value) if isinstance(value, (list, tuple)) else []
    return [text for text in found if isinstance(text, str)]


def why_not_taken(parameters: Mapping[str, Any]) -> str:
    """Why gains beside these parameters are none of efforts, "" where nothing speaks against that.

    Parameters
    ----------
    parameters : by name, those of :data:`INTERFACES` among them.
    """
    for name in INTERFACES:
        # pid_controller may name the joint too, as in shoulder/velocity.
        kinds = [text.rpartition("/")[2] for text in texts_in(parameters.get(name))]
        if kinds and all(kind in _UNITS for kind in kinds):
            units = ", ".join(dict.fromkeys(_UNITS[kind] for kind in kinds))
            return (
                f"{name} is {', '.join(kinds)}: gains beside it have the unit {units}, not N·m/rad; "
                "only those of a controller that commands effort are stiffness and damping"
            )
    return ""


def gains_elsewhere(names: Iterable[str]) -> list[str]:
    """Parameters that look like gains and are not where gains are read from."""
    return [name for name in names if joint_and_kind(name) is None and _GAIN.fullmatch(name.rpartition(".")[2].lower())]


def elsewhere_text(names: Collection[str], parameters: Mapping[str, Any] | None = None) -> str:
    """What there is to say of such parameters, with what would be right.

    Parameters
    ----------
    names : of :func:`gains_elsewhere`. parameters : those of the node with their values, where they are known.
    """
    texts = [_with_size(name, parameters or {}) for name in names]
    verb = "looks like a gain" if len(names) == 1 else "look like gains"
    return f"{some(texts)} {verb}, and {LAYOUT} are read{_example(names, parameters or {})}"


def some(names: Sequence[str]) -> str:
    """The first few names of others, for a sentence."""
    return listed([visible(name[:_LONGEST]) for name in names], _NAMED)


def _with_size(name: str, parameters: Mapping[str, Any]) -> str:
    value = parameters.get(name)
    return f"{name} (a list of {len(value)})" if isinstance(value, (list, tuple)) else name


def _example(names: Iterable[str], parameters: Mapping[str, Any]) -> str:
    """The first stiffness of a list beside a list of joints, as it would be read."""
    joints = next((found for key in _JOINTS if (found := texts_in(parameters.get(key)))), [])
    for name in names:
        value = parameters.get(name)
        if name.lower().endswith("p") and isinstance(value, (list, tuple)) and 0 < len(value) == len(joints):
            return f", as in gains.{joints[0]}.p: {value[0]}"
    return ""
