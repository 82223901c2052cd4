# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One law's fit of some slips, and how well it explains them.

How well is twice the negative logarithm of the likelihood, with the fit's own estimate of what it leaves unexplained.
Where residuals are not the sensor's noise, neighbours repeat each other: then only each run of residuals of one sign
counts as an observation of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from stickslip_ros.monitoring.friction.slip_equations import robust
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import FITS, GOOD, Solution, fit_near, glance, usual_level
from stickslip_ros.monitoring.friction.surroundings import Surroundings
from stickslip_ros.monitoring.samples import FloatArray

# No model is better than so of kinetic friction, as a share of the usual level, and of levels.
_LEAST_BALANCE, _LEAST_LINK = 2e-3, 1e-3
_WHITE = 2.0  # residuals in a run of one sign, if they are independent
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
    hopeless : laws that were looked at and that no more slips would make as good.
    swings : whether the joint's contact yields, and it slips again before it has come to rest on it.
    by_supplements : covariance of what :mod:`.supplements` that were not fitted may make of parameters and kinetic
        friction, shape (p + k, p + k), or 0.
    """

    law: str
    problem: SlipProblem
    solution: Solution
    weight: float = 1.0
    surroundings: Surroundings | None = None
    falls: bool = False
    hopeless: tuple[str, ...] = ()
    swings: bool = False
    by_supplements: FloatArray = field(default_factory=lambda: np.zeros(()))

    @property
    def fits(self) -> bool:
        """Whether it leaves nothing over."""
        return self.solution.tolerance == 0.0 and self.solution.mean_square < FITS


def fitted_with_more(
    first: FittedLaw,
    problem: SlipProblem,
    more: int,
    known: Mapping[int, tuple[float, float]],
    *,
    promises: bool = False,
) -> FittedLaw:
    """The fit of the same slips with more parameters, where it is good and worth them (BIC); else the first one.

    Parameters
    ----------
    problem : with so many more parameters. known : mean and standard deviation of parameters' logarithms, by index.
    promises : whether it is known that there is something to explain; else a few of the slips are asked first.
    """
    if not first.fits and not promises and not _promises(first, problem, more, known):
        return first
    try:
        found = fit_near(problem, first.solution.fit.parameters, first.solution.fit, known)
    except LinAlgError:
        return first
    gain = misfit_of(first.problem, first.solution, problem.observed) - misfit_of(problem, found)
    if found.mean_square >= GOOD or gain < more * math.log(problem.count):
        return first
    return replace(first, problem=problem, solution=found, by_supplements=np.zeros(()))


def _promises(first: FittedLaw, problem: SlipProblem, more: int, known: Mapping[int, tuple[float, float]]) -> bool:
    """Whether a few of the slips are worth the parameters: what explains what is left over is seen in them.

    Where no law fits, full fits take many times as long, and are in vain.
    """
    start = first.solution.fit.parameters
    problem.set_aside(~first.solution.usable)
    without, together = first.problem.spread(), problem.spread()
    fits = glance(without, start, known), glance(together, start, known)
    if fits[0] is None or fits[1] is None:
        return False
    return misfit_of(without, fits[0]) - misfit_of(together, fits[1]) > more * math.log(without.count)


def misfit_of(problem: SlipProblem, solution: Solution, nodes: NDArray[np.int64] | None = None) -> float:
    """Twice the negative logarithm of the likelihood, but for a constant.

    Parameters
    ----------
    nodes : the observed ones that count, of a problem of the same slips; all if None. Likelihoods of other observations
        say nothing of each other.
    """
    fit = solution.fit
    counted = np.ones(len(problem.observed), dtype=bool) if nodes is None else np.isin(problem.observed, nodes)
    used = (problem.weights > 0) & counted
    share = int(counted.sum()) / max(int(used.sum()), 1)
    total = share * (robust(fit.residuals[used]) + 2.0 * float(np.log(problem.errors[used]).sum()))
    # Of what the slips show: F_s∞ may be anything where they all dwell as long, and must not weigh.
    least = _LEAST_BALANCE * usual_level(fit)
    for values, error in (
        (fit.misfits[problem.usable], max(solution.balance_error, least)),
        (fit.link_misfits[problem.linked], max(solution.link_error, _LEAST_LINK)),
    ):
        total += robust(values / error) + 2.0 * len(values) * math.log(error)
    return total


def repeated(problem: SlipProblem, solution: Solution) -> float:
    """How many residuals say the same, at least one."""
    residuals: FloatArray = solution.fit.residuals
    used = problem.weights > 0
    ends = (np.diff(np.sign(residuals)) != 0) | (np.diff(problem.slip_of) != 0)
    runs = 1 + int(np.count_nonzero(ends[used[1:]]))
    return max(float(used.sum()) / runs / _WHITE, 1.0)
