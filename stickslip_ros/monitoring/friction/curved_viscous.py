# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Viscous friction that is no straight line over speed: F_v y˙ (1 - c + c y˙/v) in place of F_v y˙.

Grease thins, and oil is churned. F_v is reported at the speed v, at which friction takes as much as it does on average
in a slip.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.monitoring.friction.estimate import Curvature
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ScoredTerm
from stickslip_ros.monitoring.friction.late_controller import may_hide_a_delay
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

_SWIFT = 1.33  # speed, of the mean of a slip that is half a sine: friction takes as much there as on average


def curvature_of(fitted: FittedLaw, covariance: FloatArray) -> Curvature | None:
    """Of viscous friction over speed; None where it is taken for a straight line."""
    problem = fitted.problem
    if problem.model.curved_at is None:
        return None
    column = problem.column["curvature"]
    return Curvature(
        value=float(fitted.solution.fit.parameters[column]),
        std=math.sqrt(max(float(covariance[column, column]), 0.0)),
        speed=problem.model.curved_at,
    )


def _with_curve(fitted: FittedLaw) -> SlipProblem | None:
    """The problem with viscous friction that may be a curve: where it is hardly seen that is no question."""
    problem = fitted.problem
    if not fitted.may_lack_terms or problem.model.curved_at is not None or may_hide_a_delay(fitted):
        return None
    return problem.changed(model=replace(problem.model, curved_at=_SWIFT * problem.usual_speed))


CURVED_VISCOUS = ScoredTerm(
    name="curvature",
    added=_with_curve,
    reported_change=lambda problem, parameters: np.zeros(len(parameters)),
    lower=-math.inf,
    explains_misfit=True,
)
