# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction laws fitted side by side to the same slips, and how far the slips speak for each.

The weight of a law is its posterior probability, all being equally likely before and having as many parameters:
exp(-½ Δ) of the difference of twice the negative logarithms of their likelihoods, with each law's own estimate of what
it leaves unexplained. Where residuals are not the sensor's noise, neighbours repeat each other: then only each
run of residuals of one sign counts as an observation of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.monitoring.friction._window_kernel import STRIBECK_VELOCITY
from stickslip_ros.monitoring.friction.slip_equations import robust
from stickslip_ros.monitoring.friction.slip_fit import Tolerances, fit_slips
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import GOOD, Solution, fit_near, usual_level
from stickslip_ros.monitoring.friction.surroundings import Surroundings
from stickslip_ros.monitoring.samples import FloatArray

EXCLUDED = 0.02  # weight of a law that the data exclude
LEAST_SLIPS = 8  # that tell laws apart
# No model is better than so of kinetic friction, as a share of the usual level, and of levels.
_LEAST_BALANCE, _LEAST_LINK = 2e-3, 1e-3
_WHITE = 2.0  # residuals in a run of one sign, if they are independent
_FITS = 1.08  # mean square of residuals, up to which a law leaves nothing over
_LOOK, _ENOUGH = 15, 1.0  # iterations of a look at a law; gain of one below which it ends
_FAR, _FAR_SHARE = 200.0, 0.3  # of cost, and for each observation: worse than that no fit becomes as good
# Speed at which the Stribeck friction has fallen to half, in Stribeck velocities.
HALF_SPEED = {"hess_soom": 1.0, "exponential": math.sqrt(math.log(2.0))}


@dataclass(frozen=True, kw_only=True)
class FittedLaw:
    """One law's fit of some slips.

    Attributes
    ----------
    law : its name. weight : from 0 to 1; those of all laws add up to 1.
    surroundings : what was taken off the forces of the problem's slips, None if nothing. falls : whether friction that
        grows with them in the problem grows the other way.
    """

    law: str
    problem: SlipProblem
    solution: Solution
    weight: float = 1.0
    surroundings: Surroundings | None = None
    falls: bool = False


def weighed_laws(first: FittedLaw, known: Mapping[int, tuple[float, float]]) -> list[FittedLaw]:
    """The law fitted first and the others that the slips do not exclude, with their weights; the likeliest first.

    Parameters
    ----------
    known : mean and standard deviation of parameters' logarithms, by index.
    """
    fits = [first]
    if int(first.problem.usable.sum()) >= LEAST_SLIPS:
        fits += [fit for law in LAWS if law != first.law and (fit := _fitted(law, first, known)) is not None]
    misfits = [misfit_of(fit.problem, fit.solution) for fit in fits]
    best = int(np.argmin(misfits))
    again = _fitted(first.law, fits[best], known) if best > 0 else None
    if again is not None and misfit_of(again.problem, again.solution) < misfits[0]:
        # The first one had been caught in a wrong valley, out of which the other law's fit shows the way.
        fits[0], misfits[0] = again, misfit_of(again.problem, again.solution)
        best = int(np.argmin(misfits))
    weights = np.exp(-0.5 * (np.array(misfits) - misfits[best]) / _repeated(fits[best].problem, fits[best].solution))
    weights /= weights.sum()
    found = [replace(fit, weight=float(weight)) for fit, weight in zip(fits, weights, strict=True) if weight > EXCLUDED]
    return sorted(found, key=lambda fit: -fit.weight)


def _fitted(law: str, first: FittedLaw, known: Mapping[int, tuple[float, float]]) -> FittedLaw | None:
    """Another law's fit, next to the one known; None if there is none."""
    problem = first.problem.with_law(LAWS[law])
    fit = first.solution.fit
    start = fit.parameters.copy()
    start[STRIBECK_VELOCITY] += math.log(HALF_SPEED[first.law] / HALF_SPEED[law])
    try:
        if first.solution.mean_square < _FITS and _is_hopeless(problem, start, first.solution):
            return None
        solution = fit_near(problem, start, fit, known)
    except LinAlgError:
        return None
    return replace(first, law=law, problem=problem, solution=solution)


def _is_hopeless(problem: SlipProblem, start: FloatArray, known: Solution) -> bool:
    """Whether a law, begun at a start, stays far worse than a solution of another law that leaves nothing over.

    A look at it takes a tenth of a fit, and most slips exclude all laws but one by thousands.
    """
    known.hand_to(problem)
    tolerances = Tolerances(balance=known.balance_error, level=known.link_error)
    begin = np.clip(start, known.prior.lower, known.prior.upper)
    far = known.fit.cost + max(_FAR, _FAR_SHARE * len(known.fit.residuals))
    looked = fit_slips(
        problem, known.prior, tolerances, parameters=begin, unknowns=known.fit.unknowns, iterations=_LOOK,
        enough=_ENOUGH, wanted=far,
    )  # fmt: skip
    return looked.cost > far


def fitted_with_more(
    first: FittedLaw, problem: SlipProblem, more: int, known: Mapping[int, tuple[float, float]]
) -> FittedLaw:
    """The fit of the same slips with more parameters, where it is good and worth them (BIC); else the first one.

    Parameters
    ----------
    problem : with so many more parameters. known : mean and standard deviation of parameters' logarithms, by index.
    """
    try:
        found = fit_near(problem, first.solution.fit.parameters, first.solution.fit, known)
    except LinAlgError:
        return first
    gain = misfit_of(first.problem, first.solution) - misfit_of(problem, found)
    if found.mean_square >= GOOD or gain < more * math.log(problem.count):
        return first
    return FittedLaw(law=first.law, problem=problem, solution=found)


def misfit_of(problem: SlipProblem, solution: Solution) -> float:
    """Twice the negative logarithm of the likelihood, but for a constant."""
    fit = solution.fit
    used = problem.weights > 0
    share = len(used) / max(int(used.sum()), 1)
    total = share * (robust(fit.residuals[used]) + 2.0 * float(np.log(problem.errors[used]).sum()))
    # Of what the slips show: F_s∞ may be anything where they all dwell as long, and must not weigh.
    least = _LEAST_BALANCE * usual_level(fit)
    for values, error in (
        (fit.misfits[problem.usable], max(solution.balance_error, least)),
        (fit.link_misfits[problem.linked], max(solution.link_error, _LEAST_LINK)),
    ):
        total += robust(values / error) + 2.0 * len(values) * math.log(error)
    return total


def _repeated(problem: SlipProblem, solution: Solution) -> float:
    """How many residuals say the same, at least one."""
    residuals: FloatArray = solution.fit.residuals
    used = problem.weights > 0
    ends = (np.diff(np.sign(residuals)) != 0) | (np.diff(problem.slip_of) != 0)
    runs = 1 + int(np.count_nonzero(ends[used[1:]]))
    return max(float(used.sum()) / runs / _WHITE, 1.0)
