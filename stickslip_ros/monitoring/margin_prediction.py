# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the equations expect of a joint: which friction to believe in, its margin, and the advice that follows."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, stability_margin
from stickslip_ros.monitoring.advice.adviser import Advice, AdviceQuestion, Adviser, CachingAdviser, no_advice
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop, criterion_for
from stickslip_ros.monitoring.belief import Belief, believed, much_the_same, uncertainty_of
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate
from stickslip_ros.monitoring.samples import FloatArray


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
        self._advice: Advice | None = None
        self._last: tuple[Belief, float, StabilityMargin, tuple[float, float]] | None = None
        self._basis: tuple[FrictionEstimate | None, Joint | None, Gains | None, bool] | None = None
        self.belief: Belief | None = None
        self.disbelief = ""

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
            self._advice = no_advice(belief.no_advice, abs(velocity), limits, gains_known=belief.gains_known)
            return self._advice
        question = AdviceQuestion(
            joint=belief.joint,
            gains=belief.gains,
            velocity=abs(velocity),
            limits=limits,
            uncertainty=belief.uncertainty,
            loop=loop,
            gains_known=belief.gains_known,
        )
        self._advice = self._adviser(question)
        return self._advice

    def damping_reserves(self, velocities: FloatArray, condition: Criterion) -> tuple[FloatArray, Criterion]:
        """Relative damping reserves ρ/ρ_c − 1 at velocities [rad/s], and by which condition; infinite where unknown."""
        reserves = np.full(len(velocities), np.inf)
        if self.belief is None and self._advice is None:
            return reserves, condition
        if self.belief is not None:
            condition = criterion_for(self.belief.joint, condition)
        if condition is Criterion.EXACT:
            # Worked out with the advice, if at all: an integration is too long for every batch of samples.
            if self._advice is not None and math.isfinite(self._advice.recommendation.reserve):
                reserves[:] = self._advice.recommendation.reserve
                return reserves, condition
            if self.belief is None or not self.belief.joint.friction.of_the_paper:
                return reserves, condition
            # Eq. (43) is the first answer, until there is the exact one.
            condition = Criterion.PAPER
        known = np.isfinite(velocities)
        if self.belief is not None and known.any():
            margin = stability_margin(self.belief.joint, self.belief.gains, velocities[known])
            found = np.asarray(margin.damping_reserve)
            reserves[known] = np.where(np.isnan(found), np.inf, found)
        return reserves, condition
