# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A study: many slips fitted at once, and what later slips are compared with."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.monitoring.drive import drive_gains
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import LEVEL, STRIBECK
from stickslip_ros.monitoring.friction.asymmetry import AsymmetricStribeck
from stickslip_ros.monitoring.friction.curved_viscous import CurvedViscous
from stickslip_ros.monitoring.friction.dry_friction import PositionDisturbance
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.friction.estimation import (
    SlipsOnBristles,
    StudyQuestion,
    fitted_laws,
    friction_estimate,
    may_be_usable,
    unexplained,
)
from stickslip_ros.monitoring.friction.late_controller import Delay
from stickslip_ros.monitoring.friction.slip_fit import SlipFit
from stickslip_ros.monitoring.friction.slip_problem import SlipModel, SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.friction.trend import Trend
from stickslip_ros.monitoring.friction.yielding_contact import YieldingContact
from stickslip_ros.monitoring.samples import FloatArray

OUTLIERS_IN_A_ROW = 3  # slips that a study has to explain beside those of before, 1
_OFF = 0.15  # error of a slip's force or level, of the Stribeck friction: a fit with less explains the slip


@dataclass(frozen=True, kw_only=True)
class Learnt:
    """What a study found: the estimate, and what later slips are compared with.

    Fields that were renamed keep their keys in state files.

    Attributes
    ----------
    parameters : logarithms, by the law of the estimate. drifts : whether friction changes steadily; all is then as it
        is at the last slip.
    position_disturbance : force to be subtracted from that of further slips, None if none is.
    contact : what was known of one that yields, whose compliance is among the parameters; None else.
    curved_at : speed at which curved viscous friction is told [rad/s], whose curvature is among them; None else.
    asymmetric : whether Stribeck friction differs by direction, by how much being among them.
    explains : whether the fit, with what it has subtracted, explains the slips. explains_latest : whether it explains
        the latest ones, however well it explains the others.
    rejected : names of the laws that these slips have rejected for good.
    bristles : parameters of the joint on bristles that was fitted, shape (8,); None if none was.
    jitter : standard deviation of time stamps [s]. stribeck_fraction : share of F_s∞ left at the last arrest.
    """

    estimate: FrictionEstimate
    parameters: FloatArray
    kinetic: FloatArray
    balance_error: float
    jitter: float = field(metadata={"key": "stray"})
    tolerance: float
    link_error: float
    last_window: SlipWindow
    stribeck_fraction: float = field(metadata={"key": "remains"})
    drifts: bool = False
    position_disturbance: PositionDisturbance | None = field(default=None, metadata={"key": "surroundings"})
    contact: YieldingContact | None = None
    curved_at: float | None = None
    asymmetric: bool = False
    explains: bool = True
    explains_latest: bool = True
    rejected: tuple[str, ...] = field(default=(), metadata={"key": "hopeless"})
    bristles: FloatArray | None = None

    @property
    def model(self) -> SlipModel:
        """What was fitted, as it is at the last slip: the parameters are of this model."""
        model = SlipModel(law=LAWS[self.estimate.law])
        if self.estimate.late is not None:
            model = model.with_term(Delay())
        if self.contact is not None:
            model = model.with_term(self.contact)
        if self.curved_at is not None:
            model = model.with_term(CurvedViscous(speed=self.curved_at))
        if self.asymmetric:
            model = model.with_term(AsymmetricStribeck())
        return model


def study(question: StudyQuestion) -> Learnt | None:
    """Fit slips, from no guess at all if need be; None if nothing fits them. Pure: it may run in another process.

    An effort that explains too little, because it is noisy or none at all, must not cost what the motion shows alone.
    """
    found, windows = _fitted(question), question.windows
    explained = found is not None and found.estimate.usable and not found.estimate.mismatch
    integral = windows[0].gains is not None and windows[0].gains.integral != 0
    if windows[0].source is not ForceSource.EFFORT or explained or integral:
        return found
    without = [one.without_force() for one in windows]
    if not may_be_usable(without):
        # A search for what would not be believed takes seconds, and of these slips each asks for another.
        return found
    alone = _fitted(replace(question, windows=without, start=None, rejected=(), yields=False, bristles=None))
    if alone is None or not alone.estimate.usable:
        return found
    if found is None:
        return alone
    if found.estimate.usable and alone.estimate.mismatch:
        return found
    return replace(alone, estimate=replace(alone.estimate, drive=found.estimate.drive))


def _fitted(question: StudyQuestion) -> Learnt | None:
    """Result of a study; None if a number of it is not finite. A trial that overflows is one that fits badly."""
    try:
        with np.errstate(all="ignore"):
            found = _study(question)
    except LinAlgError:
        return None
    finite = found is not None and all(
        np.isfinite(one).all() for one in (found.parameters, found.kinetic, found.estimate.covariance)
    )
    return found if finite else None


def _study(question: StudyQuestion) -> Learnt | None:
    fits = fitted_laws(question)
    if not fits:
        return None
    problem, solution = fits[0].problem, fits[0].solution
    fit, curved = solution.fit, problem.model.term(CurvedViscous)
    without_drift, of_balance = problem.without_drift
    estimate = friction_estimate(fits, configured=question.configured is not None)
    if estimate.source is ForceSource.EFFORT:
        estimate = replace(estimate, drive=drive_gains(problem, fit.parameters, fit.unknowns))
    return Learnt(
        estimate=estimate,
        parameters=fit.parameters[without_drift],
        kinetic=fit.kinetic[of_balance],
        balance_error=solution.balance_error,
        jitter=problem.noise.jitter,
        tolerance=solution.tolerance,
        link_error=solution.link_error,
        last_window=problem.data.windows[-1],
        stribeck_fraction=stribeck_fraction(fit),
        drifts=problem.model.term(Trend) is not None,
        position_disturbance=fits[0].position_disturbance,
        contact=problem.model.term(YieldingContact),
        curved_at=None if curved is None else curved.speed,
        asymmetric=problem.model.term(AsymmetricStribeck) is not None,
        explains=not unexplained(fits[0]),
        explains_latest=_explains_latest(problem, fit),
        rejected=fits[0].rejected,
        bristles=fits[0].bristles[0].parameters if isinstance(fits[0], SlipsOnBristles) else None,
    )


def _explains_latest(problem: SlipProblem, fit: SlipFit) -> bool:
    """Whether all but one of the latest slips at most are neither set aside, nor off in force or in static friction."""
    latest = slice(-OUTLIERS_IN_A_ROW, None)
    force = np.abs(fit.misfits[latest]) / math.exp(fit.parameters[STRIBECK])
    level = np.where(problem.noise.linked, np.abs(fit.link_misfits), 0.0)[latest]
    return bool((problem.noise.usable[latest] & (force < _OFF) & (level < _OFF)).sum() >= OUTLIERS_IN_A_ROW - 1)


def stribeck_fraction(fit: SlipFit) -> float:
    """Share of F_s∞ left at the last arrest."""
    level = float(np.exp(fit.unknowns[-1, LEVEL])) * float(fit.found[-1, kernel.STRIBECK_FRACTION])
    return level / math.exp(fit.parameters[STRIBECK])
