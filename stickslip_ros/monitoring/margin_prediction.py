# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Prediction for a joint: the selected model, its margin, and the advice that follows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, damping_reserve, stability_margin
from stickslip_ros.monitoring.advice.adviser import Advice, AdviceQuestion, Adviser, CachingAdviser, no_advice
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop, criterion_for
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.selected_model import SelectedModel, approximately_equal, select_model, uncertainty_of

_SPEEDS_APART = 0.1  # difference of the logarithms of two speeds at which a reserve is integrated, 1
_TOLERANCE = 5e-3  # error of a critical damping ratio, of it: no status changes with it


class MarginPrediction:
    """See the module; :meth:`follow` says what is known now.

    Parameters
    ----------
    adviser : answers questions for advice, or returns None as long as it is at work; by default it answers at once.

    Attributes
    ----------
    selected : joint and gains to compute with, None if they are not known; why_none : what is missing then.
    """

    def __init__(self, adviser: Adviser | None = None) -> None:
        self._adviser = adviser or CachingAdviser()
        self._last: tuple[SelectedModel, float, StabilityMargin, tuple[float, float]] | None = None
        self._advised: tuple[AdviceQuestion, Advice] | None = None
        self._basis: tuple[FrictionEstimate | None, Joint | None, Gains | None, bool] | None = None
        self.selected: SelectedModel | None = None
        self.why_none = ""
        self._critical: tuple[SelectedModel, OperatingConditions, dict[int, float]] | None = None

    def follow(
        self, estimate: FrictionEstimate | None, configured: Joint | None, gains: Gains | None, *, velocity_loop: bool
    ) -> None:
        """Keep the model until it changes by more than 1 %; parameters as of :func:`select_model`."""
        basis = (estimate, configured, gains, velocity_loop)
        if self._basis is not None and all(one is other for one, other in zip(self._basis, basis, strict=True)):
            return
        selected, self.why_none = select_model(estimate, configured, gains, velocity_loop=velocity_loop)
        if selected is None or self.selected is None or not approximately_equal(selected, self.selected):
            self.selected = selected
        self._basis = basis

    def margin(self, velocity: float) -> tuple[StabilityMargin | None, str]:
        """The margin at a velocity [rad/s], or None; and why there is none, or it does not apply."""
        if self.selected is None:
            return None, self.why_none
        if not math.isfinite(velocity):
            return None, "the commanded velocity is not known"
        margin, _ = self._at(self.selected, velocity)
        return margin, str(margin.reason or "")

    def uncertainty(self, velocity: float) -> tuple[float, float]:
        """Of the margin at a velocity [rad/s] the standard error [M x˙_s²], and how probable stick-slip is by Eq. (43).

        NaN where they are not known.
        """
        return (math.nan, math.nan) if self.selected is None else self._at(self.selected, velocity)[1]

    def _at(self, selected: SelectedModel, velocity: float) -> tuple[StabilityMargin, tuple[float, float]]:
        last = self._last
        # Many a speed is asked for again and again: that of the reference, and the mean of the last cycles.
        if last is None or last[0] is not selected or last[1] != velocity:
            margin = stability_margin(selected.joint, selected.gains, velocity)
            last = self._last = (selected, velocity, margin, uncertainty_of(margin, selected, velocity))
        return last[2:]

    def advise(
        self, selected: SelectedModel, velocity: float, limits: AdviceLimits, loop: ObservedLoop
    ) -> Advice | None:
        """Advice by the selected model, None while it is being computed."""
        if selected.no_advice:
            return no_advice(selected.no_advice, abs(velocity), limits, gains_known=selected.gains_known)
        question = AdviceQuestion(
            joint=selected.joint,
            gains=selected.gains,
            velocity=abs(velocity),
            limits=limits,
            uncertainty=selected.uncertainty,
            loop=loop,
            gains_known=selected.gains_known,
        )
        if self._advised is not None and self._advised[0].comparable(question):
            question = replace(question, before=self._advised[1].recommendation)
        advice = self._adviser(question)
        if advice is not None:
            self._advised = (question, advice)
        return advice

    def damping_reserves(
        self, velocities: FloatArray, condition: Criterion, conditions: OperatingConditions
    ) -> tuple[FloatArray, Criterion]:
        """Relative damping reserves ρ/ρ_c − 1 at velocities [rad/s], and by which condition; NaN where unknown."""
        reserves = np.full(len(velocities), np.nan)
        speeds = np.abs(velocities)
        known = np.isfinite(speeds) & (speeds > 0)
        selected = self.selected
        if selected is None or not known.any() or not selected.gains.stiffness > 0:
            return reserves, condition
        condition = criterion_for(selected.joint, condition)
        joint = conditions.at_constant_speed.applied_to(selected.joint)
        if condition is Criterion.EXACT:
            if self._critical is None or self._critical[0] is not selected or self._critical[1] != conditions:
                self._critical = (selected, conditions, {})
            ratio = dimensionless_groups(joint, selected.gains, 1.0).damping_ratio
            critical = _critical_ratios(joint, selected.gains, speeds[known], self._critical[2])
            reserves[known] = damping_reserve(ratio, critical)
        else:
            reserves[known] = stability_margin(joint, selected.gains, speeds[known]).damping_reserve
        return reserves, condition


def _critical_ratios(joint: Joint, gains: Gains, speeds: FloatArray, known: dict[int, float]) -> FloatArray:
    """Critical damping ratios by integration at speeds [rad/s], interpolated between a few at which it is made.

    An integration takes a millisecond or more, and there are many batches of samples a second.

    Parameters
    ----------
    known : those that were integrated before, by the number of their speed; added to.
    """
    places = np.log(speeds) / _SPEEDS_APART
    below = np.floor(places).astype(int)
    missing = [node for node in np.unique([below, below + 1]).tolist() if node not in known]
    if missing:
        groups = dimensionless_groups(joint, gains, np.exp(_SPEEDS_APART * np.array(missing, dtype=float)))
        found = np.asarray(exact_critical_damping_ratio(groups, tolerance=_TOLERANCE))
        known.update(zip(missing, found.tolist(), strict=True))
    low, high = (np.array([known[node] for node in nodes.tolist()]) for nodes in (below, below + 1))
    return np.asarray(low + (places - below) * (high - low))
