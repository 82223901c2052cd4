# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains from recorded parameter events: the changes of `gains.<joint>.p/.i/.d` of one controller or several."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

from stickslip_ros.messages.gain_layouts import INTERFACES, why_not_taken
from stickslip_ros.messages.gain_parameters import HeardGains, gain_value, joint_and_kind
from stickslip_ros.model.friction import Gains


class GainEvents:
    """Puts gains together from events, which hold only what changed.

    Parameters
    ----------
    controller : the node whose events count; None for every node, of which the first that has gains of a joint counts.
    is_of_robot : says of a node whether its gains are about the robot; None if it cannot be told.

    ``refused`` counts what was left out, and why; ``nodes`` are those that have gains.
    """

    def __init__(self, controller: str | None, is_of_robot: Callable[[str], bool | None] = lambda _: True) -> None:
        self._controller, self._is_of_robot = controller, is_of_robot
        self._heard: dict[str, HeardGains] = {}
        self._owner: dict[str, str] = {}
        self.refused: Counter[str] = Counter()
        self.nodes: set[str] = set()

    def take(self, event: Any) -> dict[str, Gains]:
        """The gains of the joints that an event changes and whose stiffness is known by now."""
        node = str(event.node)
        parameters = {str(one.name): one.value for one in (*event.new_parameters, *event.changed_parameters)}
        if any(joint_and_kind(name) is not None for name in parameters):
            self.nodes.add(node)
        of_robot = self._is_of_robot(node)
        if (self._controller is not None and node != self._controller) or of_robot is False:
            return {}
        heard = self._heard.setdefault(node, HeardGains())
        if any(name in parameters for name in INTERFACES):
            heard.refusal = why_not_taken(parameters)
        changed = []
        for name, value in parameters.items():
            found = joint_and_kind(name)
            if found is None:
                continue
            if heard.refusal:
                self.refused[f"gains of {node}: {heard.refusal}"] += 1
                continue
            if of_robot is None:
                self.refused[f"gains of {node}: it is in no robot's namespace (choose with --controller)"] += 1
                continue
            joint, kind = found
            owner = self._owner.setdefault(joint, node)
            if owner != node:
                self.refused[f"{node} has gains of {joint} too; those of {owner} count (choose with --controller)"] += 1
                continue
            number = gain_value(value)
            if math.isfinite(number):
                heard.set(joint, kind, number)
                changed.append(joint)
        gains = {joint: heard.of(joint) for joint in dict.fromkeys(changed)}
        return {joint: known for joint, known in gains.items() if known is not None}
