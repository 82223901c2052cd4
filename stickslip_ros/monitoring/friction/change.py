# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""An abrupt change of friction, and which parameters it shows in."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES, FrictionEstimate
from stickslip_ros.monitoring.friction.regression import SIGNIFICANT_ERRORS

_SMALL = 0.03  # change of a parameter, of its value: a smaller one is not worth naming


@dataclass(frozen=True, kw_only=True)
class ParameterDifference:
    """One parameter before and after a change, in its own unit."""

    name: str
    old: float
    new: float


@dataclass(frozen=True, kw_only=True)
class FrictionChange:
    """Friction that became another from one slip to the next.

    Attributes
    ----------
    time : of the first slip that what was known did not explain [s].
    learning_anew : whether too few slips came since to say in what it differs.
    differences : parameters that certainly differ; none as long as it is being learnt anew.
    """

    time: float
    learning_anew: bool
    differences: tuple[ParameterDifference, ...]


def friction_change(before: FrictionEstimate, after: FrictionEstimate, time: float) -> FrictionChange:
    """The change between what was learnt before and after a time [s]."""
    differences = []
    for name in (*NAMES, COULOMB_AND_LOAD):
        old, new = before[name], after[name]
        if before.normalised != after.normalised or not (old.identified and new.identified):
            continue
        apart = abs(new.value - old.value)
        if apart > SIGNIFICANT_ERRORS * math.hypot(old.std, new.std) and apart > _SMALL * abs(old.value):
            differences.append(ParameterDifference(name=name, old=old.value, new=new.value))
    return FrictionChange(time=time, learning_anew=False, differences=tuple(differences))
