# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Slips fitted without their position-dependent forces, and friction that varies with position or load.

The disturbance is estimated from the kinetic friction, subtracted, and estimated once more from the new fit. Slips
without it differ only in their Stribeck friction. Where friction varies, Coulomb and Stribeck friction each get one
more parameter, by which they grow from the best place to the worst; the parameters stay where BIC prefers them. All
parameters are then reported at the worst place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction.dry_friction import PositionDisturbance, dry_friction_of
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, misfit_of
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem, TermParameter, Variants
from stickslip_ros.monitoring.friction.slip_search import search
from stickslip_ros.monitoring.friction.slip_solution import fit_near
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.friction.trend import FrictionGrowth
from stickslip_ros.monitoring.samples import FloatArray

_ROUNDS = 2  # estimates of the disturbance: the second one rests on a better fit
_STD = 0.5  # prior standard deviation of the Stribeck friction that the covariate scales, of it
_PARAMETERS = 2  # parameters of a friction factor, 1
_OF_DISTURBANCE = 5  # parameters that a load over position and a ripple have at most


@dataclass(frozen=True, kw_only=True)
class PositionGrowth(FrictionGrowth):
    """Friction that grows from the best place to the worst, in proportion to the covariate of a disturbance.

    Attributes
    ----------
    disturbance : which was subtracted. decreasing : whether friction falls where that grows.
    """

    disturbance: PositionDisturbance
    decreasing: bool

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """The share by which Stribeck friction grows."""
        return {"factor": TermParameter(std=_STD)}

    def covariate(self, problem: SlipProblem) -> FloatArray:
        """Of the places where the slips began."""
        return self.disturbance.covariate(problem.data.rests, decreasing=self.decreasing)


@dataclass(frozen=True, kw_only=True)
class KnownFactor(FrictionGrowth):
    """A known factor of the Stribeck friction."""

    factor: float

    def share(self, variants: Variants, problem: SlipProblem) -> FloatArray:
        """The same in every slip."""
        return np.array([[self.factor - 1.0]])


@dataclass(frozen=True, kw_only=True)
class FrictionFactor:
    """Position- or load-dependent factor of the Stribeck friction.

    Attributes
    ----------
    position_disturbance : disturbance that has the covariate. decreasing : whether friction falls where that grows.
    share, std : relative difference of the Stribeck friction between best and worst place, and its standard error.
    coulomb, coulomb_std : difference of the Coulomb friction between them, and its standard error [N·m].
    """

    position_disturbance: PositionDisturbance = field(metadata={"key": "surroundings"})
    decreasing: bool = field(metadata={"key": "falls"})
    share: float
    std: float
    coulomb: float
    coulomb_std: float

    def _covariate(self, positions: FloatArray) -> FloatArray:
        return self.position_disturbance.covariate(positions, decreasing=self.decreasing)

    def factor(self, position: float) -> float:
        """Stribeck friction at a position [rad] over that at the worst place seen."""
        return 1.0 + self.share * float(self._covariate(np.array([position]))[0])

    def applied(self, window: SlipWindow) -> SlipWindow:
        """The slip without the disturbance, and with the Coulomb friction of the worst place."""
        less = window.direction * self.coulomb * float(self._covariate(np.array([window.rest_position]))[0])
        window = self.position_disturbance.applied(window)
        return replace(window, forces=window.forces - less)

    def load_at(self, position: float) -> float:
        """Load at a position [N·m]."""
        return float(self.position_disturbance.dry.load_at(np.array([position]))[0])

    @property
    def loads(self) -> tuple[float, float]:
        """The least and the largest size of the load at the slips [N·m]."""
        sizes = np.abs(self.position_disturbance.dry.load_at(self.position_disturbance.dry.position))
        return float(sizes.min()), float(sizes.max())

    def over_load(self, stribeck: float) -> tuple[float, float]:
        """Slope of the Stribeck friction over the load [1] and its standard error; NaN where it varies with position.

        Parameters
        ----------
        stribeck : at the worst place [N·m].
        """
        least, largest = self.loads
        if not self.position_disturbance.with_load or not largest > least:
            return math.nan, math.nan
        slope = (-1.0 if self.decreasing else 1.0) * stribeck / (largest - least)
        return slope * self.share, abs(slope) * self.std

    @property
    def text(self) -> str:
        """In words what varies, and which place is meant."""
        size = f"Stribeck friction varies by {100.0 * self.share:.2g} ± {100.0 * self.std:.1g} %"
        if self.position_disturbance.with_load:
            way = "least" if self.decreasing else "largest"
            return (
                f"{size} with the load; values are for the {way} load seen, {self.loads[not self.decreasing]:.3g} N·m"
            )
        return f"{size} with position; values are for the worst position seen, {self.worst_position:.3g} rad"

    @property
    def worst_position(self) -> float:
        """Where among the slips it is largest [rad]."""
        positions = self.position_disturbance.dry.position
        return float(positions[np.argmax(self._covariate(positions))])


