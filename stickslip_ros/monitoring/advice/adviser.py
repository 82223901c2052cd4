# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Question and answer of advice: what a monitor requests, in its own thread or another."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import lowest_smooth_velocity
from stickslip_ros.monitoring.advice.limits import AdviceLimits, ObservedLoop
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Recommendation, without_gains
from stickslip_ros.monitoring.advice.sensitivity import Sensitivity, sensitivities
from stickslip_ros.monitoring.uncertainty import Uncertainty

_COMPARABLE = 2.0  # ratio of speeds, up to which an answer is shown until the next is computed
# Relative differences, up to which an answer is kept.
_SAME_SPEED = 0.01  # changes the advised gains by less than they are printed to
_SAME_RATE = 0.05  # of the sample rate, which is estimated
_SAME_ERROR = 0.2  # of position and velocity errors, maxima that scatter from second to second, and of noise


@dataclass(frozen=True, kw_only=True, eq=False)
class AdviceQuestion:
    """What advice depends on; see :func:`stickslip_ros.monitoring.advice.recommend.recommend`.

    Attributes
    ----------
    velocity : commanded speed, not negative [rad/s].
    before : advice given before, which stands unless other gains are clearly better.
    """

    joint: Joint
    gains: Gains
    velocity: float
    limits: AdviceLimits
    uncertainty: Uncertainty | None
    loop: ObservedLoop
    gains_known: bool
    before: Recommendation | None = None

    def of_the_same_controller(self, other: AdviceQuestion) -> bool:
        """Whether gains and limits are the same, however friction and speed have changed."""
        return (
            self.gains_known == other.gains_known
            and (not self.gains_known or self.gains == other.gains)
            and self.limits == other.limits
            and self.loop.conditions == other.loop.conditions
        )

    def comparable(self, other: AdviceQuestion) -> bool:
        """Whether the answer to the one is of use until the other is answered: at speeds within a factor of two.

        A joint that stood still and moves now needs other gains than none.
        """
        slower, faster = sorted((abs(self.velocity), abs(other.velocity)))
        return self.of_the_same_controller(other) and faster <= _COMPARABLE * slower

    def about_the_same(self, other: AdviceQuestion) -> bool:
        """Whether both are about the same joint, gains and limits, at whatever speed."""
        return (
            self.joint is other.joint
            and self.gains == other.gains
            and self.uncertainty is other.uncertainty
            and self.of_the_same_controller(other)
        )

    def similar(self, other: AdviceQuestion, speeds: float = _SAME_SPEED) -> bool:
        """Whether the answer to the one answers the other: at speeds that differ by no more than a share."""
        mine, its = self.loop, other.loop
        return (
            self.about_the_same(other)
            and _near(self.velocity, other.velocity, speeds)
            and _near(mine.sample_rate, its.sample_rate, _SAME_RATE)
            and _near(mine.position_noise, its.position_noise, _SAME_ERROR)
            and _near(mine.velocity_noise, its.velocity_noise, _SAME_ERROR)
            and (
                math.isinf(self.limits.effort)
                or (
                    _near(mine.tracking_error, its.tracking_error, _SAME_ERROR)
                    and _near(mine.velocity_error, its.velocity_error, _SAME_ERROR)
                )
            )
        )


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


Adviser = Callable[[AdviceQuestion], Advice | None]


def advise(question: AdviceQuestion) -> Advice:
    """Answer a question: ten milliseconds by Eq. (43), up to seconds exactly."""
    joint, gains, limits = question.joint, question.gains, question.limits
    recommendation = recommend(
        joint,
        gains,
        question.velocity,
        limits,
        question.uncertainty,
        question.loop,
        gains_known=question.gains_known,
        before=question.before,
    )
    possible = 0 < gains.stiffness < math.inf and 0 < recommendation.velocity < math.inf
    return Advice(
        recommendation=recommendation,
        sensitivities=sensitivities(
            joint,
            gains,
            recommendation.velocity,
            question.loop.conditions,
            wanted_margin=limits.wanted_margin,
            condition=limits.condition,
        )
        if possible
        else (),
        lowest_smooth_velocity=float(lowest_smooth_velocity(joint, gains)) if gains.stiffness > 0 else math.nan,
    )


def no_advice(reason: str, velocity: float, limits: AdviceLimits, *, gains_known: bool) -> Advice:
    """The answer where none can be given, and why."""
    return Advice(
        recommendation=without_gains(f"no advice: {reason}", velocity, limits.condition, gains_known=gains_known),
        sensitivities=(),
        lowest_smooth_velocity=math.nan,
    )


class CachingAdviser:
    """Computes answers at once; the last one is kept for similar questions."""

    def __init__(self) -> None:
        self._last: tuple[AdviceQuestion, Advice] | None = None

    def __call__(self, question: AdviceQuestion) -> Advice:
        """The answer to a question."""
        if self._last is None or not self._last[0].similar(question):
            self._last = (question, advise(question))
        return self._last[1]


def _near(one: float, other: float, share: float) -> bool:
    return abs(one - other) <= share * abs(other) or (math.isnan(one) and math.isnan(other))
