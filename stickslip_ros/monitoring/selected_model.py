# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Selected model: joint and gains of the margin, estimated from the motion or configured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.margin import StabilityMargin, stability_margin
from stickslip_ros.monitoring.advice.limits import Criterion, criterion_for, crossover_frequency
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
    def of_the_paper(self) -> bool:
        """Whether Eq. (43) is of the joint."""
        return criterion_for(self.joint, Criterion.PAPER) is Criterion.PAPER

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
    draws = stability_margin(selected.uncertainty.joint, selected.uncertainty.drawn(selected.gains), velocity)
    probability = selected.uncertainty.bounded(float(np.mean(~np.asarray(draws.smooth))))
    return float(np.std(np.asarray(draws.energy_margin))), probability
