# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains in the parameters of controllers, `gains.<joint>.p/.i/.d`: their names, their values, and how they add up."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains

KINDS = ("p", "i", "d")
_EQUAL, _NOTHING = 1e-9, 1e-12
_NUMBERS = {2: "integer_value", 3: "double_value"}  # fields of ParameterValue, by rcl_interfaces/ParameterType


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
