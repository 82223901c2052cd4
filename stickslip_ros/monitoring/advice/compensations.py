# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction compensation beside advised gains: the kinds that controllers take, and what the two usual ones buy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from stickslip_ros.model.compensation import USUAL_FILTER, Compensation, usual_compensation
from stickslip_ros.model.compensation_effect import (
    CompensationEffect,
    compensation_effect,
    largest_harmless_share,
)
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint

FEEDFORWARD, FEEDBACK = "feed-forward", "feedback"
_PERIOD = 1e-3  # [s] of the controller, where it is not known: the usual one of ros2_control
_DITHER = 3.0  # frequency of dither, relative to the natural one: the joint does not follow it


At = Callable[[float], Compensation]


def compensations(
    joint: Joint,
    gains: Gains,
    conditions: OperatingConditions,
    *,
    resolution: float,
    speed_filter: float = USUAL_FILTER,
) -> dict[str, At]:
    """The kinds of compensation, with what a controller of the conditions would take; each by its share.

    Parameters
    ----------
    resolution : of the encoder [rad]. speed_filter : time constant [s].
    """
    friction = joint.friction
    period = conditions.controller_period or _PERIOD
    natural = math.sqrt(float(gains.stiffness) / float(joint.inertia)) / (2.0 * math.pi)
    frequency = min(max(_DITHER * natural, 10.0), 0.4 / period)
    frequency = 1.0 / (period * math.ceil(1.0 / (period * frequency)))  # like phases are whole periods apart
    seen = usual_compensation(friction, period=period, resolution=resolution, speed_filter=speed_filter)
    return {
        FEEDFORWARD: lambda share: replace(seen, feedforward=share),
        FEEDBACK: lambda share: replace(seen, feedback=share),
        "push": lambda share: replace(seen, push=share),
        "dither": lambda share: replace(
            seen, dither=share * float(friction.coulomb), dither_frequency=frequency if share > 0 else 0.0
        ),
    }


@dataclass(frozen=True, kw_only=True)
class CompensationQuestion:
    """A joint with the gains that it is to have, at a speed; what the answer depends on, and nothing else.

    Attributes
    ----------
    velocity : [rad/s]. resolution : of the encoder [rad].
    """

    joint: Joint
    gains: Gains
    velocity: float
    conditions: OperatingConditions
    resolution: float


@dataclass(frozen=True, kw_only=True)
class CompensatedGains:
    """Gains with one kind of compensation, or with none.

    Attributes
    ----------
    kind : "" for the gains alone. share : of the friction that is compensated. harmless : the largest share that
        does no harm; NaN for the gains alone.
    """

    kind: str
    share: float
    harmless: float
    effect: CompensationEffect

    @property
    def label(self) -> str:
        """What a table calls it."""
        return f"with {self.kind}" if self.kind else "gains alone"


def compensation_advice(question: CompensationQuestion, *, with_limits: bool = True) -> tuple[CompensatedGains, ...]:
    """The gains alone, with feed-forward and with feedback of the full friction, or of the largest share that does no
    harm; takes some seconds.

    Parameters
    ----------
    with_limits : whether the largest harmless shares are searched for, which takes most of the time; if not, it is the
        full friction.
    """
    joint, gains, speed, conditions = question.joint, question.gains, question.velocity, question.conditions
    kinds = compensations(joint, gains, conditions, resolution=question.resolution)

    def effect(compensation: Compensation | None, *, limits: bool = False) -> CompensationEffect:
        return compensation_effect(joint, gains, speed, replace(conditions, compensation=compensation), limits=limits)

    alone = CompensatedGains(kind="", share=0.0, harmless=math.nan, effect=effect(None, limits=with_limits))
    found = [alone]
    for kind in (FEEDFORWARD, FEEDBACK):
        harmless = math.nan
        if with_limits:
            harmless = largest_harmless_share(joint, gains, speed, conditions, kinds[kind], alone.effect)
        share = min(1.0, harmless) if with_limits else 1.0
        result = effect(kinds[kind](share)) if share > 0 else alone.effect
        found.append(CompensatedGains(kind=kind, share=share, harmless=harmless, effect=result))
    return tuple(found)
