# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Optional terms of the friction model: fitted where a score test exceeds a threshold, else part of the errors.

Prior odds of a term are 1:1, with a normal prior of its parameter. The score test is one Gauss-Newton step from the fit
without the term. A term whose test exceeds `CLEARLY_BETTER` is added to the fit. Otherwise the posterior probability
of the term times its effect is added to the covariance of the other parameters (model averaging). A flexible term that
is added may stand for another effect: the change that it makes of the other parameters is part of their errors too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction.asymmetry import ASYMMETRY
from stickslip_ros.monitoring.friction.curved_viscous import CURVED_VISCOUS, CurvedViscous
from stickslip_ros.monitoring.friction.fit_errors import covariance_of
from stickslip_ros.monitoring.friction.fitted_law import (
    CLEARLY_BETTER,
    FittedLaw,
    ScoredTerm,
    residuals_per_observation,
)
from stickslip_ros.monitoring.friction.late_controller import HIDDEN_DELAY, LATE_CONTROLLER
from stickslip_ros.monitoring.friction.slip_fit import Tolerances, fit_at_fixed_parameters
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.yielding_contact import YIELDING_CONTACT
from stickslip_ros.monitoring.samples import FloatArray

_MUCH = 0.98  # parameter, of its upper bound: one that is larger is at its bound, as the fit stops short of it
# Tolerance, in slip distances, up to which a term may explain the misfit: larger ones have other causes.
_LITTLE = 0.005
# Probability that a flexible term stands for another effect that is as smooth, 1: as likely as not. The load of a
# flexible joint and bristles had curves of friction, with three to fifteen times the viscous friction.
_ANOTHER = 0.5
_FARTHEST = 2.0  # parameter, prior standard deviations: the linear step of the score test holds no further


@dataclass(frozen=True, kw_only=True)
class TermScore:
    """Score test of a term: one Gauss-Newton step of the term's parameter from a fit without the term.

    Attributes
    ----------
    value, std : posterior mean and standard deviation of the parameter. prior : its prior standard deviation.
    moves : change of the reported parameters and kinetic friction per unit of the parameter, shape (p + k,).
    gain : twice the logarithm of the likelihood ratio with and without the term.
    """

    value: float
    std: float
    prior: float
    moves: FloatArray
    gain: float

    @property
    def probability(self) -> float:
        """Posterior probability of the term, at prior odds of one."""
        odds = 0.5 * (self.value / self.std) ** 2 + math.log(self.std / self.prior)
        return 1.0 / (1.0 + math.exp(min(-odds, 700.0)))

    @property
    def mean_square(self) -> float:
        """Of the parameter by its posterior, with the probability that there is no term."""
        return self.probability * (self.value**2 + self.std**2)

    @property
    def covariance(self) -> FloatArray:
        """Covariance that the term may add to parameters and kinetic friction, shape (p + k, p + k)."""
        return np.asarray(self.mean_square * np.outer(self.moves, self.moves))


def with_shown_terms(fitted: FittedLaw) -> FittedLaw:
    """The fit with the terms that viscous friction next to none and creep at rest show, where these are worth it."""
    for term in (HIDDEN_DELAY, YIELDING_CONTACT):
        fitted = term.fitted(fitted)
    return fitted


def with_optional_terms(first: FittedLaw, beside: FittedLaw | None = None) -> FittedLaw:
    """The fit with every term that clearly explains the slips better, the most significant first; else the fit itself.

    The terms left out add to the covariance (`by_optional_terms`), and so do changes by those added. Where the law does
    not fit, residuals say nothing of the terms, and nothing is added.

    Parameters
    ----------
    beside : another law's fit of the same slips. If it has no curved viscous friction, this fit gets none: a wrong law
        with a curve explains much.
    """
    fitted = first
    straight = beside is not None and beside.problem.model.term(CurvedViscous) is None
    tried: set[ScoredTerm] = {CURVED_VISCOUS} if straight else set()
    moves: list[FloatArray] = []
    scores = _score_tests(fitted)
    while (best := _most_significant(fitted, {one: scores[one] for one in scores if one not in tried})) is not None:
        tried.add(best)
        found = replace(best, prior_evidence=scores[best] is not None).fitted(fitted)
        if found is not fitted and not _at_its_bound(found, best):
            if best.explains_misfit:
                moves.append(_shared(found) - _shared(fitted))
            fitted = found
            scores = _score_tests(fitted)
    covariance = sum((score.covariance for score in scores.values() if score is not None), start=np.zeros(()))
    own = len(fitted.solution.fit.parameters) - PARAMETERS
    for move in moves:
        all_of_it = np.insert(move, np.full(own, PARAMETERS), 0.0)
        covariance = covariance + _ANOTHER * np.outer(all_of_it, all_of_it)
    late = scores.get(LATE_CONTROLLER)
    return replace(
        fitted, by_optional_terms=np.asarray(covariance), late=None if late is None else math.sqrt(late.mean_square)
    )


