# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bounds of the gains that may be written, which nobody on the graph can widen."""

from __future__ import annotations

import math

from stickslip_ros.settings.parameters import JointSettings

RANGES = ("stiffness_range", "damping_range")


class GainBounds:
    """The first limits of a joint that have an upper end, in the controller's units.

    They hold for as long as the node runs. Whoever can set parameters can ask for narrower ones, or for other advice,
    but not have anything written outside what the robot's owner configured.
    """

    def __init__(self) -> None:
        self._first: dict[tuple[str, str], tuple[float, float]] = {}

    def note(self, name: str, settings: JointSettings) -> None:
        """Remember a joint's limits, if they are the first."""
        for which in RANGES:
            limits = _limits(settings, which)
            if math.isfinite(limits[1]):
                self._first.setdefault((name, which), limits)

    def of(self, name: str, settings: JointSettings, which: str) -> tuple[float, float]:
        """What may be written, of one of :data:`RANGES`: the limits of now, within the first ones."""
        now = _limits(settings, which)
        first = self._first.get((name, which), now)
        return max(now[0], first[0]), min(now[1], first[1])


def _limits(settings: JointSettings, which: str) -> tuple[float, float]:
    least, largest = getattr(settings.options.limits, which)
    return least / settings.gain_scale, largest / settings.gain_scale
