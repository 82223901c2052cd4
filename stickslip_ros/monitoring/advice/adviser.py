# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Answers to questions for advice, which a monitor requests in its own thread or another."""

from __future__ import annotations

import math

from stickslip_ros.model.margin import lowest_smooth_velocity
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Advice
from stickslip_ros.monitoring.advice.sensitivity import sensitivities
from stickslip_ros.monitoring.assessment import AdviceQuestion


def advise(question: AdviceQuestion) -> Advice:
    """Answer a question: ten milliseconds by Eq. (43), up to seconds exactly."""
    joint, gains, limits = question.joint, question.gains, question.limits
    recommendation = recommend(**vars(question))
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


class CachingAdviser:
    """Computes answers at once; the last one is kept for similar questions."""

    def __init__(self) -> None:
        self._last: tuple[AdviceQuestion, Advice] | None = None

    def __call__(self, question: AdviceQuestion) -> Advice:
        """The answer to a question."""
        if self._last is None or not self._last[0].similar(question):
            self._last = (question, advise(question))
        return self._last[1]
