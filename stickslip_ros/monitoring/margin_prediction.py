# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Prediction for a joint: the selected model, its margin, and the advice that follows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.margin import StabilityMargin, damping_reserve, stability_margin
from stickslip_ros.monitoring.advice.adviser import CachingAdviser, no_advice
from stickslip_ros.monitoring.advice.limits import (
    AdviceLimits,
    Criterion,
    ObservedLoop,
    criterion_for,
    crossover_frequency,
)
from stickslip_ros.monitoring.advice.recommendation import Advice, AdviceQuestion, Adviser
from stickslip_ros.monitoring.drive import DriveGains
from stickslip_ros.monitoring.friction.estimate import DRAWS, FrictionEstimate
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.monitoring.uncertainty import Uncertainty

_SAME = 0.01  # change of a parameter's logarithm or of its standard error, 1: with less results still hold
_VELOCITY_LOOP = (
    "velocities alone are commanded: Eq. (43) is of a position loop, whose stiffness a velocity loop has not; "
    "there a larger proportional gain, or a higher speed, makes stick-slip less likely"
)
_ERROR_FLOOR = 0.1  # error probability of results from a model that does not fit, 1: at least
_LEAST_VISCOUS = 0.01  # viscous friction that a late effort, or a model that does not fit, leaves of what was estimated
# Change of viscous friction in each draw where the model does not fit [N·m·s/rad]. What it does not explain, as a load
# on a spring, may look like viscous friction of many times the true one, so that half of the draws have hardly any.
_HALF_WITHOUT = np.where(np.arange(DRAWS) < DRAWS // 2, 0.0, -math.inf)
# Always the same ones, other than those of the friction, so that what is computed from them is smooth.
_NORMAL = np.random.default_rng(44).standard_normal((2, DRAWS))
_SPEEDS_APART = 0.1  # difference of the logarithms of two speeds at which a reserve is integrated, 1
_TOLERANCE = 5e-3  # error of a critical damping ratio, of it: no status changes with it


@dataclass(frozen=True, kw_only=True)
class SelectedModel:
    """Joint and gains of the margin, with their uncertainty.

    Attributes
    ----------
    joint, gains : as the margin has them.
    gains_known : whether these are gains of the controller's own; if not, advice is a factor.
    per_inertia : whether both are, gains and effort being unknown.
    uncertainty : None for what is configured.
    rests_on : in words.
    no_advice : why no gains can be advised, "" where they can.
    """

    joint: Joint
    gains: Gains
    uncertainty: Uncertainty | None
    gains_known: bool
    rests_on: str
    per_inertia: bool = False
    no_advice: str = ""

    @cached_property
    def crossover(self) -> float:
        """Crossover frequency of the position loop [rad/s]; 0 without stiffness."""
        return crossover_frequency(self.joint, self.gains) if self.gains.stiffness > 0 else 0.0


def approximately_equal(one: SelectedModel, other: SelectedModel) -> bool:
    """Whether two models differ by less than 1 %, so that results computed from one hold for the other.

    Estimates change slightly at every slip; below 1 % the cached results are kept.
    """
    kinds = [
        (
            selected.gains_known,
            selected.per_inertia,
            selected.uncertainty is None,
            *_laws(selected),
        )
        for selected in (one, other)
    ]
    if kinds[0] != kinds[1]:
        return False
    if one.uncertainty is None or other.uncertainty is None:
        return one == other
    if one.gains_known and one.gains != other.gains:
        return False
    values = np.array([_values(selected) for selected in (one, other)])
    spread = np.array([_values(selected, draws=True).std(axis=1) for selected in (one, other)])
    return bool(np.all(np.abs(values[0] - values[1]) < _SAME) and np.all(np.abs(spread[0] - spread[1]) < _SAME))


def _laws(selected: SelectedModel) -> list[str]:
    """The law of the joint, and others that it may have."""
    others = selected.uncertainty.others if selected.uncertainty else ()
    return [selected.joint.friction.law_in_words, *(other.joint.friction.law_in_words for other in others)]


def _values(selected: SelectedModel, *, draws: bool = False) -> FloatArray:
    """Logarithms of what the margin depends on."""
    joint = selected.uncertainty.joint if draws and selected.uncertainty else selected.joint
    friction, stiffness = joint.friction, np.asarray(selected.gains.stiffness, dtype=float)
    if draws and selected.uncertainty:
        stiffness = stiffness * selected.uncertainty.stiffness
    # Gains of the controller's own are compared as they are; what only shows is one with the joint's damping.
    damping = np.asarray(friction.viscous) + (0.0 if selected.gains_known else selected.gains.damping)
    late = 1.0 + selected.gains.stiffness * np.asarray(joint.actuation_delay) / (selected.gains.damping + damping)
    values = [friction.stribeck, friction.stribeck_velocity, friction.lag, friction.rise_time, damping, late]
    if not friction.rigid:
        values += [friction.presliding_stiffness, friction.presliding_damping, friction.coulomb]
    shape = np.broadcast_shapes(stiffness.shape, np.shape(friction.stribeck))
    return np.log([np.broadcast_to(np.maximum(value, TINY), shape) for value in (joint.inertia, stiffness, *values)])


def select_model(
    estimate: FrictionEstimate | None, configured: Joint | None, gains: Gains | None, *, velocity_loop: bool = False
) -> tuple[SelectedModel | None, str]:
    """The selected model, or None and what is missing.

    What was learnt counts before what is configured, which was its prior; but not if the model explains too little, or
    the configured joint is of another friction law, of which nothing is learnt.

    Parameters
    ----------
    gains : of the position loop, None if unknown.
    velocity_loop : whether velocities alone are commanded; without gains there is no position loop then.
    """
    if velocity_loop and gains is None:
        return None, _VELOCITY_LOOP
    if configured is not None and not configured.friction.of_the_paper:
        return _configured(
            configured, gains, f"friction of the law {configured.friction.law_in_words} is not estimated"
        )
    if estimate is not None and estimate.usable:
        selected = _learnt(estimate, gains)
        if selected is not None:
            if configured is not None:
                joint = replace(selected.joint, transmission=configured.transmission)
                selected = replace(selected, joint=joint)
            return replace(selected, no_advice=_why_no_advice(estimate, factors=selected.per_inertia)), ""
        if configured is None:
            return None, "the controller's gains are unknown, and the effort does not show them"
    mismatch = estimate.mismatch if estimate is not None else ""
    if configured is None:
        if mismatch:
            return None, f"{mismatch}; no joint is configured to take its place"
        return None, "inertia and friction of the joint are neither configured nor estimated"
    return _configured(configured, gains, mismatch)


def _configured(joint: Joint, gains: Gains | None, why: str) -> tuple[SelectedModel | None, str]:
    if gains is None:
        return None, "the controller's gains are unknown"
    rests_on = "; ".join(part for part in ("the configured friction", why) if part)
    return SelectedModel(joint=joint, gains=gains, uncertainty=None, gains_known=True, rests_on=rests_on), ""


def _why_no_advice(estimate: FrictionEstimate, *, factors: bool) -> str:
    """Why gains from an estimate would be a guess, and which data would help; "" if they would be none."""
    more = "record the effort, or the reference beside the controller's gains" if estimate.normalised else ""
    if estimate.is_a_guess:
        guess = "the friction could not be determined from this motion"
        return f"{guess}; {more or 'let the joint slip at another speed, too'}"
    # A factor multiplies the damping that slips show; on a flexible load that was up to 28 times the true one.
    if factors and estimate.mismatch:
        return f"the friction model does not fit the slips, and only they show the damping that is to change; {more}"
    return ""


def _learnt(estimate: FrictionEstimate, gains: Gains | None) -> SelectedModel | None:
    drive = estimate.drive
    if gains is None and drive is not None:
        return _as_the_effort_shows(estimate.with_stiffness(drive.stiffness, drive.damping), drive)
    if gains is not None and gains.stiffness > 0:
        estimate = estimate.with_stiffness(float(gains.stiffness), float(gains.damping))
    known = gains if not estimate.normalised else estimate.gains
    if known is None:
        return None
    joint = estimate.joint()
    return SelectedModel(
        joint=joint if estimate.late is None else estimate.late.applied_to(joint),
        gains=known,
        uncertainty=_uncertainty(estimate, known),
        gains_known=not estimate.normalised,
        rests_on=estimate.summary(),
        per_inertia=estimate.normalised,
    )


def _uncertainty(estimate: FrictionEstimate, known: Gains) -> Uncertainty:
    """The joint as it may be, by each law."""

    def drawn(one: FrictionEstimate) -> tuple[Joint, FloatArray]:
        joint, stiffness = one.draws()
        if one.late is not None:
            joint = one.late.drawn(joint, _NORMAL)
        return joint, stiffness / float(known.stiffness) if one.normalised else np.ones_like(stiffness)

    return _over_laws(estimate, drawn)


def _over_laws(
    estimate: FrictionEstimate, drawn: Callable[[FrictionEstimate], tuple[Joint, FloatArray]]
) -> Uncertainty:
    laws = []
    for weight, one in estimate.by_law():
        joint, ratios = drawn(one)
        if one.curvature is not None:
            joint = one.curvature.drawn(joint)
        if one.mismatch:
            joint = _with_viscous(joint, _HALF_WITHOUT)
        error_floor = _ERROR_FLOOR if one.mismatch or one.may_be_late else 0.0
        laws.append(Uncertainty(joint=joint, stiffness=ratios, weight=weight, error_floor=error_floor))
    return replace(laws[0], others=tuple(laws[1:]))


def _as_the_effort_shows(estimate: FrictionEstimate, drive: DriveGains) -> SelectedModel:
    """Joint and gains in the effort's units, where the gains are unknown."""
    # The effort's delay moves damping from the one to the other; only the sum counts, and it must not be negative.
    late = min(drive.damping, 0.0)
    deviation = drive.damping_std * _NORMAL[0]
    spread = drive.stiffness_std / drive.stiffness * _NORMAL[1]
    return SelectedModel(
        joint=_with_viscous(estimate.joint(), late),
        gains=Gains(stiffness=drive.stiffness, damping=max(drive.damping, 0.0)),
        uncertainty=_over_laws(estimate, lambda one: (_with_viscous(one.draws()[0], late + deviation), np.exp(spread))),
        gains_known=False,
        rests_on=f"{estimate.summary()}; stiffness {drive.stiffness:.4g} N·m/rad and damping {drive.damping:.3g} "
        "N·m·s/rad of the controller estimated from the effort, since its gains are unknown",
    )


def _with_viscous(joint: Joint, more: Real) -> Joint:
    """The joint with more viscous friction [N·m·s/rad], or with less as far as there is some."""
    viscous = joint.friction.viscous
    changed = np.maximum(np.asarray(viscous) + more, _LEAST_VISCOUS * np.asarray(viscous))
    return replace(joint, friction=replace(joint.friction, viscous=changed if changed.ndim else float(changed)))


def uncertainty_of(margin: StabilityMargin, selected: SelectedModel, velocity: float) -> tuple[float, float]:
    """Standard error of the energy margin [M x˙_s²] and the probability of stick-slip by Eq. (43); NaN if unknown."""
    if selected.uncertainty is None or not margin.applicable:
        return math.nan, math.nan
    gains = Gains(
        stiffness=float(selected.gains.stiffness) * selected.uncertainty.stiffness,
        damping=selected.gains.damping,
    )
    draws = stability_margin(selected.uncertainty.joint, gains, velocity)
    probability = selected.uncertainty.bounded(float(np.mean(~np.asarray(draws.smooth))))
    return float(np.std(np.asarray(draws.energy_margin))), probability


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
