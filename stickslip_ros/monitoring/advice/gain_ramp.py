# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The way from one pair of gains to another on a moving joint: in small steps, since k_p times an error is a torque."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.search import damping_floor

_LARGEST_STEP = 0.04  # of the logarithms of the gains: a controller's rounding and the joint's motion see no jump
_LARGEST_EFFORT_STEP = 0.05  # relative to the largest effort of the last second: within its usual scatter


@dataclass(frozen=True, kw_only=True)
class GainRamp:
    """A straight line in the logarithms of the stiffness and of the damping of controller and joint together.

    Attributes
    ----------
    begin, end : gains; the integral gain is not touched.
    offset : the joint's own damping, or some little damping [N·m·s/rad], so that k_v may begin or end at zero.
    """

    begin: Gains
    end: Gains
    offset: float

    @classmethod
    def between(cls, joint: Joint, begin: Gains, end: Gains) -> GainRamp:
        """The ramp of a joint (scalars)."""
        offset = max(float(joint.own_damping(begin.stiffness)), float(damping_floor(joint, begin.stiffness)))
        return cls(begin=begin, end=end, offset=offset)

    @property
    def length(self) -> float:
        """√(ln² + ln²) of the two factors."""
        stiffness = math.log(float(self.end.stiffness) / float(self.begin.stiffness))
        damping = math.log((float(self.end.damping) + self.offset) / (float(self.begin.damping) + self.offset))
        return math.hypot(stiffness, damping)

    def at(self, share: float) -> Gains:
        """Gains after a share of the way, the ends exactly."""
        if share <= 0.0 or share >= 1.0:
            return self.begin if share <= 0.0 else self.end
        before, after = float(self.begin.damping) + self.offset, float(self.end.damping) + self.offset
        stiffness = float(self.begin.stiffness) * (float(self.end.stiffness) / float(self.begin.stiffness)) ** share
        damping = before * (after / before) ** share - self.offset
        low, high = sorted((float(self.begin.damping), float(self.end.damping)))
        return Gains(stiffness=stiffness, damping=min(max(damping, low), high), integral=self.begin.integral)

    def next_share(
        self,
        share: float,
        *,
        rate: float,
        elapsed: float,
        tracking_error: float = math.nan,
        velocity_error: float = math.nan,
    ) -> float:
        """How far the next step may go.

        Parameters
        ----------
        share : of the way gone so far. rate : relative change a second [1/s]. elapsed : since the last step [s].
        tracking_error, velocity_error : largest of now [rad], [rad/s]; where they are known, the step in effort that
            the step in gains makes is kept to a twentieth of the effort.
        """
        if self.length == 0.0:
            return 1.0
        step = min(rate * elapsed, _LARGEST_STEP) / self.length
        present = self.at(share)
        errors = [error if math.isfinite(error) else 0.0 for error in (tracking_error, velocity_error)]
        effort = abs(float(present.stiffness)) * errors[0] + abs(float(present.damping)) * errors[1]
        if errors[0] > 0.0:
            following = self.at(share + step)
            jump = abs(float(following.stiffness) - float(present.stiffness)) * errors[0]
            jump += abs(float(following.damping) - float(present.damping)) * errors[1]
            if jump > _LARGEST_EFFORT_STEP * effort:
                step *= _LARGEST_EFFORT_STEP * effort / jump
        return min(share + step, 1.0)
