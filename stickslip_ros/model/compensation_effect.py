# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a friction compensation buys: the verdict with it, the errors that it leaves, the swing that it brings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import bisected_until
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.divergence import UnstableLoopError, runs_away
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.reversal import ReferenceMotion, Reversal, reversals, triangle
from stickslip_ros.model.verdict import ExactVerdict, exact_verdict

FloatArray = NDArray[np.float64]

SHARES = (0.0, 0.5, 0.8, 1.0, 1.2)
_MOST_SHARE = 3.0
_SHARE_TOLERANCE = 0.02
_PERIODS = 60  # natural ones, of which the last third is looked at
_KICK = 2.0  # times what static friction holds: how far off a joint begins that is to stand still
_WORSE, _LITTLE = 1.02, 0.05  # as a factor, and as a share of the error at the reversal: what does not count
_ORDER = [Outcome.STEADY, Outcome.SWINGS, None, Outcome.STICKS]


@dataclass(frozen=True, kw_only=True)
class CompensationEffect:
    """A joint under PD control and one compensation.

    Attributes
    ----------
    outcome : what becomes of it at the speed; None where there is no answer, as with dither, which stops and starts the
        joint all the time. critical_damping_ratio : ρ_c; NaN if none.
    steady_error : mean following error at the speed [rad]. swing : of the following error there, peak to peak [rad].
    standing_swing : of the joint while the reference stands, peak to peak [rad].
    reversal : the worse of the two of a triangle of that speed; None if it does not turn round.
    unstable : the motion grows without end; then there are none of the others.
    """

    outcome: Outcome | None
    critical_damping_ratio: float = field(metadata={"unit": "1"})
    steady_error: float = field(metadata={"unit": "rad"})
    swing: float = field(metadata={"unit": "rad"})
    standing_swing: float = field(metadata={"unit": "rad"})
    reversal: Reversal | None
    unstable: bool = False

    @property
    def peak_error(self) -> float:
        """At the reversal [rad]; NaN if there is none."""
        return self.reversal.peak_error if self.reversal is not None else math.nan


def compensation_effect(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, limits: bool = True
) -> CompensationEffect:
    """What the compensation among the conditions does to a joint (scalars) at a velocity [rad/s]; a tenth of a second.

    Parameters
    ----------
    limits : whether ρ_c is wanted too, which takes most of the time.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.reversal.reversals`.
    """
    try:
        return _effect(joint, gains, velocity, conditions, limits=limits)
    except UnstableLoopError:
        none = math.nan
        return CompensationEffect(
            outcome=None, critical_damping_ratio=none, steady_error=none, swing=none, standing_swing=none,
            reversal=None, unstable=True,
        )  # fmt: skip


def _effect(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, limits: bool
) -> CompensationEffect:
    speed = abs(float(velocity))
    dithered = conditions.compensation is not None and conditions.compensation.dither > 0
    verdict = ExactVerdict(smooth=None) if dithered else exact_verdict(joint, gains, speed, conditions, limits=False)
    natural = 2.0 * math.pi * math.sqrt(float(joint.inertia) / float(gains.stiffness))
    following = _late_errors(joint, gains, conditions, natural, lambda times: speed * times)
    held = (float(joint.friction.coulomb) + float(joint.friction.stribeck)) / float(gains.stiffness)
    standing = _late_errors(joint, gains, conditions, natural, lambda times: np.full(times.shape, _KICK * held))
    turns = reversals(joint, gains, _turning(joint, gains, speed, held), conditions)
    return CompensationEffect(
        outcome=verdict.outcome,
        critical_damping_ratio=verdict.critical_damping_ratio if limits else math.nan,
        steady_error=float(following.mean()),
        swing=float(np.ptp(following)),
        standing_swing=float(np.ptp(standing)),
        reversal=max(turns, key=lambda turn: turn.peak_error, default=None),
    )


def largest_harmless_share(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, at: Callable[[float], Compensation]
) -> float:
    """Largest share c up to 3 that is no worse than none in outcome, standing swing and reversal error.

    How wrong the friction may be known before the compensation hurts: with a compensation meant to be c₀, by a factor
    of this over c₀.

    Parameters
    ----------
    at : the compensation of a share.
    """
    without = compensation_effect(joint, gains, velocity, replace(conditions, compensation=None), limits=False)

    def helps(share: float) -> bool:
        found = compensation_effect(joint, gains, velocity, replace(conditions, compensation=at(share)), limits=False)
        if found.unstable and not without.unstable:
            return False
        little = _LITTLE * abs(without.peak_error)
        if found.outcome is None:
            as_smooth = found.swing <= _WORSE * without.swing + little
        else:
            as_smooth = _ORDER.index(found.outcome) <= _ORDER.index(without.outcome)
        return (
            as_smooth
            and found.standing_swing <= _WORSE * without.standing_swing + little
            and found.peak_error <= _WORSE * without.peak_error
        )

    low = 0.0
    for share in np.arange(0.2, _MOST_SHARE + 0.1, 0.2).tolist():
        if not helps(share):
            low, _ = bisected_until(helps, low, share, lambda inside, outside: outside - inside > _SHARE_TOLERANCE)
            return low
        low = share
    return low


def _late_errors(
    joint: Joint,
    gains: Gains,
    conditions: OperatingConditions,
    natural: float,
    reference: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Following error once what came first has passed."""
    period = conditions.period or natural / 64.0
    count = math.ceil(_PERIODS * natural / period)
    simulation = JointSimulation(
        joint,
        gains,
        load=conditions.load,
        error_integral=conditions.load / float(gains.integral) if gains.integral else 0.0,
        sampled=conditions.controller_period > 0,
        control_delay=conditions.control_delay,
        compensation=conditions.compensation,
    )
    positions = reference(period * np.arange(count + 1.0))
    motion = simulation.advance(period, positions[:-1], np.diff(positions) / period)
    errors = positions[1:] - motion.position
    if runs_away(joint, gains, conditions, errors, float(np.abs(positions).max())):
        raise UnstableLoopError
    return errors[-count // 3 :]


def _turning(joint: Joint, gains: Gains, speed: float, held: float) -> ReferenceMotion:
    """A triangle so long that friction is met and left behind between the reversals."""
    amplitude = 10.0 * held + 4.0 * math.pi * speed * math.sqrt(float(joint.inertia) / float(gains.stiffness))
    return triangle(amplitude, speed / (4.0 * amplitude), joint, gains)
