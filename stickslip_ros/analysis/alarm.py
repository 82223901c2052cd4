# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Alarms of a fleet: a quantity that has changed by more than a share since the first recording, or passed a bound."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from stickslip_ros.analysis.trend import BEYOND_CHANCE, Measured
from stickslip_ros.errors import InvalidParameterError

# What an alarm may be about: what it is called, and whether it is a share, which is told in per cent.
QUANTITIES = {
    "coulomb": ("Coulomb friction", False),
    "stribeck": ("Stribeck friction", False),
    "viscous": ("viscous friction", False),
    "stick_slip": ("stick-slip", True),
    "reserve": ("damping reserve", True),
}
_FORM = re.compile(r"\s*([a-z_]+)\s*(=\s*[+-]|[<>])\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(%?)\s*")


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """What rings.

    Attributes
    ----------
    quantity : one of :data:`QUANTITIES`. text : as it was typed.
    change : share of the first value by which the latest has to differ, signed; NaN if the alarm has a bound instead.
    above, below : bounds of the latest value; infinite if there is none.
    """

    quantity: str
    text: str
    change: float = math.nan
    above: float = math.inf
    below: float = -math.inf

    def rings(self, first: Measured, latest: Measured) -> str:
        """What is the matter, in words; "" if nothing is.

        A change counts where it is also more than chance makes of both errors, a bound where it is passed by more
        than the value's error.
        """
        name, is_share = QUANTITIES[self.quantity]
        error = math.hypot(*(one.error if one.error > 0.0 else 0.0 for one in (first, latest)))
        differs = latest.value - first.value
        if not math.isnan(self.change):
            threshold = self.change * abs(first.value)
            if abs(differs) < abs(threshold) or differs * self.change <= 0.0 or abs(differs) <= BEYOND_CHANCE * error:
                return ""
            share = f" ({100.0 * differs / abs(first.value):+.0f} %)" if first.value else ""
            return f"{name} {_value_text(first.value, is_share)} → {_value_text(latest.value, is_share)}{share}"
        own = BEYOND_CHANCE * latest.error if latest.error > 0.0 else 0.0
        if latest.value - own > self.above or latest.value + own < self.below:
            return f"{name} {_value_text(latest.value, is_share)}"
        return ""


def _value_text(value: float, is_share: bool) -> str:
    return f"{100.0 * value:.0f} %" if is_share else f"{value:.3g}"


def parse_alarm(text: str) -> Alarm:
    """An alarm as it is typed: ``coulomb=+15%``, ``reserve=-30%``, ``stick_slip>5%``, ``reserve<20%``, ``coulomb>12``.

    Raises
    ------
    InvalidParameterError
        If it is none of these; the text says what would be.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise InvalidParameterError("--alarm", "like coulomb=+15%, reserve=-30% or 'stick_slip>5%'", text)
    name, sign, number, percent = found.groups()
    if name not in QUANTITIES:
        raise InvalidParameterError("--alarm", f"about one of {', '.join(QUANTITIES)}", text)
    try:
        value = float(number) * (0.01 if percent else 1.0)
    except ValueError:
        raise InvalidParameterError("--alarm", "with a number after its sign", text) from None
    if not (math.isfinite(value) and (value > 0.0 or sign in "<>")):
        raise InvalidParameterError("--alarm", "with a finite number above 0", text)
    if sign.startswith("="):
        if not percent:
            raise InvalidParameterError("--alarm", "a change in per cent, like coulomb=+15%", text)
        return Alarm(quantity=name, text=text, change=-value if sign.endswith("-") else value)
    if bool(percent) is not QUANTITIES[name][1]:
        unit = "in per cent" if QUANTITIES[name][1] else "a number in SI units, without %"
        raise InvalidParameterError("--alarm", f"with the bound of {name} {unit}", text)
    return Alarm(quantity=name, text=text, above=value) if sign == ">" else Alarm(quantity=name, text=text, below=value)
