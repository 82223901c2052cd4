# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Delay of the controller's force, estimated from slips, and the joint with that delay."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.samples import FloatArray

SPREAD_LIMIT = 4.0  # standard error of a logarithm, 1: a wider one means nothing
_LEAST = 1e-9  # viscous friction that is left, of all of it: at least


@dataclass(frozen=True, kw_only=True)
class DelayEstimate:
    """Estimate of a delay τ of the controller's force, which reduces the damping by k_p τ.

    With constant gains only the remaining damping is identifiable; then viscous friction is a guess, and the delay is
    the one that goes with the guess.

    Attributes
    ----------
    viscous : F_v, without the effect of the delay [N·m·s/rad]. spread : standard error of its logarithm.
    left : F_v − k_p τ [N·m·s/rad], negative where the delay takes more than there is. std : its standard error.
    stiffness : k_p at which that is left [N·m/rad]. longest : the longest delay that is thought possible [s].
    """

    viscous: float
    spread: float
    left: float
    std: float
    stiffness: float
    longest: float

    @property
    def missing_damping(self) -> float:
        """Damping that the delay takes beyond all viscous friction [N·m·s/rad]; 0 where some is left."""
        return max(-self.left, 0.0)

    @property
    def delay(self) -> float:
        """τ [s]."""
        return (self.viscous - self.left) / self.stiffness

    @property
    def delay_std(self) -> float:
        """Standard error of τ [s]."""
        return math.hypot(self.viscous * self.spread, self.std) / self.stiffness

    def applied_to(self, joint: Joint) -> Joint:
        """The joint with viscous friction and delay apart."""
        viscous, delay = self._apart(np.float64(self.viscous), np.float64(self.left))
        friction = replace(joint.friction, viscous=float(viscous))
        return replace(joint, friction=friction, actuation_delay=float(delay))

    def drawn(self, joint: Joint, normal: FloatArray) -> Joint:
        """Joints as one of arrays with viscous friction and delay apart, as the errors allow.

        Parameters
        ----------
        normal : two standard normal draws for each joint, shape (2, draws).
        """
        left = self.left + self.std * normal[1]
        viscous = self.viscous * np.exp(min(self.spread, SPREAD_LIMIT) * normal[0])
        viscous, delay = self._apart(np.minimum(viscous, left + self.stiffness * self.longest), left)
        return replace(joint, friction=replace(joint.friction, viscous=viscous), actuation_delay=delay)

    def _apart(self, viscous: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Viscous friction and delay that leave what is left; no force acts early."""
        viscous = np.maximum(viscous, np.maximum(left, _LEAST * self.viscous))
        return viscous, (viscous - left) / self.stiffness
