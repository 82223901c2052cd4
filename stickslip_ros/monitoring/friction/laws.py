# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction laws fitted side by side to the same slips, and how far the slips speak for each.

The weight of a law is its posterior probability, all being equally likely before and having as many parameters:
exp(-½ Δ) of the difference of twice the negative logarithms of their likelihoods.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, misfit_of, residuals_per_observation
from stickslip_ros.monitoring.friction.late_controller import may_hide_a_delay
from stickslip_ros.monitoring.friction.optional_terms import with_optional_terms, with_shown_terms
from stickslip_ros.monitoring.friction.screening import same_curve, same_parameters, screen_law
from stickslip_ros.monitoring.friction.slip_solution import fit_near
from stickslip_ros.monitoring.friction.trend import TREND
from stickslip_ros.monitoring.samples import FloatArray

EXCLUDED = 0.02  # weight of a law, 1: the data exclude a law of less
LEAST_SLIPS = 8  # usable slips that distinguish laws, 1: at least


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
    nodes = reduce(np.intersect1d, [fit.problem.observed for fit in fits])
    return [misfit_of(fit.solution, nodes) for fit in fits]


def _beside(law: str, first: FittedLaw) -> FittedLaw | None:
    """Another law's fit of the same slips; None if it would be far worse, or there is none."""
    if first.position_disturbance is not None:
        # The same position-dependent forces are subtracted for both laws.
        return _near(first, law, same_parameters(law, first), first)
    screening = screen_law(law, first)
    if screening is None or screening.rejected or not (first.fits or screening.better):
        return None
    try:
        solution = fit_near(first.problem.plain(LAWS[law]), screening.start, first.solution.fit)
    except LinAlgError:
        return None
    # Delay, yielding contact, trend and optional terms are selected for each law by itself.
    other = with_shown_terms(FittedLaw(law=law, solution=solution))
    return with_optional_terms(TREND.fitted(other), beside=first)


def _again(first: FittedLaw, better: FittedLaw) -> FittedLaw | None:
    """The first law fitted from where another one has led to; None if nothing can be fitted there."""
    again = _near(first, first.law, same_curve(first.law, better), better)
    if again is None or first.position_disturbance is not None:
        return again
    return with_optional_terms(with_shown_terms(again))


def _near(first: FittedLaw, law: str, start: FloatArray, shape: FittedLaw) -> FittedLaw | None:
    """A law fitted to the slips as the first fit has them, from a start and the levels of another fit."""
    try:
        problem = first.problem.with_model(replace(first.problem.model, law=LAWS[law]))
        solution = fit_near(problem, start, shape.solution.fit)
    except LinAlgError:
        return None
    return replace(first.refitted(solution), law=law)
