# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains from recorded parameter events: the changes of `gains.<joint>.p/.i/.d` of one controller or several."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from stickslip_ros.model.friction import Gains

_KINDS = ("p", "i", "d")
_INTEGER, _DOUBLE = 2, 3  # of rcl_interfaces/ParameterType


class GainEvents:
    """Puts gains together from events, which hold only what changed.

    Parameters
    ----------
    controller : the node whose events count; None for every node, of which the first that has gains of a joint counts.

    ``refused`` counts what was left out, and why.
    """

    def __init__(self, controller: str | None) -> None:
        self._controller = controller
        self._values: dict[str, dict[str, float]] = {}
        self._owner: dict[str, str] = {}
        self.refused: Counter[str] = Counter()

    def take(self, event: Any) -> dict[str, Gains]:
        """The gains of the joints that an event changes and whose stiffness is known by now."""
        node = str(event.node)
        if self._controller is not None and node != self._controller:
            return {}
        changed = []
        for parameter in (*event.new_parameters, *event.changed_parameters):
            prefix, _, rest = str(parameter.name).partition(".")
            joint, _, kind = rest.rpartition(".")
            if prefix != "gains" or kind not in _KINDS or not joint:
                continue
            owner = self._owner.setdefault(joint, node)
            if owner != node:
                self.refused[f"{node} has gains of {joint} too; those of {owner} count (choose with --controller)"] += 1
                continue
            number = _number(parameter.value)
            if math.isfinite(number):
                self._values.setdefault(joint, {})[kind] = number
                changed.append(joint)
        return {
            joint: Gains(stiffness=values["p"], damping=values.get("d", 0.0), integral=values.get("i", 0.0))
            for joint in dict.fromkeys(changed)
            if "p" in (values := self._values[joint])
        }


def _number(value: Any) -> float:
    if value.type == _DOUBLE:
        return float(value.double_value)
    return float(value.integer_value) if value.type == _INTEGER else math.nan
