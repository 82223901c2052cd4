# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One law's fit of some slips, and how well it explains them.

How well is twice the negative logarithm of the likelihood, with the fit's own estimate of what it leaves unexplained.
Where residuals are not the sensor's noise, neighbours repeat each other: then only each run of residuals of one sign
counts as an observation of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.monitoring.friction._window_kernel import STRIBECK_VELOCITY
from stickslip_ros.monitoring.friction.dry_friction import PositionDisturbance
from stickslip_ros.monitoring.friction.slip_fit import SlipFit, robust
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import (
    FITS,
    GOOD,
    LEAST_LINK,
    Solution,
    fit_near,
    scatter_of,
    truncated_fit,
)
from stickslip_ros.monitoring.samples import FloatArray

_LEAST_BALANCE = 2e-3  # error of kinetic friction, of the usual force: no model is better
# Twice the logarithm of a likelihood ratio, 1: above it a law or a term is clearly better. BIC asks for less than half
# as much; but noise exceeds that now and then in many slips and repeated studies, and wider errors do less harm than a
# false term.
CLEARLY_BETTER = 10.0
# Speed at which the Stribeck friction has fallen to half, in Stribeck velocities.
_HALF_SPEED = {"hess_soom": 1.0, "exponential": math.sqrt(math.log(2.0))}


@dataclass(frozen=True, kw_only=True)
class FittedLaw:
    """One law's fit of some slips.

    Attributes
    ----------
    weight : from 0 to 1; those of all laws add up to 1.
    position_disturbance : force subtracted from that of the problem's slips, None if none is.
    rejected : names of the laws that screening has rejected for good.
    unsettled : whether the joint's contact yields, and the joint slips again before it has come to rest on the contact.
    by_optional_terms : covariance of parameters and kinetic friction that optional terms which were not fitted may
        cause, see :mod:`.model_selection`, shape (p + k, p + k), or 0.
    late : root mean square of the controller's delay where it is not fitted [sample intervals], by its posterior; None
        where the slips say nothing of it.
    """

    solution: Solution
    weight: float = 1.0
    position_disturbance: PositionDisturbance | None = None
    rejected: tuple[str, ...] = ()
    unsettled: bool = False
    by_optional_terms: FloatArray = field(default_factory=lambda: np.zeros(()))
    late: float | None = None

    @property
    def law(self) -> str:
        """Name of the law."""
        return next(name for name, number in LAWS.items() if number == self.problem.model.law)

    @property
    def problem(self) -> SlipProblem:
        """The problem of its slips, with the noise of the fit."""
        return self.solution.problem

    @property
    def fits(self) -> bool:
        """Whether it leaves nothing over."""
        return self.solution.tolerance == 0.0 and self.solution.mean_square < FITS

    def term_parameter(self, name: str, covariance: FloatArray) -> tuple[float, float]:
        """A term's parameter and its standard error, by the covariance of all parameters, shape (p + k, p + k)."""
        column = self.problem.column[name]
        return float(self.solution.fit.parameters[column]), math.sqrt(max(float(covariance[column, column]), 0.0))

    def refitted(self, solution: Solution) -> FittedLaw:
        """The same with another fit of the slips, of which the optional terms are not known yet."""
        return replace(self, solution=solution, by_optional_terms=np.zeros(()), late=None)

    @property
    def may_lack_terms(self) -> bool:
        """Whether a scored term may be missing: not where only speeds are known, or a subtracted force nearly right."""
        return not (self.problem.data.normalised or self.position_disturbance is not None or self.unsettled)

    @property
    def cut_short(self) -> bool:
        """Whether the study had no time for all that could be tried."""
        return self.problem.budget.spent

    @property
    def misfit(self) -> float:
        """Twice the negative logarithm of the likelihood, but for a constant."""
        return misfit_of(self.solution)