def friction_factor_of(fitted: FittedLaw, covariance: FloatArray) -> FrictionFactor | None:
    """Factor of friction between best and worst place; None where no fit has one."""
    growth = fitted.problem.model.term(PositionGrowth)
    if growth is None:
        return None
    share, std = fitted.term_parameter("factor", covariance)
    return FrictionFactor(
        position_disturbance=growth.disturbance,
        decreasing=growth.decreasing,
        share=share,
        std=std,
        coulomb=float(fitted.solution.fit.kinetic[-1]),
        coulomb_std=math.sqrt(max(float(covariance[-1, -1]), 0.0)),
    )


def with_position_disturbance(plain: FittedLaw, why: str) -> FittedLaw:
    """Fit of the same law without the position-dependent forces, where that explains the slips better.

    Parameters
    ----------
    plain : fit with the forces as they are. why : what that fit does not explain.
    """
    best = plain
    for _ in range(_ROUNDS):
        found = _round(plain, best, why)
        if found is None:
            break
        best = found
    return best


def _round(plain: FittedLaw, best: FittedLaw, why: str) -> FittedLaw | None:
    """Fit without the disturbance that the best fit so far shows; None if there is none, or BIC rejects it."""
    dry = None if best.cut_short else dry_friction_of(best.problem, best.solution.fit)
    if dry is None or not (dry.load_curve or dry.ripple is not None):
        return None
    if best is plain and dry.load_curve:
        # A ripple is not reliable while a varying load is not subtracted.
        dry = replace(dry, ripple=None)
    disturbance = PositionDisturbance(dry=dry, without=why)
    windows = plain.problem.data.windows
    off = np.array([disturbance.subtracted_force(window) for window in windows])
    changed = plain.problem.changed([disturbance.applied(window) for window in windows], subtracted_force=off)
    try:
        solution = search(changed)
    except LinAlgError:
        return None
    count = math.log(changed.data.count)
    if solution is None or plain.misfit - misfit_of(solution) < _OF_DISTURBANCE * count:
        return None
    even = FittedLaw(solution=solution, position_disturbance=disturbance)
    growing = _with_friction_factor(even)
    found = growing if growing is not None and even.misfit - growing.misfit > _PARAMETERS * count else even
    return found if best is plain or found.misfit < best.misfit else None


def _with_friction_factor(even: FittedLaw) -> FittedLaw | None:
    """Fit with a friction factor, reported where friction is largest; None where no fit is possible."""
    disturbance, problem, fit = even.position_disturbance, even.problem, even.solution.fit
    assert disturbance is not None
    for decreasing in (False, True):
        growth = PositionGrowth(disturbance=disturbance, decreasing=decreasing)
        growing = problem.changed(model=problem.model.with_term(growth))
        if growing.covariate is None or not growing.covariate.any():
            return None
        solution = fit_near(growing, fit.parameters, fit)
        if solution is None:
            return None
        if solution.fit.parameters[growing.column["factor"]] >= 0.0:
            return replace(even, solution=solution)
    return None
