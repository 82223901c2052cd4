# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction that changes steadily while slips are observed, as a joint's does that warms up.

Fitted where the balance of forces shows it, and kept where it explains more than its two parameters are worth (BIC):
the kinetic friction grows by so much from the first slip to the last, Stribeck and viscous friction by a share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip_ros.monitoring.friction.dry_friction import LEAST_SLIPS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ModelTerm
from stickslip_ros.monitoring.friction.slip_fit import Prior
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.samples import FloatArray


def knowledge_without_drift(problem: SlipProblem, information: FloatArray, prior: Prior) -> tuple[FloatArray, Prior]:
    """Information on parameters and kinetic friction, (p + k, p + k), and prior, without those of a trend.

    These are at the last slip what they are; the trend itself is as uncertain as it was and says no more.
    """
    if problem.covariate is None:
        return information, prior
    without_drift, of_balance = problem.without_drift
    size = len(prior.mean)
    kept = np.concatenate([without_drift, size + of_balance])
    left = np.setdiff1d(np.arange(len(information)), kept)
    own = information[np.ix_(left, left)].copy()
    own[0, 0] += prior.information[size - 1, size - 1]
    between = information[np.ix_(kept, left)]
    return (
        information[np.ix_(kept, kept)] - between @ np.linalg.pinv(own, hermitian=True) @ between.T,
        Prior(
            mean=prior.mean[without_drift],
            information=prior.information[np.ix_(without_drift, without_drift)],
            lower=prior.lower[without_drift],
            upper=prior.upper[without_drift],
        ),
    )


def _shows(first: FittedLaw) -> bool:
    """Whether a straight line over time explains enough of the kinetic friction for a trend to be tried."""
    problem, used = first.problem, first.problem.noise.usable
    count = int(used.sum())
    if count < LEAST_SLIPS:
        return False
    misfits, columns = first.solution.fit.misfits[used], problem.balance[used]
    steady, changing = (
        misfits - one @ np.linalg.lstsq(one, misfits, rcond=None)[0]
        for one in (columns, np.column_stack([columns, problem.since[used]]))
    )
    return bool(float(steady @ steady) > count ** (1.0 / count) * float(changing @ changing))


def _added(fitted: FittedLaw) -> SlipProblem | None:
    if fitted.problem.normalised or fitted.solution.tolerance > 0 or not _shows(fitted):
        return None
    return fitted.problem.changed(model=replace(fitted.problem.model, trend=True))


TREND = ModelTerm(added=_added, parameters=2)
