# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Slips fitted without their position-dependent forces, where no fit with them explains the slips.

The disturbance is estimated from the kinetic friction, subtracted, and estimated once more from the new fit. Where
friction varies, Coulomb and Stribeck friction each get one more parameter, by which they grow from the best place to
the worst; the parameters stay where BIC prefers them. All parameters are then reported at the worst place.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction.dry_friction import dry_friction_of
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, misfit_of
from stickslip_ros.monitoring.friction.position_disturbance import PositionDisturbance
from stickslip_ros.monitoring.friction.slip_search import search
from stickslip_ros.monitoring.friction.slip_solution import fit_near

_ROUNDS = 2  # estimates of the disturbance: the second one rests on a better fit
_PARAMETERS = 2  # parameters of a friction factor, 1
_OF_DISTURBANCE = 5  # parameters that a load over position and a ripple have at most


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
    windows = plain.problem.windows
    off = np.array([disturbance.subtracted_force(window) for window in windows])
    changed = plain.problem.changed([disturbance.applied(window) for window in windows], subtracted_force=off)
    try:
        solution = search(changed)
    except LinAlgError:
        return None
    count = math.log(changed.count)
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
        covariate = disturbance.covariate(problem.rests, decreasing=decreasing)
        if not covariate.any():
            return None
        growing = problem.changed(covariate=covariate)
        try:
            solution = fit_near(growing, np.append(fit.parameters, 0.0), fit)
        except LinAlgError:
            return None
        if solution.fit.parameters[-1] >= 0.0:
            return replace(even, solution=solution, decreasing=decreasing)
    return None
