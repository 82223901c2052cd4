# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Which laws of friction and which optional terms are fitted to slips, and how far the slips speak for each.

Laws are fitted side by side to the same slips. The weight of a law is its posterior probability, all being equally
likely before and having as many parameters: exp(-½ Δ) of the difference of twice the negative logarithms of their
likelihoods.

The fit of a law ends in the valley in which it begins, and the parameters that one law needs can be far from those of
another: where the Stribeck friction falls to nothing at once, a law with a long tail takes more of it, less Coulomb
friction and more viscous friction for the same curve. So another law is screened from the curve, not from the
parameters; and both laws are fitted to the same few slips, with ever smaller tolerances of the ties between slips.

Optional terms are fitted where a score test exceeds a threshold, else they are part of the errors. Prior odds of a term
are 1:1, with a normal prior of its parameter. The score test is one Gauss-Newton step from the fit without the term. A
term whose test exceeds `CLEARLY_BETTER` is added to the fit. Otherwise the posterior probability of the term times its
effect is added to the covariance of the other parameters (model averaging). A flexible term that is added may stand for
another effect: the change that it makes of the other parameters is part of their errors too.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import LAWS, stribeck_friction
from stickslip_ros.monitoring.friction._window_kernel import STRIBECK, STRIBECK_VELOCITY, VISCOUS
from stickslip_ros.monitoring.friction.asymmetry import ASYMMETRY
from stickslip_ros.monitoring.friction.curved_viscous import CURVED_VISCOUS, CurvedViscous
from stickslip_ros.monitoring.friction.fit_errors import covariance_of
from stickslip_ros.monitoring.friction.fitted_law import (
    CLEARLY_BETTER,
    FittedLaw,
    ScoredTerm,
    misfit_of,
    of_law,
    residuals_per_observation,
)
from stickslip_ros.monitoring.friction.late_controller import (
    HIDDEN_DELAY,
    LATE_CONTROLLER,
    may_hide_a_delay,
    model_of,
)
from stickslip_ros.monitoring.friction.slip_fit import Tolerances, fit_at_fixed_parameters
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import fit_near, truncated_fit, usual_level
from stickslip_ros.monitoring.friction.trend import TREND
from stickslip_ros.monitoring.friction.yielding_contact import YIELDING_CONTACT
from stickslip_ros.monitoring.samples import FloatArray

EXCLUDED = 0.02  # weight of a law, 1: the data exclude a law of less
LEAST_SLIPS = 8  # usable slips that distinguish laws, 1: at least
_WORSE = 60.0  # twice the logarithm of a likelihood ratio, 1: with more, more slips do not change the order of laws
_SPEEDS = 64  # speeds at which curves are compared, 1
_SCALES = np.geomspace(0.4, 2.5, 15)  # Stribeck velocities that are tried, of the one fitted
_MUCH = 0.98  # parameter, of its upper bound: one that is larger is at its bound, as the fit stops short of it
# Tolerance, in slip distances, up to which a term may explain the misfit: larger ones have other causes.
_LITTLE = 0.005
# Probability that a flexible term stands for another effect that is as smooth, 1: as likely as not. The load of a
# flexible joint and bristles had curves of friction, with three to fifteen times the viscous friction.
_ANOTHER = 0.5
_FARTHEST = 2.0  # parameter, prior standard deviations: the linear step of the score test holds no further


def weighed_laws(first: FittedLaw, rejected: Collection[str] = ()) -> list[FittedLaw]:
    """The law fitted first and the others that the slips do not exclude, with their weights; the likeliest first.

    Parameters
    ----------
    rejected : laws that fewer of these slips have excluded; they count as such as long as the first one fits.
    """
    fits, given_up = [first], []
    if int(first.problem.noise.usable.sum()) >= LEAST_SLIPS and not first.cut_short:
        for law in LAWS:
            if law == first.law:
                continue
            other = None if law in rejected and first.fits else _beside(law, first)
            if other is None:
                given_up.append(law)
            else:
                fits.append(other)
    misfits = _misfits(fits)
    best = int(np.argmin(misfits))
    again = _again(first, fits[best]) if best > 0 else None
    with_it = [] if again is None else _misfits([again, *fits])
    if again is not None and with_it[0] < with_it[1]:
        # The first one had been caught in a wrong valley, out of which the other law's fit shows the way.
        fits[0], misfits = again, [with_it[0], *with_it[2:]]
        best = int(np.argmin(misfits))
    if may_hide_a_delay(fits[0]):
        # What is left of the delay may be what speaks for another law: as far as is known, each is as likely.
        misfits = [misfits[best]] * len(fits)
    weights = np.exp(-0.5 * (np.array(misfits) - misfits[best]) / residuals_per_observation(fits[best].solution))
    weights /= weights.sum()
    found = [
        replace(fit, weight=float(weight), rejected=() if first.cut_short else tuple(given_up))
        for fit, weight in zip(fits, weights, strict=True)
        if weight > EXCLUDED
    ]
    return sorted(found, key=lambda fit: -fit.weight)


