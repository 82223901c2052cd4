# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the equations expect of a joint: which friction to believe in, its margin, and the advice that follows."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stickslip_ros.model.controlled import OperatingConditions
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, damping_reserve, stability_margin
from stickslip_ros.monitoring.advice.adviser import Advice, AdviceQuestion, Adviser, CachingAdviser, no_advice
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop, criterion_for
from stickslip_ros.monitoring.belief import Belief, believed, much_the_same, uncertainty_of
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.samples import FloatArray

_SPEEDS_APART = 0.1  # difference of the logarithms of two speeds at which a reserve is integrated
_TOLERANCE = 5e-3  # relative error of a critical damping ratio that makes no difference to a status


class MarginPrediction:
    """See the module; :meth:`follow` says what is known now.

    Parameters
    ----------
    adviser : answers questions for advice, or returns None as long as it is at work; by default it answers at once.

    Attributes
    ----------
    belief : joint and gains to compute with, None if they are not known; disbelief : what is missing then.
    """

    def __init__(self, adviser: Adviser | None = None) -> None:
        self._adviser = adviser or CachingAdviser()
        self._last: tuple[Belief, float, StabilityMargin, tuple[float, float]] | None = None
        self._advised: tuple[AdviceQuestion, Advice] | None = None
        self._basis: tuple[FrictionEstimate | None, Joint | None, Gains | None, bool] | None = None
        self.belief: Belief | None = None
        self.disbelief = ""
        self._critical: tuple[Belief, OperatingConditions, dict[int, float]] | None = None

    def follow(
        self, estimate: FrictionEstimate | None, configured: Joint | None, gains: Gains | None, *, velocity_loop: bool
    ) -> None:
        """Believe the same as before until something has changed that matters; parameters as of :func:`believed`."""
        basis = (estimate, configured, gains, velocity_loop)
        if self._basis is not None and all(one is other for one, other in zip(self._basis, basis, strict=True)):
            return
        belief, self.disbelief = believed(estimate, configured, gains, velocity_loop=velocity_loop)
        if belief is None or self.belief is None or not much_the_same(belief, self.belief):
            self.belief = belief
        self._basis = basis

    def margin(self, velocity: float) -> tuple[StabilityMargin | None, str]:
        """The margin at a velocity [rad/s], or None; and why there is none, or it does not apply."""
        if self.belief is None:
            return None, self.disbelief
        if not math.isfinite(velocity):
            return None, "the commanded velocity is not known"
        margin, _ = self._at(self.belief, velocity)
        return margin, str(margin.reason or "")

    def uncertainty(self, velocity: float) -> tuple[float, float]:
        """Of the margin at a velocity [rad/s] the standard error [M x˙_s²], and how probable stick slip is by Eq. (43).

        NaN where they are not known.
        """
        return (math.nan, math.nan) if self.belief is None else self._at(self.belief, velocity)[1]

    def _at(self, belief: Belief, velocity: float) -> tuple[StabilityMargin, tuple[float, float]]:
        last = self._last
        # Many a speed is asked for again and again: that of the reference, and the mean of the last cycles.
        if last is None or last[0] is not belief or last[1] != velocity:
            margin = stability_margin(belief.joint, belief.gains, velocity)
            last = self._last = (belief, velocity, margin, uncertainty_of(margin, belief, velocity))
        return last[2:]

    def advise(self, belief: Belief, velocity: float, limits: AdviceLimits, loop: ObservedLoop) -> Advice | None:
        """Advice on the joint as it is believed to be, None as long as it is being worked out."""
        if belief.no_advice:
            return no_advice(belief.no_advice, abs(velocity), limits, gains_known=belief.gains_known)
        question = AdviceQuestion(
            joint=belief.joint,
            gains=belief.gains,
            velocity=abs(velocity),
            limits=limits,
            uncertainty=belief.uncertainty,
            loop=loop,
            gains_known=belief.gains_known,
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
        belief = self.belief
        if belief is None or not known.any() or not belief.gains.stiffness > 0:
            return reserves, condition
        condition = criterion_for(belief.joint, condition)
        joint = conditions.at_constant_speed.applied_to(belief.joint)
        if condition is Criterion.EXACT:
            if self._critical is None or self._critical[0] is not belief or self._critical[1] != conditions:
                self._critical = (belief, conditions, {})
            ratio = dimensionless_groups(joint, belief.gains, 1.0).damping_ratio
            critical = _critical_ratios(joint, belief.gains, speeds[known], self._critical[2])
            reserves[known] = damping_reserve(ratio, critical)
        else:
            reserves[known] = stability_margin(joint, belief.gains, speeds[known]).damping_reserve
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
