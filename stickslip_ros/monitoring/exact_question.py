# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Questions for exact verdicts, which take milliseconds to seconds; and when the answer to one answers another."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.verdict import ExactVerdict, verdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.uncertainty import Uncertainty, stick_slip_probability

NOT_COMPUTED = ExactVerdict(smooth=None)
_SAME_SPEED = 0.02  # difference of two speeds, of the speed: within it an answer still holds
_SAME_GAINS = 0.01  # difference of two gains, of the gain: within it an answer still holds
_SEEN = 0.99  # probability of stick-slip that is detected, 1: of a hundred detections one may be false


def as_seen(verdict: ExactVerdict, status: Status) -> ExactVerdict:
    """The verdict on the present gains at the present speed, beside the status of the motion: what is seen is probable.

    The probability that follows from the errors of friction is 0.3 beside many a joint that sticks all the time.
    """
    if status is not Status.STICK_SLIP or not verdict.stick_slip_probability < _SEEN:
        return verdict
    return replace(verdict, stick_slip_probability=_SEEN)


@dataclass(frozen=True, kw_only=True)
class ExactQuestion:
    """Whether a joint sticks and slips at a speed [rad/s], which is not negative, and how sure that is.

    ``uncertainty`` is that of the joint, None if it is given; it changes with the joint alone.
    """

    joint: Joint
    gains: Gains
    conditions: OperatingConditions
    speed: float
    uncertainty: Uncertainty | None = field(default=None, compare=False)

    @classmethod
    def on(cls, state: Assessment, gains: Gains | None, conditions: OperatingConditions) -> ExactQuestion | None:
        """The question on an assessed joint, with gains that need not be its own; None if it cannot be asked."""
        if state.joint is None or gains is None or not math.isfinite(state.velocity):
            return None
        return cls(
            joint=state.joint,
            gains=gains,
            conditions=conditions,
            speed=abs(state.velocity),
            uncertainty=state.uncertainty,
        )

    def verdict(self) -> ExactVerdict:
        """The answer, worked out."""
        answer = verdict(self.joint, self.gains, self.speed, self.conditions)
        if self.uncertainty is None or answer.smooth is None:
            return answer
        # Draws are integrated as rigid joints under continuous control.
        if self.conditions.controller_period > 0 or self.joint.transmission is not None:
            return answer
        probability = stick_slip_probability(self.uncertainty, self.gains, self.speed)
        return replace(answer, stick_slip_probability=probability)

    def of_the_same_controller(self, other: ExactQuestion) -> bool:
        """Whether conditions and gains are the same, the latter but for what learning makes of them per inertia."""
        pairs = [(getattr(self.gains, name), getattr(other.gains, name)) for name in vars(self.gains)]
        near = all(abs(float(one) - float(two)) <= _SAME_GAINS * abs(float(two)) for one, two in pairs)
        return near and self.conditions == other.conditions

    def at_the_same_speed(self, other: ExactQuestion) -> bool:
        """Whether the speeds are as good as the same."""
        return abs(self.speed - other.speed) <= _SAME_SPEED * other.speed

    def answers(self, other: ExactQuestion) -> bool:
        """Whether the answer to this one is as good as the other's own: they are about the same joint too."""
        return self.joint == other.joint and self.of_the_same_controller(other) and self.at_the_same_speed(other)
