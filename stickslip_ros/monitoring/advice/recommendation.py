# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recommended gains: three variants, and what is in the way where there are none. `recommend.py` computes them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from stickslip_ros.model.friction import Gains
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.advice.search import Obstruction
from stickslip_ros.monitoring.advice.sensitivity import Sensitivity


class Kind(str, Enum):
    """Which gains advice may change."""

    LEAST_CHANGE = "least_change"
    DAMPING_ONLY = "damping_only"
    STIFFNESS_ONLY = "stiffness_only"


@dataclass(frozen=True, kw_only=True)
class Variant:
    """Gains to use, or why there are none.

    Attributes
    ----------
    kind : which gains it may change.
    stiffness : k_p [N·m/rad], damping : k_v [N·m·s/rad]; NaN if there are none.
    reason : one sentence for a person.
    energy_margin : of Eq. (43) with these gains [M x˙_s²].
    reserve : ρ/ρ_c − 1 with these gains, by the condition asked for.
    outcome : what becomes of the joint when Eqs (4)-(6) are integrated, from the worst start; None without an answer.
    stiffness_factor, damping_factor : of the present stiffness, and of the damping of controller and viscous
        friction together: what is left of advice where the gains are unknown. The latter is NaN where the present
        damping is not known well enough.
    damping_time : damping of controller and viscous friction together over stiffness [s], in any units of the gains.
    change : √((3 ln)² of the one + ln² of the other).
    bandwidth : crossover frequency of the position loop [rad/s].
    tracking_error_factor : of the tracking error at constant speed, friction over k_p where nothing integrates.
    noise_factor : of the effort that noise in the measured velocity makes, k_v times it; infinite from no k_v on.
    """

    kind: Kind
    stiffness: float
    damping: float
    reason: str
    energy_margin: float = math.nan
    reserve: float = math.nan
    outcome: Outcome | None = None
    stiffness_factor: float = math.nan
    damping_factor: float = math.nan
    damping_time: float = math.nan
    change: float = math.nan
    bandwidth: float = math.nan
    tracking_error_factor: float = math.nan
    noise_factor: float = math.nan

    @property
    def found(self) -> bool:
        """Whether there are gains to recommend."""
        return math.isfinite(self.stiffness)

    @property
    def exactly_smooth(self) -> bool | None:
        """Whether stick-slip dies out, integrated from the worst start; None without an answer."""
        return None if self.outcome is None else self.outcome is not Outcome.STICKS

    @property
    def slides_steadily(self) -> bool | None:
        """Whether it moves steadily in the end, from the worst start; None without an answer."""
        return None if self.outcome is None else self.outcome is Outcome.STEADY

    @property
    def gains(self) -> Gains:
        """The gains, without integral action."""
        return Gains(stiffness=self.stiffness, damping=self.damping)


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """Advice for one joint.

    Attributes
    ----------
    variants : one of each kind, in the order of :class:`Kind`.
    velocity : the slowest speed at which the joint is to be smooth [rad/s].
    condition : what the advice satisfies; gains_known : False if it is in factors only.
    present : the present gains, judged like those of the variants; None where there is no advice.
    keep : whether the present gains reach the wanted margin.
    obstruction : what is in the way where no gains are found, and the best within reach.
    slowest_smooth_velocity : from which on the joint is smooth with the advised gains, or with the best within
        reach [rad/s]; NaN if unknown.
    resonance : which gains excite the resonance of motor and load, in words; of a joint without one, that the gains
        may excite one that is not known, where they raise the bandwidth much and no limit is set for it; or "".
    beside : the least change by the other condition, Eq. (43) with nothing said of swinging, or the exact one; None
        where the other one has no answer.
    """

    variants: tuple[Variant, ...]
    velocity: float
    condition: Criterion
    gains_known: bool = True
    present: Variant | None = None
    keep: bool = False
    obstruction: Obstruction | None = None
    slowest_smooth_velocity: float = math.nan
    resonance: str = ""
    beside: Variant | None = None

    @property
    def reserve(self) -> float:
        """ρ/ρ_c − 1 of the present gains, by the condition asked for; NaN if unknown."""
        return math.nan if self.present is None else self.present.reserve

    def __getitem__(self, kind: Kind) -> Variant:
        return self.variants[list(Kind).index(kind)]


def without_gains(reason: str, velocity: float, condition: Criterion, *, gains_known: bool) -> Recommendation:
    """Advice that has no gains, of any kind, and why."""
    variants = tuple(Variant(kind=kind, stiffness=math.nan, damping=math.nan, reason=reason) for kind in Kind)
    return Recommendation(variants=variants, velocity=velocity, condition=condition, gains_known=gains_known)


@dataclass(frozen=True, kw_only=True)
class Advice:
    """The answer.

    Attributes
    ----------
    recommendation : gains.
    sensitivities : what lubricant and mechanics could do; empty where there is no margin.
    lowest_smooth_velocity : with the present gains, by Eq. (43) [rad/s]; NaN if unknown.
    """

    recommendation: Recommendation
    sensitivities: tuple[Sensitivity, ...]
    lowest_smooth_velocity: float


def no_advice(reason: str, velocity: float, limits: AdviceLimits, *, gains_known: bool) -> Advice:
    """The answer where none can be given, and why."""
    return Advice(
        recommendation=without_gains(f"no advice: {reason}", velocity, limits.condition, gains_known=gains_known),
        sensitivities=(),
        lowest_smooth_velocity=math.nan,
    )