@dataclass(frozen=True, kw_only=True)
class ModelTerm:
    """Optional term of the friction model, with parameters of its own.

    Attributes
    ----------
    added : the problem of a fit's slips with the term; None where nothing shows that the fit may lack the term.
    parameters : how many.
    prior_evidence : whether the slips are known to need the term; else a fit of a few slips has to show it first.
    settles : whether a joint whose fit has the term comes to rest; if not the fit without the term is `unsettled`.
    """

    added: Callable[[FittedLaw], SlipProblem | None]
    parameters: int = 1
    prior_evidence: bool = False
    settles: Callable[[Solution], bool] = lambda solution: True

    def fitted(self, first: FittedLaw) -> FittedLaw:
        """The fit with the term, where it is good and worth the parameters (BIC); else the first one."""
        problem = None if first.cut_short else self.added(first)
        if problem is None:
            return first
        if not first.fits and not self.prior_evidence and not _worth_the_parameters(first, problem, self.parameters):
            return first
        found = fit_near(problem, first.solution.fit.parameters, first.solution.fit)
        if found is None:
            return first
        gain = misfit_of(first.solution, problem.data.observed) - misfit_of(found)
        if found.mean_square >= GOOD or gain < self.parameters * math.log(problem.data.count):
            return first
        return first.refitted(found) if self.settles(found) else replace(first, unsettled=True)


@dataclass(frozen=True, kw_only=True)
class ScoredTerm(ModelTerm):
    """Optional term of one parameter with a prior mean of zero, to which :mod:`.model_selection` applies a score test.

    Attributes
    ----------
    name : of the parameter, as of :attr:`.SlipProblem.column`. lower : its lower bound in the score test.
    reported_change : change of the reported parameters per unit of the term's, from a problem without it and its
        parameters, shape (p,).
    explains_misfit : whether the term is so flexible that it may stand for another effect. It is also tried where no
        law fits, if a truncated fit of a few slips is better with the term.
    """

    name: str
    reported_change: Callable[[SlipProblem, FloatArray], FloatArray] = lambda problem, parameters: np.zeros(
        len(parameters)
    )
    lower: float = -math.inf
    explains_misfit: bool = False


def _worth_the_parameters(first: FittedLaw, problem: SlipProblem, more: int) -> bool:
    """Whether a few of the slips are worth the parameters: what explains what is left over is seen in them.

    Where no law fits, full fits take many times as long, and are in vain.
    """
    start = first.solution.fit.parameters
    without, together = first.problem.spread(), problem.without(~first.problem.noise.usable).spread()
    fits = truncated_fit(without, start), truncated_fit(together, start)
    if fits[0] is None or fits[1] is None:
        return False
    return misfit_of(fits[0]) - misfit_of(fits[1]) > more * math.log(without.data.count)


def misfit_of(solution: Solution, nodes: NDArray[np.int64] | None = None) -> float:
    """Twice the negative logarithm of the likelihood, but for a constant.

    Parameters
    ----------
    nodes : the observed ones that count, of a problem of the same slips; all if None. Likelihoods of other observations
        say nothing of each other.
    """
    problem, fit = solution.problem, solution.fit
    shared = np.ones(len(problem.data.observed), dtype=bool) if nodes is None else np.isin(problem.data.observed, nodes)
    used = problem.noise.counted & shared
    share = int(shared.sum()) / max(int(used.sum()), 1)
    total = share * (robust(fit.residuals[used]) + 2.0 * float(np.log(problem.noise.errors[used]).sum()))
    # A floor that is the same for all fits of the slips: one of a fit's own level would prefer a law of less.
    balance = fit.misfits[problem.noise.usable]
    for values, error in (
        (balance, max(scatter_of(balance), _LEAST_BALANCE * _usual_force(problem, fit))),
        (fit.link_misfits[problem.noise.linked], max(solution.link_error, LEAST_LINK)),
    ):
        total += robust(values / error) + 2.0 * len(values) * math.log(error)
    return total


def _usual_force(problem: SlipProblem, fit: SlipFit) -> float:
    """Half of what the force on the joint falls by in a usual slip [N·m]: about the level of its Stribeck friction."""
    stiffness = float(np.median(problem.stiffness(fit.parameters)))
    if stiffness > 0.0:
        return 0.5 * stiffness * problem.data.usual_distance
    return 0.5 * float(np.median([np.ptp(window.forces) for window in problem.data.windows]))


def residuals_per_observation(solution: Solution) -> float:
    """Residuals per independent observation, by runs of one sign; at least one."""
    problem = solution.problem
    return problem.data.mean_run(problem.noise.counted, solution.fit.residuals)


def of_law(law: str, parameters: FloatArray, own_law: str) -> FloatArray:
    """Logarithms of the parameters, shape (6,), with the Stribeck velocity at which a law has fallen to half too."""
    changed = parameters[:PARAMETERS].copy()
    changed[STRIBECK_VELOCITY] += math.log(_HALF_SPEED[own_law] / _HALF_SPEED[law])
    return np.asarray(changed)