def _shared(fitted: FittedLaw) -> FloatArray:
    """Parameters and kinetic friction of a fit, without what its optional terms have of their own."""
    fit = fitted.solution.fit
    return np.concatenate([fit.parameters[:PARAMETERS], fit.kinetic])


def _score_tests(fitted: FittedLaw) -> dict[ScoredTerm, TermScore | None]:
    """Score tests of the terms that a fit may lack; None where a test is not possible."""
    problems = {term: term.added(fitted) for term in SCORED_TERMS}
    return {term: _score_test(fitted, term, more) for term, more in problems.items() if more is not None}


def _most_significant(fitted: FittedLaw, left: Mapping[ScoredTerm, TermScore | None]) -> ScoredTerm | None:
    """The term to be fitted next; None if none is worth a fit."""
    gains = {term: score.gain for term, score in left.items() if score is not None and score.gain > CLEARLY_BETTER}
    if gains:
        return max(gains, key=lambda term: gains[term])
    # A term could explain the misfit that a wrong effort makes; and where residuals are large no term is enough.
    if not (0.0 < fitted.solution.left_over < _LITTLE and fitted.problem.may_be_late):
        return None
    return next((term for term, score in left.items() if score is None and term.explains_misfit), None)


def _at_its_bound(fitted: FittedLaw, term: ScoredTerm) -> bool:
    """Whether the term's parameter is at its bound: then something else is the cause."""
    column, prior = fitted.problem.column[term.name], fitted.solution.prior
    value = fitted.solution.fit.parameters[column]
    return bool(abs(value) > _MUCH * prior.upper[column])


def _score_test(fitted: FittedLaw, term: ScoredTerm, more: SlipProblem) -> TermScore | None:
    """Score test of a term, from the problem that has it; None where the law does not fit or no slip is simulated."""
    problem, solution = fitted.problem, fitted.solution
    if solution.tolerance > 0.0:
        return None
    fit, prior, noise = solution.fit, solution.prior, problem.noise
    more = more.weighed(fit.velocities, jitter=noise.jitter, usable=noise.usable)
    column, prior_std = more.column[term.name], more.term_parameters[term.name].std
    try:
        fixed_fit = fit_at_fixed_parameters(
            more, Tolerances(balance=solution.balance_error, level=solution.link_error),
            parameters=np.insert(fit.parameters, column, 0.0), kinetic=fit.kinetic, unknowns=fit.unknowns, iterations=0,
            scored=True,
        )  # fmt: skip
    except LinAlgError:
        return None
    others = np.delete(np.arange(len(fixed_fit.gradient)), column)
    moves = -covariance_of(fixed_fit.information[np.ix_(others, others)], prior) @ fixed_fit.information[others, column]
    # Correlated residuals count as one observation.
    repeats = residuals_per_observation(solution)
    own = (
        max(float(fixed_fit.information[column, column] + fixed_fit.information[column, others] @ moves), 0.0) / repeats
    )
    # A fit ends a little off its valley's floor, and a delay goes along that of viscous friction.
    pull = fixed_fit.gradient[others]
    pull[: len(fit.parameters)] += prior.information @ (prior.mean - fit.parameters)
    slope = float(fixed_fit.gradient[column] + moves @ pull) / repeats
    std = 1.0 / math.sqrt(own + prior_std**-2)
    value = max(slope * std**2, term.lower)
    gain = (value / std) ** 2
    # Slopes reach no further.
    value = min(max(value, -_FARTHEST * prior_std), _FARTHEST * prior_std)
    moves[: len(fit.parameters)] += term.reported_change(problem, fit.parameters)
    return TermScore(value=value, std=std, prior=prior_std, moves=moves, gain=gain)


SCORED_TERMS = (CURVED_VISCOUS, LATE_CONTROLLER, ASYMMETRY)
