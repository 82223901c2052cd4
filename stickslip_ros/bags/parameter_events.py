# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains from recorded parameter events: the changes of `gains.<joint>.p/.i/.d` of one controller or several."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from stickslip_ros.messages.gain_parameters import HeardGains, gain_value, joint_and_kind
from stickslip_ros.model.friction import Gains


class GainEvents:
    """Puts gains together from events, which hold only what changed.

    Parameters
    ----------
    controller : the node whose events count; None for every node, of which the first that has gains of a joint counts.

    ``refused`` counts what was left out, and why.
    """

    def __init__(self, controller: str | None) -> None:
        self._controller = controller
        self._heard = HeardGains()
        self._owner: dict[str, str] = {}
        self.refused: Counter[str] = Counter()

    def take(self, event: Any) -> dict[str, Gains]:
        """The gains of the joints that an event changes and whose stiffness is known by now."""
        node = str(event.node)
        if self._controller is not None and node != self._controller:
            return {}
        changed = []
        for parameter in (*event.new_parameters, *event.changed_parameters):
            found = joint_and_kind(str(parameter.name))
            if found is None:
                continue
            joint, kind = found
            owner = self._owner.setdefault(joint, node)
            if owner != node:
                self.refused[f"{node} has gains of {joint} too; those of {owner} count (choose with --controller)"] += 1
                continue
            number = gain_value(parameter.value)
            if math.isfinite(number):
                self._heard.set(joint, kind, number)
                changed.append(joint)
        gains = {joint: self._heard.of(joint) for joint in dict.fromkeys(changed)}
        return {joint: known for joint, known in gains.items() if known is not None}
