# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the rests between slips say of how a joint's contact yields, before the slips themselves are asked.

While a joint stands it moves by the force on it over the contact's stiffness σ₀: from where it stands early in a rest
to where it stands towards its end. How far a contact yields is told as a share of how far the controller's
spring does, k_p/σ₀.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow

# Of the controller's spring: a contact that yields more is not one that slips begin on; slips do not show less.
MOST_COMPLIANCE, LEAST_COMPLIANCE = 0.2, 1e-4
LEAST_RESTS = 6  # rests that a compliance is estimated from, 1: at least
_SHOWN = 2.0  # compliance, standard errors: with less the rests do not show it
_UNSEEN = 2.0  # creep of all rests together that may pass unseen, counts
_LEAST_ERROR = 0.3  # error, of the compliance: what is seen at rest is not all that yields when the joint breaks away


@dataclass(frozen=True, kw_only=True)
class ContactKnowledge:
    """Compliance of a contact.

    Attributes
    ----------
    mean, std : in ``unit``. unit : compliance of the spring that the slips are pulled by [rad/(N·m)].
    """

    mean: float
    std: float
    unit: float


def contact_of(windows: list[SlipWindow]) -> ContactKnowledge | None:
    """The contact by the rests before the slips; None where they do not show that it yields."""
    ways, forces = [], []
    for window in windows:
        early, late = window.arrived, window.before
        if early is not None and late is not None:
            ways.append(late.position - early.position)
            forces.append(late.drive - early.drive - _stiffness(window) * ways[-1])
    way, force = np.array(ways), np.array(forces)
    count, size = len(way), float(force @ force)
    if count < LEAST_RESTS or size <= 0.0:
        return None
    compliance = float(way @ force) / size
    off = way - compliance * force
    # A creep of so little that no rest shows a count of it.
    unseen = _UNSEEN * max(window.resolution for window in windows) / math.sqrt(count * size)
    std = max(math.sqrt(float(off @ off) / (count - 1) / size), unseen)
    unit = spring_compliance(windows)
    mean, std = max(compliance, 0.0) / unit, math.hypot(std, _LEAST_ERROR * compliance) / unit
    if mean <= _SHOWN * std or not LEAST_COMPLIANCE < mean < MOST_COMPLIANCE:
        return None
    return ContactKnowledge(mean=mean, std=std, unit=unit)


def spring_compliance(windows: list[SlipWindow]) -> float:
    """Compliance of the spring that slips are pulled by [rad/(N·m)]: of the gains, or as the effort falls in a slip."""
    stiffness = max(_stiffness(window) for window in windows)
    if stiffness > 0.0:
        return 1.0 / stiffness
    falls = [max(float(np.ptp(window.forces)), TINY) for window in windows]
    return float(np.median([abs(window.slip_distance) / fall for window, fall in zip(windows, falls, strict=True)]))


def _stiffness(window: SlipWindow) -> float:
    return float(window.gains.stiffness) if window.gains is not None else 0.0
