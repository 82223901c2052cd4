# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains in the parameters of controllers, `gains.<joint>.p/.i/.d`: their names, their values, how they add up; and
those that are not taken: under other names, or of a controller that commands no effort.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains
from stickslip_ros.visible import listed, visible

KINDS = ("p", "i", "d")
_EQUAL, _NOTHING = 1e-9, 1e-12
_NUMBERS = {2: "integer_value", 3: "double_value"}  # fields of ParameterValue, by rcl_interfaces/ParameterType
INTERFACES = ("command_interfaces", "command_interface")  # of joint_trajectory_controller, of pid_controller
LAYOUT = "gains.<joint>.p, .i and .d"
_JOINTS = ("joints", "joint_names", "dof_names")  # names that controllers have for the list of their joints
_UNITS = {"position": "1", "velocity": "1/s", "acceleration": "1/s²"}  # a command of this kind over a position error
_GAIN = re.compile(r"[pid]|k_?([a-z]+_)?[pidv]|([a-z]+_)?(gains?|stiffness|damping|pid)")  # the last word of a name
_NAMED, _LONGEST = 6, 80  # names that are listed, and characters of each
_TEXT, _TEXTS = 4, 9  # of rcl_interfaces/ParameterType


def gain_name(joint: str, kind: str) -> str:
    """Name of the parameter."""
    return f"gains.{joint}.{kind}"


def joint_and_kind(name: str) -> tuple[str, str] | None:
    """The joint that a parameter is a gain of, and which; None if it is none. Names of joints may have dots."""
    prefix, _, rest = name.partition(".")
    joint, _, kind = rest.rpartition(".")
    return (joint, kind) if prefix == "gains" and kind in KINDS and joint else None


def gain_value(value: Any) -> float:
    """A parameter's value, of rcl_interfaces/ParameterValue, as a number that a gain can be; NaN if it is none."""
    if value.type not in _NUMBERS:
        return math.nan
    found = float(getattr(value, _NUMBERS[value.type]))
    return found if abs(found) < LARGEST else math.nan


@dataclass(frozen=True)
class GainPair:
    """What a ramp changes, in the controller's units: the gains p and d."""

    p: float
    d: float

    @classmethod
    def from_si(cls, gains: Gains, scale: float) -> GainPair:
        """Those of gains in SI units; one of the controller's units is ``scale`` of these."""
        return cls(float(gains.stiffness) / scale, float(gains.damping) / scale)

    def to_si(self, scale: float) -> Gains:
        """As gains in SI units."""
        return Gains(stiffness=scale * self.p, damping=scale * self.d)

    def same(self, other: GainPair) -> bool:
        """Whether both are equal but for rounding."""
        return not self.changes(other)

    def changes(self, to: GainPair) -> dict[str, float]:
        """What has to be set, of "p" and "d", to make ``to`` of these."""
        return {kind: new for kind, new in to.values().items() if not _same(self.values()[kind], new)}

    def values(self) -> dict[str, float]:
        """By their letters."""
        return {"p": self.p, "d": self.d}

    def with_values(self, values: Mapping[str, float]) -> GainPair:
        """The same with some of them changed."""
        return GainPair(**{**self.values(), **values})

    def between(self, one: GainPair, other: GainPair) -> bool:
        """Whether either gain is between those of two others."""
        ends = zip(self.values().values(), one.values().values(), other.values().values(), strict=True)
        return all(min(a, b) <= value <= max(a, b) or _same(value, a) or _same(value, b) for value, a, b in ends)

    def __str__(self) -> str:
        return f"p {self.p:.6g}, d {self.d:.6g}"


def _same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=_EQUAL, abs_tol=_NOTHING)


class HeardGains:
    """The gains of a node's joints, put together from parameters that come one by one.

    ``refusal`` says why they are none of efforts, "" if they may be.
    """

    def __init__(self) -> None:
        self._values: dict[str, dict[str, float]] = {}
        self.refusal = ""

    def set(self, joint: str, kind: str, value: float) -> None:
        """Take one that is a finite number."""
        self._values.setdefault(joint, {})[kind] = value

    def forget(self) -> list[str]:
        """Forget all; returns the joints whose gains were known."""
        known = [joint for joint, values in self._values.items() if "p" in values]
        self._values.clear()
        self.refusal = ""
        return known

    def of(self, joint: str) -> Gains | None:
        """Those of a joint, None as long as its stiffness is not known, or if they are refused; those that are not
        heard are 0.
        """
        values = self._values.get(joint, {})
        if "p" not in values or self.refusal:
            return None
        return Gains(stiffness=values["p"], damping=values.get("d", 0.0), integral=values.get("i", 0.0))


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
