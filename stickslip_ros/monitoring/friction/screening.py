# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Screening of another friction law: whether it may explain slips as well as a fitted law, and from which start.

The fit of a law ends in the valley in which it begins, and the parameters that one law needs can be far from those of
another: where the Stribeck friction falls to nothing at once, a law with a long tail takes more of it, less Coulomb
friction and more viscous friction for the same curve. So screening starts from the curve, not from the parameters; and
both laws are fitted to the same few slips, with ever smaller tolerances of the ties between slips.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model._friction_law import LAWS, stribeck_friction
from stickslip_ros.monitoring.friction._window_kernel import STRIBECK, STRIBECK_VELOCITY, VISCOUS
from stickslip_ros.monitoring.friction.fitted_law import (
    CLEARLY_BETTER,
    HALF_SPEED,
    FittedLaw,
    misfit_of,
    residuals_per_observation,
)
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS
from stickslip_ros.monitoring.friction.slip_solution import truncated_fit, usual_level
from stickslip_ros.monitoring.samples import FloatArray

_WORSE = 60.0  # twice the logarithm of a likelihood ratio, 1: with more, more slips do not change the order of laws
_SPEEDS = 64  # speeds at which curves are compared, 1
_SCALES = np.geomspace(0.4, 2.5, 15)  # Stribeck velocities that are tried, of the one fitted


@dataclass(frozen=True, kw_only=True)
class Screening:
    """Result of the screening of a law.

    Attributes
    ----------
    start : logarithms from which to fit it to all slips, shape (6,).
    worse : twice the logarithm of the likelihood ratio of the fitted law and the screened one, on the same few slips.
    """

    start: FloatArray
    worse: float

    @property
    def rejected(self) -> bool:
        """Whether the law stays worse however many slips are fitted."""
        return self.worse > _WORSE

    @property
    def better(self) -> bool:
        """Whether the law is clearly better: where no law fits, only such a one is worth a full fit."""
        return self.worse < -CLEARLY_BETTER


def screen_law(law: str, first: FittedLaw) -> Screening | None:
    """Screen a law against the one fitted first; None if no slip can be simulated by it."""
    some = first.problem.spread()
    theirs = truncated_fit(some, first.solution.fit.parameters)
    if theirs is None:
        return None
    other = some.with_model(replace(some.model, law=LAWS[law]))
    found = truncated_fit(other, same_curve(law, first))
    if found is None:
        return None
    worse = (misfit_of(found) - misfit_of(theirs)) / residuals_per_observation(theirs)
    return Screening(start=found.fit.parameters[:PARAMETERS], worse=worse)


def same_curve(law: str, first: FittedLaw) -> FloatArray:
    """Logarithms of the parameters of a law with which friction over speed is most nearly what the first fit has."""
    fit, problem = first.solution.fit, first.problem
    start = same_parameters(law, first)
    level, unit = usual_level(fit), math.exp(fit.parameters[STRIBECK_VELOCITY])
    speeds = np.abs(fit.velocities)
    speeds = np.quantile(speeds[speeds > 0.0], np.linspace(0.0, 1.0, _SPEEDS))
    curve = np.asarray(stribeck_friction(LAWS[first.law], level, speeds / unit))
    curve += math.exp(fit.parameters[VISCOUS]) * speeds
    usual = problem.usual_speed
    best = math.inf
    for scale in _SCALES * math.exp(start[STRIBECK_VELOCITY]):
        falling = np.asarray(stribeck_friction(LAWS[law], 1.0, speeds / scale))
        # The Coulomb friction may have either sign here: it is what is left.
        columns = np.stack([np.ones_like(speeds), speeds / usual, falling], axis=1)
        weights = np.linalg.lstsq(columns, curve, rcond=None)[0]
        _, viscous, stribeck = weights
        missed = float(np.linalg.norm(columns @ weights - curve))
        if missed < best and viscous > 0.0 and stribeck > 0.0:
            best = missed
            start[[VISCOUS, STRIBECK_VELOCITY]] = math.log(viscous / usual), math.log(scale)
            start[STRIBECK] = fit.parameters[STRIBECK] + math.log(stribeck / level)
    return start


def same_parameters(law: str, first: FittedLaw) -> FloatArray:
    """Logarithms of the first fit's parameters, with the Stribeck velocity at which the law has fallen to half too."""
    start = first.solution.fit.parameters[:PARAMETERS].copy()
    start[STRIBECK_VELOCITY] += math.log(HALF_SPEED[first.law] / HALF_SPEED[law])
    return np.asarray(start)