def _misfits(fits: list[FittedLaw]) -> list[float]:
    """What each does not explain of the observations that all of them have."""
    nodes = reduce(np.intersect1d, [fit.problem.data.observed for fit in fits])
    return [misfit_of(fit.solution, nodes) for fit in fits]


def _beside(law: str, first: FittedLaw) -> FittedLaw | None:
    """Another law's fit of the same slips; None if it would be far worse, or there is none."""
    if first.position_disturbance is not None:
        # The same position-dependent forces are subtracted for both laws.
        return _near(first, law, of_law(law, first.solution.fit.parameters, first.law), first)
    start, worse = _screened(law, first)
    if worse > _WORSE or not (first.fits or worse < -CLEARLY_BETTER):
        return None
    problem = first.problem
    plain = problem.changed(model=model_of(problem.data.windows, LAWS[law], problem.model.known))
    solution = fit_near(plain, start, first.solution.fit)
    if solution is None:
        return None
    # Delay, yielding contact, trend and optional terms are selected for each law by itself.
    other = with_shown_terms(FittedLaw(solution=solution))
    return with_optional_terms(TREND.fitted(other), beside=first)


def _again(first: FittedLaw, better: FittedLaw) -> FittedLaw | None:
    """The first law fitted from where another one has led to; None if nothing can be fitted there."""
    again = _near(first, first.law, _same_curve(first.law, better), better)
    if again is None or first.position_disturbance is not None:
        return again
    return with_optional_terms(with_shown_terms(again))


def _near(first: FittedLaw, law: str, start: FloatArray, shape: FittedLaw) -> FittedLaw | None:
    """A law fitted to the slips as the first fit has them, from a start and the levels of another fit."""
    problem = first.problem.changed(model=replace(first.problem.model, law=LAWS[law]))
    solution = fit_near(problem, start, shape.solution.fit)
    return None if solution is None else first.refitted(solution)


def _screened(law: str, first: FittedLaw) -> tuple[FloatArray, float]:
    """Screening of a law against the one fitted first, both on the same few slips.

    Returns the logarithms from which to fit the law to all slips, shape (6,), and twice the logarithm of the likelihood
    ratio of the first law and this one; infinite if no slip can be simulated.
    """
    some, start = first.problem.spread(), _same_curve(law, first)
    theirs = truncated_fit(some, first.solution.fit.parameters)
    found = truncated_fit(some.changed(model=replace(some.model, law=LAWS[law])), start) if theirs is not None else None
    if theirs is None or found is None:
        return start, math.inf
    worse = (misfit_of(found) - misfit_of(theirs)) / residuals_per_observation(theirs)
    return found.fit.parameters[:PARAMETERS], worse


def _same_curve(law: str, first: FittedLaw) -> FloatArray:
    """Logarithms of the parameters of a law with which friction over speed is most nearly what the first fit has."""
    fit, problem = first.solution.fit, first.problem
    start = of_law(law, fit.parameters, first.law)
    level, unit = usual_level(fit), math.exp(fit.parameters[STRIBECK_VELOCITY])
    speeds = np.abs(fit.velocities)
    speeds = speeds[speeds > 0.0]
    if not len(speeds):
        return start  # no slip moves in that fit
    speeds = np.quantile(speeds, np.linspace(0.0, 1.0, _SPEEDS))
    curve = np.asarray(stribeck_friction(LAWS[first.law], level, speeds / unit))
    curve += math.exp(fit.parameters[VISCOUS]) * speeds
    usual = problem.data.usual_speed
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
