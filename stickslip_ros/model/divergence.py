# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Loops whose motion grows without end: no motion of a joint is read off those.

All friction but the viscous part is bounded, and so is what a compensation adds. What a joint does far away is
therefore what the linear loop without them does: a loop that is stable keeps the motion bounded, one that is not may be
held by friction near rest, and runs away from farther.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.loop_modes import loop_matrix

UNSTABLE = "the loop is unstable: its motion grows without end"

_FAR = 30.0  # distance, of what the joint has to do with and what friction holds: a joint so far off runs away
# Excess of an eigenvalue's magnitude over 1, 1: what rounding makes of a mode that neither grows nor decays.
_ON_THE_CIRCLE = 1e-9


class UnstableLoopError(StickSlipError):
    """The motion grows without end, and nothing is read off it."""

    def __init__(self) -> None:
        super().__init__(UNSTABLE)


def loop_is_unstable(joint: Joint, gains: Gains, conditions: OperatingConditions) -> bool:
    """Whether the linear loop, viscous friction in it and no other, has a mode that grows; scalars only.

    With continuous control of a rigid joint the roots of M s³ + (k_v + F_v) s² + k_p s + k_i, by Routh, F_v less what
    an actuation delay takes off; otherwise the eigenvalues of :mod:`stickslip_ros.model.loop_modes`.
    """
    if conditions.controller_period > 0 or joint.transmission is not None:
        loop = loop_matrix(joint, gains, conditions)
        if not np.isfinite(loop).all():
            return True
        modes = np.linalg.eigvals(loop)
        if conditions.controller_period > 0:
            return bool(np.abs(modes).max() > 1.0 + _ON_THE_CIRCLE)
        return bool(modes.real.max() > _ON_THE_CIRCLE * np.abs(modes).max())
    inertia, stiffness, integral = float(joint.inertia), float(gains.stiffness), float(gains.integral)
    damping = float(joint.total_damping(gains))
    return damping < 0 or stiffness < 0 or integral < 0 or damping * stiffness < inertia * integral


def runs_away(
    joint: Joint, gains: Gains, conditions: OperatingConditions, errors: NDArray[np.float64], reach: float
) -> bool:
    """Whether errors of position [rad] are those of a loop that is unstable, and far beyond what friction can hold.

    Parameters
    ----------
    reach : what a joint has to do with anyway: its reference's travel, how far off it starts [rad].
    """
    furthest = float(np.abs(errors).max(initial=0.0))
    if not math.isfinite(furthest):
        return True
    held = float(joint.friction.coulomb) + float(joint.friction.stribeck) + abs(conditions.load)
    return furthest > _FAR * (reach + held / abs(float(gains.stiffness))) and loop_is_unstable(joint, gains, conditions)
