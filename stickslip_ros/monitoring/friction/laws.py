# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction laws fitted side by side to the same slips, and how far the slips speak for each.

The weight of a law is its posterior probability, all being equally likely before and having as many parameters:
exp(-½ Δ) of the difference of twice the negative logarithms of their likelihoods.

The fit of a law ends in the valley in which it begins, and the parameters that one law needs can be far from those of
another: where the Stribeck friction falls to nothing at once, a law with a long tail takes more of it, less Coulomb
friction and more viscous friction for the same curve. So another law is screened from the curve, not from the
parameters; and both laws are fitted to the same few slips, with ever smaller tolerances of the ties between slips.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from functools import reduce

import numpy as np

from stickslip_ros.model._friction_law import LAWS, stribeck_friction
from stickslip_ros.monitoring.friction._window_kernel import STRIBECK, STRIBECK_VELOCITY, VISCOUS
from stickslip_ros.monitoring.friction.fitted_law import (
    CLEARLY_BETTER,
    FittedLaw,
    misfit_of,
    of_law,
    residuals_per_observation,
)
from stickslip_ros.monitoring.friction.late_controller import may_hide_a_delay, model_of
from stickslip_ros.monitoring.friction.optional_terms import with_optional_terms, with_shown_terms
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS
from stickslip_ros.monitoring.friction.slip_solution import fit_near, truncated_fit, usual_level
from stickslip_ros.monitoring.friction.trend import TREND
from stickslip_ros.monitoring.samples import FloatArray

EXCLUDED = 0.02  # weight of a law, 1: the data exclude a law of less
LEAST_SLIPS = 8  # usable slips that distinguish laws, 1: at least
_WORSE = 60.0  # twice the logarithm of a likelihood ratio, 1: with more, more slips do not change the order of laws
_SPEEDS = 64  # speeds at which curves are compared, 1
_SCALES = np.geomspace(0.4, 2.5, 15)  # Stribeck velocities that are tried, of the one fitted


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
