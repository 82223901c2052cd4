# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Least damping of a joint at a given stiffness: by Eq. (43) or exactly, at the wanted confidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.dimensionless import DimensionlessGroups, damping_for_ratio, dimensionless_groups
from stickslip_ros.model.exact import LARGEST_DAMPING_RATIO, cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.steady_sliding import sliding_damping_ratio
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.uncertainty import Uncertainty, each_number

_LEAST_RATIO = 1e-6  # damping ratio: without any damping no oscillation decays
_LARGEST_LAG = 2.0 * math.pi  # τ* [1]: one natural period; the exact ratio is verified up to that
_ROUNDING = 1e-9  # relative, of the damping: the least damping itself satisfies
_TOLERANCE = 2e-4  # relative, of the bisected critical ratio
DRAWS_TOLERANCE = 5e-3  # the same for draws, of which the confidence takes one
# Speeds between the slowest and the fastest, at which the joint shall be smooth; the exact condition costs more.
_SPEEDS, _EXACT_SPEEDS = 16, 8
_FASTEST = 30.0  # times the Stribeck velocity: no joint sticks above that is smooth at lower speeds
_DECAY_FACTOR = 1.05  # times the damping at which a disturbance of steady sliding neither grows nor decays


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
            uncertainty = uncertainty.thinned()
        self._joint = uncertainty.joint if uncertainty else joint
        self._ratios = uncertainty.stiffness if uncertainty else np.ones(1)
        self._share = limits.confidence if uncertainty else 1.0
        self._wanted = 1.0 + limits.wanted_margin
        self.speeds = speeds_needed(joint, velocity, limits)

    def damping(self, stiffness: FloatArray, tolerance: float = _TOLERANCE) -> FloatArray:
        """Least k_v [N·m·s/rad] at stiffnesses k_p [N·m/rad] of shape (n,); infinite where no damping will do.

        ``tolerance`` : relative, of a critical ratio that is bisected; twice as much more damping is required.
        """
        more = 2.0 * tolerance if self.exact else _ROUNDING
        stiffnesses = stiffness[:, None, None] * self._ratios[None, :, None]
        draws = _with_axis(self._joint)
        with np.errstate(all="ignore"):
            groups = dimensionless_groups(draws, Gains(stiffness=stiffnesses), self.speeds)
            critical = self._critical(groups, tolerance)
            ratio = np.maximum(self._wanted * (1.0 + more) * critical, _LEAST_RATIO)
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
        with np.errstate(all="ignore"):
            stiffnesses = stiffness[:, None, None] * self._ratios[None, :, None]
            own = np.asarray(draws.own_damping(stiffnesses))
            less = np.maximum(damping[:, None, None] + own, 0.0) / self._wanted - own
            # Beyond the largest damping ratio there is no answer; a cycle that dies there dies with more damping too.
            less = np.minimum(less, damping_for_ratio(draws, stiffnesses, (1.0 - _ROUNDING) * LARGEST_DAMPING_RATIO))
            groups = dimensionless_groups(draws, Gains(stiffness=stiffnesses, damping=less), self.speeds)
            persists = _where_lag_is_short(
                groups, lambda few: np.asarray(cycle_persists(few, full_accuracy=False), dtype=float), 1.0
            )
            dies = np.all(persists == 0.0, axis=2)
        return np.asarray(np.mean(dies, axis=1) >= self._share)

    def _critical(self, groups: DimensionlessGroups, tolerance: float) -> FloatArray:
        if not self.exact:
            critical = np.asarray(critical_damping_ratio(groups), dtype=float)
            return np.where(np.asarray(groups.lag) <= _LARGEST_LAG, critical, math.nan)
        return _where_lag_is_short(
            groups,
            lambda few: np.asarray(exact_critical_damping_ratio(few, tolerance=tolerance), dtype=float),
            math.nan,
        )


class SteadySliding:
    """Least damping with which small disturbances of steady sliding decay.

    It is a necessary condition of steady motion, and nearly always a sufficient one, at a thousandth of the exact
    condition's work.

    Parameters
    ----------
    joint : of scalars. speeds : of shape (m,) [rad/s].
    uncertainties : under each of them it is to hold in the share ``confidence`` of the draws.
    """

    exact = False

    def __init__(
        self, joint: Joint, speeds: FloatArray, uncertainties: Sequence[Uncertainty] = (), confidence: float = 1.0
    ) -> None:
        self._joint, self._speeds, self._confidence = joint, speeds, confidence
        self._uncertainties = [one.thinned() for one in uncertainties]

    def damping(self, stiffness: FloatArray) -> FloatArray:
        """Least k_v [N·m·s/rad] at stiffnesses k_p [N·m/rad] of shape (n,)."""
        needed = self._of_draws(self._joint, np.ones(1), stiffness)
        several = [
            np.quantile(self._of_draws(one.joint, one.stiffness, stiffness), self._confidence, axis=1, method="higher")
            for one in self._uncertainties
        ]
        return np.asarray(np.max([needed[:, 0], *several], axis=0))

    def _of_draws(self, joint: Joint, ratios: FloatArray, stiffness: FloatArray) -> FloatArray:
        """Least k_v of each draw at each stiffness, of shape (n, draws)."""
        stiffnesses = stiffness[:, None, None] * ratios[None, :, None]
        draws = _with_axis(joint)
        with np.errstate(all="ignore"):
            groups = dimensionless_groups(draws, Gains(stiffness=stiffnesses), self._speeds)
            ratio = _DECAY_FACTOR * np.asarray(sliding_damping_ratio(groups))
            found = np.max(damping_for_ratio(draws, stiffnesses, ratio), axis=2)
        return np.asarray(np.where(np.isnan(found), math.inf, found))

    def reached(self, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        """Whether gains of shape (n,) have it."""
        return np.asarray(damping >= self.damping(stiffness) * (1.0 - _ROUNDING))


def _where_lag_is_short(
    groups: DimensionlessGroups, answer: Callable[[DimensionlessGroups], FloatArray], otherwise: float
) -> FloatArray:
    """Values of ``answer`` where the lag is at most a natural period: beyond, they are not verified by brute force."""
    numbers = {name: value for name, value in vars(groups).items() if name != "law"}
    arrays = dict(zip(numbers, np.broadcast_arrays(*numbers.values()), strict=True))
    short = arrays["lag"] <= _LARGEST_LAG
    found = np.full(short.shape, otherwise)
    if short.any():
        few: dict[str, Any] = {name: array[short] for name, array in arrays.items()}
        found[short] = answer(replace(groups, **few))
    return found


def speeds_needed(joint: Joint, velocity: float, limits: AdviceLimits) -> FloatArray:
    """Speeds at which the joint shall be smooth [rad/s]: the commanded one, or from the slowest one needed upwards."""
    slowest = limits.slowest_velocity
    if slowest is None:
        return np.array([abs(velocity)])
    fastest = max(slowest, _FASTEST * float(joint.friction.stribeck_velocity))
    count = _EXACT_SPEEDS if limits.condition is Criterion.EXACT else _SPEEDS
    return np.geomspace(slowest, fastest, count) if fastest > slowest else np.array([slowest])


def _with_axis(joint: Joint) -> Joint:
    """The draws along the last axis but one, beside the speeds."""
    return each_number(joint, lambda value: np.atleast_1d(np.asarray(value, dtype=float))[:, None])
