# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How much damping a joint needs at a given stiffness: by Eq. (43) or exactly, at the confidence asked for."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.dimensionless import DimensionlessGroups, damping_for_ratio, dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.steady_sliding import sliding_damping_ratio
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.uncertainty import Uncertainty

_LEAST_RATIO = 1e-6  # without any damping no oscillation dies
_ROUNDING = 1e-9
_EXACT_TOLERANCE = 4e-4  # by so much more damping is asked for, the exact critical ratio being bisected
_EXACT_DRAWS = 32
_SPEEDS, _EXACT_SPEEDS = 16, 8
_FAST = 30.0  # times the Stribeck velocity, from which on no joint sticks that does not at lower speeds
_STEADY = 1.05  # times the damping at which a disturbance neither grows nor decays
_LARGEST_LAG = 2.0 * math.pi


class Requirement:
    """Least damping with the wanted margin.

    Parameters
    ----------
    joint : of scalars. velocity : commanded [rad/s], used unless the limits name a slowest one.
    uncertainty : the margin is to hold in the share ``limits.confidence`` of its draws, by its own law; None for a
        joint known exactly.
    """

    def __init__(
        self, joint: Joint, velocity: float, limits: AdviceLimits, uncertainty: Uncertainty | None = None
    ) -> None:
        self.exact = limits.condition is Criterion.EXACT
        if uncertainty is not None and self.exact:
            uncertainty = _thinned(uncertainty)
        self._joint = uncertainty.joint if uncertainty else joint
        self._ratios = uncertainty.stiffness if uncertainty else np.ones(1)
        self._share = limits.confidence if uncertainty else 1.0
        self._wanted = 1.0 + limits.wanted_margin
        self._factor = self._wanted * (1.0 + (_EXACT_TOLERANCE if self.exact else _ROUNDING))
        self.speeds = speeds_needed(joint, velocity, limits)

    def damping(self, stiffness: FloatArray) -> FloatArray:
        """Least k_v [N·m·s/rad] at stiffnesses k_p [N·m/rad] of shape (n,); infinite where no damping will do."""
        stiffnesses = stiffness[:, None, None] * self._ratios[None, :, None]
        draws = _with_axis(self._joint)
        with np.errstate(all="ignore"):
            groups = dimensionless_groups(draws, Gains(stiffness=stiffnesses), self.speeds)
            critical = self._critical(groups)
            ratio = np.maximum(self._factor * critical, _LEAST_RATIO)
            needed = np.max(damping_for_ratio(draws, stiffnesses, ratio), axis=2)
        needed = np.where(np.isnan(needed), math.inf, needed)
        return np.asarray(np.quantile(needed, self._share, axis=1, method="higher"))

    def reached(self, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        """Whether gains k_p [N·m/rad] and k_v [N·m·s/rad] of shape (n,) have the wanted margin.

        Exactly, it is a tenth of the work of :meth:`damping`.
        """
        if not self.exact:
            # What is just enough counts.
            return np.asarray(damping >= self.damping(stiffness) * (1.0 - _ROUNDING))
        draws = _with_axis(self._joint)
        viscous = np.asarray(draws.friction.viscous)
        with np.errstate(all="ignore"):
            stiffnesses = stiffness[:, None, None] * self._ratios[None, :, None]
            less = np.maximum(damping[:, None, None] + viscous, 0.0) / self._wanted - viscous
            groups = dimensionless_groups(draws, Gains(stiffness=stiffnesses, damping=less), self.speeds)
            dies = np.all(np.asarray(cycle_persists(groups)) == 0.0, axis=2)
        return np.asarray(np.mean(dies, axis=1) >= self._share)

    def _critical(self, groups: DimensionlessGroups) -> FloatArray:
        if self.exact:
            return np.asarray(exact_critical_damping_ratio(groups, tolerance=0.5 * _EXACT_TOLERANCE), dtype=float)
        critical = np.asarray(critical_damping_ratio(groups), dtype=float)
        return np.where(np.asarray(groups.lag) <= _LARGEST_LAG, critical, math.nan)


class SteadySliding:
    """Least damping with which steady sliding is stable, for the joint itself whatever its errors.

    Parameters
    ----------
    joint : of scalars. speeds : of shape (m,) [rad/s].
    """

    exact = False

    def __init__(self, joint: Joint, speeds: FloatArray) -> None:
        self._joint, self._speeds = joint, speeds

    def damping(self, stiffness: FloatArray) -> FloatArray:
        """Least k_v [N·m·s/rad] at stiffnesses k_p [N·m/rad] of shape (n,)."""
        groups = dimensionless_groups(self._joint, Gains(stiffness=stiffness[:, None]), self._speeds)
        ratios = np.max(np.asarray(sliding_damping_ratio(groups)), axis=1)
        return np.asarray(damping_for_ratio(self._joint, stiffness, _STEADY * ratios))

    def reached(self, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        """Whether gains of shape (n,) have it."""
        return np.asarray(damping >= self.damping(stiffness) * (1.0 - _ROUNDING))


def speeds_needed(joint: Joint, velocity: float, limits: AdviceLimits) -> FloatArray:
    """Speeds at which the joint shall be smooth [rad/s]: the commanded one, or from the slowest one needed upwards."""
    slowest = limits.slowest_velocity
    if slowest is None:
        return np.array([abs(velocity)])
    fastest = max(slowest, _FAST * float(joint.friction.stribeck_velocity))
    count = _EXACT_SPEEDS if limits.condition is Criterion.EXACT else _SPEEDS
    return np.geomspace(slowest, fastest, count) if fastest > slowest else np.array([slowest])


def _thinned(uncertainty: Uncertainty) -> Uncertainty:
    """As many of the draws as can be integrated in time."""
    count = len(uncertainty.stiffness)
    every = slice(None, None, max(1, count // _EXACT_DRAWS))

    def some(value: Real) -> FloatArray:
        return np.broadcast_to(np.asarray(value, dtype=float), (count,))[every]

    return Uncertainty(joint=_each(uncertainty.joint, some), stiffness=uncertainty.stiffness[every])


def _with_axis(joint: Joint) -> Joint:
    """The draws along the last axis but one, beside the speeds."""
    return _each(joint, lambda value: np.atleast_1d(np.asarray(value, dtype=float))[:, None])


def _each(joint: Joint, change: Callable[[Real], FloatArray]) -> Joint:
    """The joint with every number changed."""
    values = {name: change(value) for name, value in joint.friction.numbers.items()}
    return Joint(inertia=change(joint.inertia), friction=joint.friction.changed(values))
