# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction compensation as controllers have it: by the reference's speed, by the measured one, a push, dither."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.friction import Friction, Real, steady_friction

USUAL_FILTER = 0.01  # time constant of a controller's measured speed, s
_WIDTHS = 2.0  # speed where the tanh of the measured speed rises, Stribeck velocities
_COUNTS = 4.0  # the same, encoder counts in the filter's time
_FADE = 2.0  # speed at which a push is gone, Stribeck velocities


@dataclass(frozen=True, kw_only=True)
class Compensation:
    """Torques that a controller adds because it believes in a friction; each off by default.

    All but the feed-forward see a measured position, sampled and quantized, and a speed that is its difference,
    filtered.

    Attributes
    ----------
    friction : what the controller believes; need not be that of the joint.
    feedforward : share c of the steady friction at the reference's speed, c (F_k sgn x˙_d + F_s Ψ(x˙_d) + F_v x˙_d).
    feedback : share c of the Coulomb friction by the measured speed, c F_k tanh(x˙/ε).
    width : ε [rad/s] of the feedback.
    push : share c of F_k + F_s by the sign of the error, c (F_k + F_s) sgn(e) (1 − |x˙|/fade), none above the fade.
    fade : measured speed at which the push is gone [rad/s]. deadband : error without a push [rad].
    dither : amplitude [N·m] of a torque that swings at dither_frequency [Hz].
    period : between two looks [s]. resolution : of the position [rad]. speed_filter : its time constant [s].

    Raises
    ------
    InvalidParameterError
        If a value is negative or not finite, or one that is divided by is zero.
    """

    friction: Friction
    feedforward: float = field(default=0.0, metadata={"unit": "1"})
    feedback: float = field(default=0.0, metadata={"unit": "1"})
    width: float = field(default=0.005, metadata={"unit": "rad/s"})
    push: float = field(default=0.0, metadata={"unit": "1"})
    fade: float = field(default=0.01, metadata={"unit": "rad/s"})
    deadband: float = field(default=0.0, metadata={"unit": "rad"})
    dither: float = field(default=0.0, metadata={"unit": "N·m"})
    dither_frequency: float = field(default=0.0, metadata={"unit": "Hz"})
    period: float = field(default=1e-3, metadata={"unit": "s"})
    resolution: float = field(default=0.0, metadata={"unit": "rad"})
    speed_filter: float = field(default=0.0, metadata={"unit": "s"})

    def __post_init__(self) -> None:
        for name in (
            "feedforward", "feedback", "push", "deadband", "dither", "dither_frequency", "resolution", "speed_filter",
        ):  # fmt: skip
            require_not_negative(name, getattr(self, name))
        for name in ("width", "fade", "period"):
            require_positive(name, getattr(self, name))
        if self.dither > 0 and not 0 < self.dither_frequency < 0.5 / self.period:
            raise InvalidParameterError(
                "dither_frequency",
                f"> 0 and < {0.5 / self.period:g} Hz, half the controller's rate",
                self.dither_frequency,
            )

    def feedforward_torque(self, velocity: Real) -> Real:
        """Torque at the reference's velocity [N·m]; none where that stands still."""
        return self.feedforward * steady_friction(self.friction, velocity)

    @property
    def by_motion(self) -> bool:
        """Whether it is by the joint's motion, or by time; the feed-forward alone is constant at a constant speed."""
        return bool(self.feedback > 0 or self.push > 0 or self.dither > 0)

    @property
    def numbers(self) -> NDArray[np.float64]:
        """What the compiled controller goes by."""
        numbers = np.zeros(at.COMPENSATION_SIZE)
        coulomb = float(self.friction.coulomb)
        numbers[at.FEEDBACK] = self.feedback * coulomb
        numbers[at.WIDTH] = self.width
        numbers[at.PUSH] = self.push * (coulomb + float(self.friction.stribeck))
        numbers[at.FADE] = self.fade
        numbers[at.DEADBAND] = self.deadband
        numbers[at.DITHER] = self.dither
        numbers[at.DITHER_RATE] = 2.0 * math.pi * self.dither_frequency
        numbers[at.RESOLUTION] = self.resolution
        if self.feedback or self.push or self.dither:
            numbers[at.FILTER] = -math.expm1(-self.period / self.speed_filter) if self.speed_filter else 1.0
        return numbers


def usual_compensation(
    friction: Friction,
    *,
    period: float,
    resolution: float,
    speed_filter: float = USUAL_FILTER,
    feedforward: float = 0.0,
    feedback: float = 0.0,
    push: float = 0.0,
) -> Compensation:
    """Compensation as a controller has it that knows the friction, with a width and a fade that suit it.

    Parameters
    ----------
    period : of the controller [s]. resolution : of its encoder [rad]. speed_filter : time constant [s].
    feedforward, feedback, push : shares of the friction [1].

    Raises
    ------
    InvalidParameterError
        If a value is negative or not finite.
    """
    require_positive("period", period)
    require_not_negative("speed_filter", speed_filter)
    scale = float(friction.stribeck_velocity)
    # Narrower than the noise of the measured speed it would only rattle.
    width = max(_WIDTHS * scale, _COUNTS * resolution / (speed_filter + period))
    return Compensation(
        friction=friction, period=period, resolution=resolution, speed_filter=speed_filter, width=width,
        fade=max(_FADE * scale, width), feedforward=feedforward, feedback=feedback, push=push,
    )  # fmt: skip
