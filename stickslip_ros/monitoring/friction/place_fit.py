# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Slips fitted with what their places make of their forces, where without it they cannot be explained.

What varies over position is seen in the kinetic friction, taken off, and looked for once more in what is then left.
Where friction varies, Coulomb and Stribeck friction each get one more unknown, by which they grow from the best place
to the worst; kept where they explain more than they are worth (BIC). All is then told as it is at the worst place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction.dry_friction import dry_friction_of
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, misfit_of
from stickslip_ros.monitoring.friction.slip_search import search
from stickslip_ros.monitoring.friction.slip_solution import fit_near
from stickslip_ros.monitoring.friction.surroundings import Surroundings

_ROUNDS = 2  # of what varies the more is seen the better the slips are explained
_PARAMETERS = 2  # of a growth
_OF_SURROUNDINGS = 5  # that a load over position and a ripple have at most, beside


def with_surroundings(plain: FittedLaw, known: Mapping[int, tuple[float, float]], why: str) -> FittedLaw:
    """The same law fitted with what varies over position taken off, where that explains the slips better.

    Parameters
    ----------
    plain : a fit of slips as they are. why : what it does not explain.
    known : mean and standard deviation of parameters' logarithms, by index.
    """
    best = plain
    for _ in range(_ROUNDS):
        found = _round(plain, best, known, why)
        if found is None:
            break
        best = found
    return best


def _round(plain: FittedLaw, best: FittedLaw, known: Mapping[int, tuple[float, float]], why: str) -> FittedLaw | None:
    """A fit with what the best one so far shows to vary; None if nothing does, or nothing is gained."""
    dry = dry_friction_of(best.problem, best.solution.fit)
    if dry is None or not (dry.load_curve or dry.ripple is not None):
        return None
    if best is plain and dry.load_curve:
        # Beside a load that is not yet taken off a ripple may be anything.
        dry = replace(dry, ripple=None)
    around = Surroundings(dry=dry, without=why)
    windows = plain.problem.windows
    off = np.array([around.taken_off(window) for window in windows])
    changed = plain.problem.elsewhere([around.applied(window) for window in windows], off)
    try:
        solution = search(changed, known)
    except LinAlgError:
        return None
    count = math.log(changed.count)
    if solution is None or _misfit(plain) - misfit_of(changed, solution) < _OF_SURROUNDINGS * count:
        return None
    even = FittedLaw(law=plain.law, problem=changed, solution=solution, surroundings=around)
    growing = _growing(even, known)
    found = growing if growing is not None and _misfit(even) - _misfit(growing) > _PARAMETERS * count else even
    return found if best is plain or _misfit(found) < _misfit(best) else None


def _growing(even: FittedLaw, known: Mapping[int, tuple[float, float]]) -> FittedLaw | None:
    """The fit whose friction may vary too, told as it is where it is largest; None where nothing can be fitted."""
    around, problem, fit = even.surroundings, even.problem, even.solution.fit
    assert around is not None
    for falls in (False, True):
        growth = around.growth(problem.rests, falls=falls)
        if not growth.any():
            return None
        growing = problem.elsewhere(problem.windows, problem.taken_off, growth)
        try:
            solution = fit_near(growing, np.append(fit.parameters, 0.0), fit, known)
        except LinAlgError:
            return None
        if solution.fit.parameters[-1] >= 0.0:
            return FittedLaw(law=even.law, problem=growing, solution=solution, surroundings=around, falls=falls)
    return None


def _misfit(fitted: FittedLaw) -> float:
    return misfit_of(fitted.problem, fitted.solution)
