# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A joint as it may be, given the errors of what was learnt, and how probable stick slip is then."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.exact import cycle_persists
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.samples import FloatArray

_DRAWS = 32  # of each law, that are integrated


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """A joint as it may be: draws from what is known of it, under one friction law and under others.

    Attributes
    ----------
    joint : of arrays, one value a draw.
    stiffness : of the controller in each draw over the nominal one; 1 where the gains are known.
    weight : of this law. others : laws that the data do not exclude; the weights add up to 1.
    doubt : least probability of being wrong, because the model does not explain what was seen.
    """

    joint: Joint
    stiffness: FloatArray
    weight: float = 1.0
    others: tuple[Uncertainty, ...] = ()
    doubt: float = 0.0

    def under(self, conditions: OperatingConditions) -> Uncertainty:
        """The same, as the conditions leave each joint."""
        others = tuple(other.under(conditions) for other in self.others)
        return replace(self, joint=conditions.applied_to(self.joint), others=others)


def stick_slip_probability(uncertainty: Uncertainty, gains: Gains, velocity: float) -> float:
    """Probability that stick slip goes on by the exact condition, over draws and laws; NaN where there is no answer.

    A draw of negative damping in all, which swings by itself, counts as one that is not smooth.

    Parameters
    ----------
    gains : scalars, the nominal ones; without integral action. velocity : commanded [rad/s].
    """
    if gains.integral != 0 or not gains.stiffness > 0 or velocity == 0:
        return math.nan
    total = answered = 0.0
    for law in (uncertainty, *uncertainty.others):
        drawn = Gains(stiffness=float(gains.stiffness) * law.stiffness, damping=gains.damping)
        groups = dimensionless_groups(law.joint, drawn, velocity)
        every = slice(None, None, max(1, len(law.stiffness) // _DRAWS))
        frequency, ratio, stribeck, speed, lag, rise_time = (
            np.broadcast_to(np.asarray(value, dtype=float), law.stiffness.shape)[every] for value in groups.numbers
        )
        some = DimensionlessGroups(
            natural_frequency=frequency,
            damping_ratio=np.maximum(ratio, 0.0),
            stribeck=stribeck,
            velocity=speed,
            lag=lag,
            rise_time=rise_time,
            law=groups.law,
        )
        persists = np.where(ratio < 0.0, 1.0, np.asarray(cycle_persists(some, patient=False)))
        known = np.isfinite(persists)
        if known.any():
            total += law.weight * float(persists[known].mean())
            answered += law.weight
    if answered == 0.0:
        return math.nan
    return min(max(total / answered, uncertainty.doubt), 1.0 - uncertainty.doubt)
