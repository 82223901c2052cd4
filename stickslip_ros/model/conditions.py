# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Under what conditions a joint is judged: what the paper leaves open."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_finite, require_not_negative
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.friction import Joint


@dataclass(frozen=True, kw_only=True)
class OperatingConditions:
    """What the paper leaves open, each off by default.

    Attributes
    ----------
    load : constant torque against the controller [N·m]. It shifts the position, or with integral action the
        integral, and changes no verdict.
    controller_period : the controller samples so often and holds its effort [s]; 0: continuous control.
    control_delay : the effort takes effect one controller period late.
    compensation : torques that the controller adds, looking at the joint once in its own period, or in that of a
        sampled controller.

    Raises
    ------
    InvalidParameterError
        If a value is not finite, the period is negative, or a delay is asked of continuous control.
    """

    load: float = field(default=0.0, metadata={"unit": "N·m"})
    controller_period: float = field(default=0.0, metadata={"unit": "s"})
    control_delay: bool = False
    compensation: Compensation | None = None

    def __post_init__(self) -> None:
        require_finite("load", self.load)
        require_not_negative("controller_period", self.controller_period)
        if self.control_delay and self.controller_period == 0:
            raise InvalidParameterError("controller_period", "> 0 where there is a control delay", 0.0)

    def applied_to(self, joint: Joint) -> Joint:
        """The joint as these conditions leave it: a stated controller period is the delay, and no other counts."""
        return replace(joint, actuation_delay=0.0) if self.controller_period > 0 else joint

    @property
    def at_constant_speed(self) -> OperatingConditions:
        """The same without a feed-forward that is a constant torque at a constant speed, and changes no verdict."""
        if self.compensation is None or self.compensation.by_motion:
            return self
        return replace(self, compensation=None)

    @property
    def period(self) -> float:
        """Of what the controller does once in a while [s]; 0 where it does all continuously."""
        if self.controller_period > 0 or self.compensation is None:
            return self.controller_period
        return self.compensation.period
