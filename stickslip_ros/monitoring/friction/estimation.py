# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""From slips to an estimate of friction: which slips, by which laws, with what errors.

Simulated slips are fitted to observed positions, Eq. (4) with (5) and (6); nothing is differentiated. A prior is of
the paper's law: the values of another would mean something else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._friction_law import LUGRE, PAPERS_LAW
from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.friction import _bristle_kernel as bristle
from stickslip_ros.monitoring.friction._window_kernel import (
    INERTIA,
    LAG,
    RISE_TIME,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.asymmetry import asymmetry_of, in_the_worse_direction
from stickslip_ros.monitoring.friction.bristles import MOST_ON_BRISTLES, BristleContact, BristleFit, bristle_fits
from stickslip_ros.monitoring.friction.curved_viscous import curvature_of
from stickslip_ros.monitoring.friction.dry_friction import LEAST_OF_A_DIRECTION, dry_friction_of
from stickslip_ros.monitoring.friction.estimate import (
    CUT_SHORT,
    DOES_NOT_FIT,
    IDENTIFIED,
    NOT_ESTIMATED,
    USABLE_ASIDE,
    FrictionEstimate,
    LawAlternative,
    ParameterEstimate,
)
from stickslip_ros.monitoring.friction.fit_errors import robust_covariance
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, of_law
from stickslip_ros.monitoring.friction.friction_factor import friction_factor_of, with_position_disturbance
from stickslip_ros.monitoring.friction.kept_slips import KeptSlips
from stickslip_ros.monitoring.friction.late_controller import (
    at_the_latest_gains,
    delay_estimate,
    may_hide_a_delay,
    model_of,
)
from stickslip_ros.monitoring.friction.model_selection import weighed_laws, with_optional_terms, with_shown_terms
from stickslip_ros.monitoring.friction.profile_likelihood import covariance_by_profile
from stickslip_ros.monitoring.friction.slip_data import SlipData
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, Budget, SlipProblem
from stickslip_ros.monitoring.friction.slip_search import search
from stickslip_ros.monitoring.friction.slip_solution import FITS, truncated_fit
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow, contradiction
from stickslip_ros.monitoring.friction.trend import TREND, Trend
from stickslip_ros.monitoring.friction.yielding_contact import fit_with_contact
from stickslip_ros.monitoring.samples import FloatArray

# Steps of simulation in a study, 1: 5 to 8 s of a core. Friction that varies with position takes up to 2.1e7, other
# slips that the model explains up to 1e7, most of them less than 1e6.
MOST_STEPS = 2.5e7
LEAST_SLIPS = 3  # slips, 1: fewer are not fitted
_KNOWN_SPREAD = 0.7  # standard deviation of a configured value's logarithm, 1: right within a factor of two
_SCATTER = 0.05  # variation of the kinetic friction from slip to slip, of the Stribeck friction
_ON_BRISTLES = [INERTIA, VISCOUS, STRIBECK_VELOCITY, STRIBECK]  # parameters that a joint on bristles has
_ASIDE = 0.34  # slips that nothing explains, of all slips


@dataclass(frozen=True, kw_only=True)
class SlipsOnBristles(FittedLaw):
    """Fit of a law that does not explain the slips, of a joint whose contact yields.

    Attributes
    ----------
    bristles : fits of the same slips by a joint on bristles, the likeliest curve first: the estimate is theirs.
    """

    bristles: tuple[BristleFit, ...]


@dataclass(frozen=True, kw_only=True)
class StudyQuestion:
    """What a study is made of.

    Attributes
    ----------
    windows : the slips. configured : prior, or None. start : logarithms that fitted earlier slips under the paper's
        law, or None.
    rejected : laws that earlier slips have excluded, and LUGRE if they excluded bristles. yields : whether they were of
        a contact that yields. bristles : parameters of a joint on bristles that fitted them, or None.
    most_steps : steps of simulation; a study that would take more is cut short, and its estimate says so.
    """

    windows: list[SlipWindow]
    configured: Joint | None = None
    start: FloatArray | None = None
    rejected: tuple[str, ...] = ()
    yields: bool = False
    bristles: FloatArray | None = None
    most_steps: float = MOST_STEPS


def estimate_friction(windows: list[SlipWindow], configured: Joint | None = None) -> FrictionEstimate | None:
    """Estimate from all slips at once; None if there are too few, or nothing fits.

    Parameters
    ----------
    windows : in order of time. Where forces are known of some slips and not of others, the known ones count.
    configured : a prior, right within a factor of two or so; where the data speak they outweigh it.

    Raises
    ------
    InvalidParameterError
        If the prior is of another law than the paper's.
    """
    chosen = KeptSlips(best_known(windows)).windows
    if len(chosen) < LEAST_SLIPS:
        return None
    fits = fitted_laws(StudyQuestion(windows=chosen, configured=configured))
    return friction_estimate(fits, configured=configured is not None) if fits else None


def fitted_laws(question: StudyQuestion) -> list[FittedLaw]:
    """The laws that slips do not exclude, fitted to them, the paper's first if it is among them; none if nothing fits.

    Where the steps of simulation are spent, the fits end where they are.
    """
    configured, start, rejected = question.configured, question.start, question.rejected
    windows = _of_known_directions(question.windows, np.ones(len(question.windows), dtype=bool))
    budget = Budget(question.most_steps)
    known = _prior_knowledge(configured, normalised=windows[0].source is ForceSource.SPEED)
    problem = SlipProblem(SlipData(windows), model_of(windows, known=known), budget=budget)
    excluded, tried = LUGRE in rejected, False
    if question.bristles is not None and start is not None:
        # No search for what else may explain the slips, where a fit near the earlier one does not.
        near = truncated_fit(problem.spread(), start)
        if near is not None and not FittedLaw(solution=near).fits:
            if found := bristle_fits(windows, question.bristles):
                return [SlipsOnBristles(solution=near, bristles=found)]
            tried = True
    solution = fit_with_contact(problem, start) if question.yields and start is not None else None
    if solution is None and (solution := search(problem, start)) is not None:
        # Slips set aside say nothing of their direction; with those of one alone nothing tells the load from friction.
        kept = _of_known_directions(windows, solution.problem.noise.usable)
        if len(kept) < len(windows):
            solution = search(SlipProblem(SlipData(kept), model_of(kept, known=known), budget=budget), start)
    if solution is None:
        return []
    plain = FittedLaw(solution=solution)
    # Joints on bristles are no paper's joint with a term more; slips that begin slowly are in vain fitted as others.
    if not plain.fits and not excluded:
        if not tried and (found := bristle_fits(windows, question.bristles)):
            return [SlipsOnBristles(solution=solution, bristles=found)]
        excluded = len(windows) >= MOST_ON_BRISTLES
    steady = with_shown_terms(plain)
    first = with_optional_terms(TREND.fitted(steady))
    fits = weighed_laws(first, rejected)
    # A force that varies with position explains much of what another law does: the laws come first.
    why = unexplained(fits[0]) or ("kinetic friction varies" if fits[0].problem.model.term(Trend) else "")
    if why and not first.problem.data.normalised and not first.unsettled:
        # What varies with position may look like a trend, or like a late controller.
        best, trend = fits[0], first.problem.model.term(Trend) is not None
        for base in (with_optional_terms(steady) if trend else first, plain):
            over_position = with_position_disturbance(base, why)
            if over_position.misfit < best.misfit:
                best = over_position
            if not unexplained(best) or first.solution is solution:
                break
        if best is not fits[0]:
            fits = weighed_laws(best, rejected)
    if excluded:
        fits = [replace(fit, rejected=(*fit.rejected, LUGRE)) for fit in fits]
    return sorted(fits, key=lambda fit: fit.law != PAPERS_LAW)


def may_be_usable(windows: list[SlipWindow]) -> bool:
    """Whether an estimate from these slips may be usable: not if too many are set aside before anything is fitted."""
    data = SlipData(_of_known_directions(windows, np.ones(len(windows), dtype=bool)))
    return bool((~data.single).sum() <= USABLE_ASIDE * data.count)


def _of_known_directions(windows: list[SlipWindow], usable: NDArray[np.bool_]) -> list[SlipWindow]:
    """All of them, or those of one direction where there are hardly any usable ones of the other."""
    counts = {one: sum(w.direction == one for w, good in zip(windows, usable, strict=True) if good) for one in (1, -1)}
    more = 1 if counts[1] >= counts[-1] else -1
    enough = counts[-more] >= LEAST_OF_A_DIRECTION
    return windows if enough else [window for window in windows if window.direction == more]


def best_known(windows: list[SlipWindow]) -> list[SlipWindow]:
    """The windows whose force has the best source that enough of them have."""
    for source in (ForceSource.GAINS, ForceSource.EFFORT):
        chosen = [window for window in windows if window.source is source]
        if len(chosen) >= max(LEAST_SLIPS, 0.5 * len(windows)):
            return chosen
    return [window for window in windows if window.source is ForceSource.SPEED]


def _prior_knowledge(joint: Joint | None, *, normalised: bool) -> dict[int, tuple[float, float]]:
    """Mean and standard deviation of the parameters' logarithms that a configured joint gives."""
    if joint is None:
        return {}
    if not joint.friction.of_the_paper:
        needed = f"a joint of the law that is fitted, {PAPERS_LAW}"
        raise InvalidParameterError("prior", needed, joint.friction.law_in_words)
    friction = joint.friction
    known = {
        STRIBECK_VELOCITY: float(friction.stribeck_velocity),
        LAG: float(friction.lag),
        RISE_TIME: float(friction.rise_time),
    }
    if not normalised:
        known |= {
            INERTIA: float(joint.inertia),
            VISCOUS: float(friction.viscous),
            STRIBECK: float(friction.stribeck),
        }
    return {index: (math.log(value), _KNOWN_SPREAD) for index, value in known.items() if value > 0}


def friction_estimate(fits: list[FittedLaw], *, configured: bool) -> FrictionEstimate:
    """The estimate by the first law, as it is at the latest slip, with what speaks against it."""
    if isinstance(fits[0], SlipsOnBristles):
        return _on_bristles(fits[0].bristles)
    problem, solution, covariance = fits[0].problem, fits[0].solution, covariance_over_laws(fits)
    fit = solution.fit
    aside = int((~problem.noise.usable).sum())
    # The subtracted force is only nearly the right one, so the fit without it is not certain either.
    disturbance = fits[0].position_disturbance
    why = disturbance.without if disturbance is not None else unexplained(fits[0])
    reservations = (
        f"{DOES_NOT_FIT}: {why}" if why else "",
        CUT_SHORT if fits[0].cut_short else "",
        contradiction(problem.data.windows),
    )
    mismatch = "; ".join(filter(None, reservations))
    parameters, at_the_end = _as_reported(problem, fit.parameters, covariance)
    coulomb = load = together = NOT_ESTIMATED
    if not problem.data.normalised:
        of_balance = problem.without_drift[1]
        variances = np.diag(at_the_end)[len(parameters) + of_balance]
        coulomb, load, together = _dry_parts(
            fit.kinetic[of_balance],
            np.sqrt(np.clip(variances, 0.0, None)),
            math.exp(parameters[STRIBECK]),
            certain=not mismatch,
        )
    return FrictionEstimate(
        source=problem.data.windows[0].source,
        normalised=problem.data.normalised,
        logarithms=parameters[:PARAMETERS],
        covariance=at_the_end[:PARAMETERS, :PARAMETERS],
        coulomb=coulomb,
        load=load,
        coulomb_and_load=together,
        slips=problem.data.count - aside,
        aside=aside,
        mean_square=solution.mean_square,
        left_over=solution.left_over,
        scatter=solution.friction_scatter,
        mismatch=mismatch,
        configured=configured,
        law=fits[0].law,
        alternatives=tuple(_alternative(other) for other in fits[1:]),
        dry=None if problem.data.normalised else dry_friction_of(problem, fit),
        friction_factor=friction_factor_of(fits[0], covariance),
        late=delay_estimate(problem, fit.parameters, covariance),
        may_be_late=may_hide_a_delay(fits[0]),
        curvature=curvature_of(fits[0], covariance),
        asymmetry=asymmetry_of(fits[0], covariance),
    )


def _dry_parts(
    kinetic: FloatArray, errors: FloatArray, stribeck: float, *, certain: bool
) -> tuple[ParameterEstimate, ParameterEstimate, ParameterEstimate]:
    """Coulomb friction, load, and their sum against the motion where it has but one direction.

    Parameters
    ----------
    kinetic, errors : Coulomb friction and load, or their sum alone, and standard errors [N·m]. stribeck : F_s∞ [N·m].
    certain : whether anything may be identified.
    """
    scale = abs(float(kinetic[0])) + stribeck
    found = [
        ParameterEstimate(
            value=float(value), std=float(error), identified=float(error) <= IDENTIFIED * scale and certain
        )
        for value, error in zip(kinetic, errors, strict=True)
    ]
    if len(found) > 1:
        return found[0], found[1], NOT_ESTIMATED
    together = found[0]
    coulomb = ParameterEstimate(value=max(together.value, 0.0), std=abs(together.value), identified=False)
    return coulomb, NOT_ESTIMATED, together


def unexplained(fitted: FittedLaw) -> str:
    """What a fit does not explain, "" if it explains all."""
    problem, solution = fitted.problem, fitted.solution
    scatter = solution.friction_scatter / math.exp(solution.fit.parameters[STRIBECK])
    aside = int((~problem.noise.usable).sum())
    reasons = []
    if solution.tolerance > 0.0:
        reasons.append(f"error {100 * solution.left_over:.2g} % of a slip")
    elif solution.mean_square > FITS:
        reasons.append(f"residuals {math.sqrt(solution.mean_square):.2f} times the errors of the positions")
    if scatter > _SCATTER:
        reasons.append(f"kinetic friction varies by {100 * scatter:.2g} % of the Stribeck friction from slip to slip")
    if fitted.unsettled:
        reasons.append("its contact yields, and the joint slips again before it has come to rest")
    if aside > _ASIDE * problem.data.count:
        reasons.append(f"{aside} of {problem.data.count} slips do not fit at all")
    return "; ".join(reasons)


def covariance_over_laws(fits: list[FittedLaw]) -> FloatArray:
    """Covariance of the first law's parameters and kinetic friction: its own, and how far the others' are off."""
    first = fits[0]
    covariance = _covariance(first)
    for other in fits[1:]:
        off = _off(first, other)
        covariance = covariance + other.weight * np.outer(off, off)
    return covariance


def _covariance(fitted: FittedLaw) -> FloatArray:
    """Of one law's parameters and kinetic friction, with what was not fitted, but may make something of them."""
    covariance = robust_covariance(fitted.problem, fitted.solution.fit, fitted.solution.prior, fitted.late)
    return np.asarray(covariance + covariance_by_profile(fitted.solution) + fitted.by_optional_terms)


def _off(first: FittedLaw, other: FittedLaw) -> FloatArray:
    """How far another law's parameters and kinetic friction are off the first one's, shape (p + k,) of the first.

    Of what only one of them has, a trend or a delay, nothing can be said.
    """
    size = len(first.solution.fit.parameters)
    off = np.zeros(size + len(first.solution.fit.kinetic))
    # The Stribeck velocity is each law's own.
    mine, theirs = (of_law(PAPERS_LAW, one.solution.fit.parameters, one.law) for one in (first, other))
    off[:PARAMETERS] = theirs - mine
    both = min(len(one.problem.without_drift[1]) for one in (first, other))
    off[size : size + both] = other.solution.fit.kinetic[:both] - first.solution.fit.kinetic[:both]
    return off


def _alternative(fit: FittedLaw) -> LawAlternative:
    solution = fit.solution
    covariance = _covariance(fit)
    parameters, covariance = _as_reported(fit.problem, solution.fit.parameters, covariance)
    return LawAlternative(
        law=fit.law,
        weight=fit.weight,
        logarithms=parameters[:PARAMETERS],
        covariance=covariance[:PARAMETERS, :PARAMETERS],
    )


def _on_bristles(fits: tuple[BristleFit, ...]) -> FrictionEstimate:
    """The estimate of a joint on bristles, by the likeliest of its Stribeck curves."""
    first, found = fits[0], [_bristle_values(fit) for fit in fits]
    aside = int((~first.noise.usable).sum())
    # Motion one way does not tell a load from Coulomb friction, and leaves the load no error.
    shown = [bristle.COULOMB, bristle.LOAD] if first.covariance[bristle.LOAD, bristle.LOAD] > 0.0 else [bristle.COULOMB]
    kinetic, errors = first.parameters[shown], np.sqrt(np.diag(first.covariance)[shown])
    kinetic[0] = math.exp(kinetic[0])
    errors[0] *= kinetic[0]
    coulomb, load, together = _dry_parts(kinetic, errors, math.exp(first.parameters[bristle.STRIBECK]), certain=True)
    # How far the others' values are off is part of the errors.
    covariance = found[0].covariance
    for other in found[1:]:
        off = of_law(PAPERS_LAW, other.logarithms, other.law) - of_law(PAPERS_LAW, found[0].logarithms, first.law)
        covariance = covariance + other.weight * np.outer(off, off)
    return FrictionEstimate(
        source=ForceSource.GAINS,
        normalised=False,
        logarithms=found[0].logarithms,
        covariance=covariance,
        coulomb=coulomb,
        load=load,
        coulomb_and_load=together,
        slips=first.data.count - aside,
        aside=aside,
        mean_square=first.mean_square,
        left_over=0.0,
        scatter=0.0,
        mismatch=contradiction(first.data.windows),
        configured=False,
        law=first.law,
        alternatives=tuple(found[1:]),
        contact=found[0].contact,
    )


def _bristle_values(fit: BristleFit) -> LawAlternative:
    """What a fit has, in the order of :class:`FrictionEstimate`; its lag and rise time stand for none."""
    order = [bristle.INERTIA, bristle.VISCOUS, bristle.STRIBECK_VELOCITY, bristle.STRIBECK]
    contact = [bristle.STIFFNESS, bristle.BRISTLE_DAMPING]
    logarithms, covariance = np.zeros(PARAMETERS), np.zeros((PARAMETERS + 2, PARAMETERS + 2))
    logarithms[_ON_BRISTLES] = fit.parameters[order]
    places = [*_ON_BRISTLES, PARAMETERS, PARAMETERS + 1]
    covariance[np.ix_(places, places)] = fit.covariance[np.ix_([*order, *contact], [*order, *contact])]
    return LawAlternative(
        law=fit.law,
        weight=fit.weight,
        logarithms=logarithms,
        covariance=covariance[:PARAMETERS, :PARAMETERS],
        contact=BristleContact.of(fit.parameters[contact], covariance),
    )


def _as_reported(problem: SlipProblem, parameters: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters and covariance at the latest gains, in the direction in which there is more friction."""
    return in_the_worse_direction(problem, *at_the_latest_gains(problem, parameters, covariance))
