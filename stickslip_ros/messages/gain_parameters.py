# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains in the parameters of controllers, `gains.<joint>.p/.i/.d`: their names, their values, and how they add up."""

from __future__ import annotations

import math
from typing import Any

from stickslip_ros.model.friction import Gains

KINDS = ("p", "i", "d")
_INTEGER, _DOUBLE = 2, 3  # of rcl_interfaces/ParameterType


def gain_name(joint: str, kind: str) -> str:
    """Name of the parameter."""
    return f"gains.{joint}.{kind}"


def joint_and_kind(name: str) -> tuple[str, str] | None:
    """The joint that a parameter is a gain of, and which; None if it is none. Names of joints may have dots."""
    prefix, _, rest = name.partition(".")
    joint, _, kind = rest.rpartition(".")
    return (joint, kind) if prefix == "gains" and kind in KINDS and joint else None


def gain_value(value: Any) -> float:
    """A parameter's value, of rcl_interfaces/ParameterValue, as a finite number; NaN if it is none."""
    if value.type == _DOUBLE and math.isfinite(value.double_value):
        return float(value.double_value)
    return float(value.integer_value) if value.type == _INTEGER else math.nan


class HeardGains:
    """The gains of joints, put together from parameters that come one by one."""

    def __init__(self) -> None:
        self._values: dict[str, dict[str, float]] = {}

    def set(self, joint: str, kind: str, value: float) -> None:
        """Take one that is a finite number."""
        self._values.setdefault(joint, {})[kind] = value

    def of(self, joint: str) -> Gains | None:
        """Those of a joint, None as long as its stiffness is not known; those that are not heard are 0."""
        values = self._values.get(joint, {})
        if "p" not in values:
            return None
        return Gains(stiffness=values["p"], damping=values.get("d", 0.0), integral=values.get("i", 0.0))
