# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a friction compensation buys: the verdict with it, the errors that it leaves, the swing that it brings."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import first_reached
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import damping_for_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.long_motion import UNSTABLE, UnstableLoopError, advanced, natural_period
from stickslip_ros.model.outcome import ORDER, Outcome
from stickslip_ros.model.reversal import ReferenceMotion, Reversal, reversals, triangle
from stickslip_ros.model.verdict import Detail, ExactVerdict, verdict

FloatArray = NDArray[np.float64]

SHARES = (0.0, 0.5, 0.8, 1.0, 1.2)  # shares of the friction that are compensated in a table, 1
_MOST_SHARE = 3.0  # largest share of the friction that is tried, 1
_SHARE_TOLERANCE = 0.05  # error of the largest harmless share, 1
_PERIODS = 60  # simulated span, natural periods: the last third is evaluated
_KICK = 2.0  # distance at which a joint that is to stand still begins, of what static friction holds
# Growth of the error as a factor, and of the error at the reversal as a share: less does not count.
_WORSE, _LITTLE = 1.02, 0.05
_MORE_DAMPING = 1.05  # growth of ρ_c as a factor, 1: less does not count
_REVERSAL_RANGE = 10.0  # half of the way between two reversals, of what static friction holds


@dataclass(frozen=True, kw_only=True)
class CompensationEffect:
    """A joint under PD control and one compensation.

    Attributes
    ----------
    outcome : what becomes of it at the speed; None where there is no answer. Under dither, which stops and starts the
        joint all the time, it is that of the motion between like phases of the dither. reason : why there is none, or
        None.
    critical_damping_ratio : ρ_c; NaN if none, or not asked for.
    steady_error : mean following error at the speed [rad]. swing : of the following error there, peak to peak [rad].
    standing_swing : of the joint while the reference stands, peak to peak [rad].
    reversal : the worse of the two of a triangle of that speed; None if it does not turn round.
    unstable : the motion grows without end; then there are none of the others.
    """

    outcome: Outcome | None
    reason: str | None = None
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


@dataclass(frozen=True, kw_only=True)
class _Case:
    """One joint at one speed, of which each answer is looked for when it is asked for."""

    joint: Joint
    gains: Gains
    speed: float
    conditions: OperatingConditions

    @property
    def _held(self) -> float:
        friction = self.joint.friction
        return (float(friction.coulomb) + float(friction.stribeck)) / float(self.gains.stiffness)

    def following(self) -> FloatArray:
        return self._late_errors(lambda times: self.speed * times)

    def standing_swing(self) -> float:
        return float(np.ptp(self._late_errors(lambda times: np.full(times.shape, _KICK * self._held))))

    def reversal(self) -> Reversal | None:
        motion = _turning(self.joint, self.gains, self.speed, self._held)
        turns = reversals(self.joint, self.gains, motion, self.conditions)
        return max(turns, key=lambda turn: turn.peak_error, default=None)

    def verdict(self, detail: Detail, gains: Gains | None = None) -> ExactVerdict:
        return verdict(self.joint, gains or self.gains, self.speed, self.conditions, detail=detail)

    def smooth_at(self, damping_ratio: float) -> bool:
        """Whether stick-slip dies out with other damping."""
        damping = float(damping_for_ratio(self.joint, self.gains.stiffness, damping_ratio))
        return self.verdict(Detail.SMOOTH, replace(self.gains, damping=damping)).smooth is True

    def with_compensation(self, compensation: Compensation) -> _Case:
        return replace(self, conditions=replace(self.conditions, compensation=compensation))

    def _late_errors(self, reference: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """Following error once what came first has passed."""
        gains, conditions = self.gains, self.conditions
        natural = natural_period(self.joint, gains)
        period = conditions.period or natural / 64.0
        count = math.ceil(_PERIODS * natural / period)
        simulation = JointSimulation.under(self.joint, gains, conditions)
        positions = reference(period * np.arange(count + 1.0))
        reach = float(np.abs(positions).max())
        motion = advanced(simulation, conditions, period, positions[:-1], np.diff(positions) / period, reach)
        return (positions[1:] - motion.position)[-count // 3 :]


def compensation_effect(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, limits: bool = True
) -> CompensationEffect:
    """What the compensation among the conditions does to a joint (scalars) at a velocity [rad/s]: some tenths of a
    second; seconds of a soft joint that moves slowly, which a controller looks at very often in a period.

    Parameters
    ----------
    limits : whether ρ_c is wanted too, which takes most of the time.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.reversal.reversals`.
    """
    case = _Case(joint=joint, gains=gains, speed=abs(float(velocity)), conditions=conditions)
    try:
        return _effect(case, limits=limits)
    except UnstableLoopError:
        none = math.nan
        return CompensationEffect(
            outcome=None, reason=UNSTABLE, critical_damping_ratio=none, steady_error=none, swing=none,
            standing_swing=none, reversal=None, unstable=True,
        )  # fmt: skip


def _effect(case: _Case, *, limits: bool) -> CompensationEffect:
    answer, following = case.verdict(Detail.BOUNDARY if limits else Detail.OUTCOME), case.following()
    return CompensationEffect(
        outcome=answer.outcome,
        reason=answer.reason,
        critical_damping_ratio=answer.critical_damping_ratio,
        steady_error=float(following.mean()),
        swing=float(np.ptp(following)),
        standing_swing=case.standing_swing(),
        reversal=case.reversal(),
    )


def largest_harmless_share(
    joint: Joint,
    gains: Gains,
    velocity: float,
    conditions: OperatingConditions,
    at: Callable[[float], Compensation],
    without: CompensationEffect | None = None,
) -> float:
    """Largest share c up to 3, to 0.05, up to which compensation makes nothing worse.

    That is: the outcome, and where the joint sticks without it ρ_c, by 5 % or more; the error and its swing at the
    speed, the swing at standstill, and the error at the reversal, by 2 % or more, of swings also a twentieth of the
    error at the reversal.

    How wrong the friction may be known before the compensation hurts: with a compensation meant to be c₀, by a factor
    of this over c₀.

    Parameters
    ----------
    at : the compensation of a share. without : the effect of none, with its ρ_c, if it is known already.
    """
    alone = _Case(
        joint=joint, gains=gains, speed=abs(float(velocity)), conditions=replace(conditions, compensation=None)
    )
    if without is None:
        without = compensation_effect(joint, gains, velocity, alone.conditions)
    little = _LITTLE * abs(without.peak_error)
    enough = _MORE_DAMPING * without.critical_damping_ratio
    ask_damping = without.outcome is Outcome.STICKS and math.isfinite(enough)

    def harmless(share: float) -> bool:
        try:
            return makes_nothing_worse(share)
        except UnstableLoopError:
            return without.unstable

    def makes_nothing_worse(share: float) -> bool:
        # The quickest answers come first.
        case = alone.with_compensation(at(share))
        following = case.following()
        if not (
            abs(float(following.mean())) <= _WORSE * abs(without.steady_error)
            and float(np.ptp(following)) <= _WORSE * without.swing + little
            and case.standing_swing() <= _WORSE * without.standing_swing + little
        ):
            return False
        turn = case.reversal()
        if turn is None or not turn.peak_error <= _WORSE * without.peak_error:
            return False
        if case.conditions.at_constant_speed.compensation is None:
            return True  # a constant torque changes neither verdict nor ρ_c
        if ask_damping and not case.smooth_at(enough):
            return False
        outcome = case.verdict(Detail.OUTCOME).outcome
        return ORDER.index(outcome) <= ORDER.index(without.outcome)

    _, low = first_reached(
        lambda share: share > 0.0 and not harmless(share),
        np.arange(0.0, _MOST_SHARE + 0.1, 0.2).tolist(),
        lambda harmful, low: harmful - low > _SHARE_TOLERANCE,
    )
    return low or 0.0


def _turning(joint: Joint, gains: Gains, speed: float, held: float) -> ReferenceMotion:
    """A triangle so long that friction is met and left behind between the reversals."""
    amplitude = _REVERSAL_RANGE * held + 2.0 * speed * natural_period(joint, gains)
    motion = triangle(amplitude, speed / (4.0 * amplitude), joint, gains)
    if gains.integral:
        return motion  # as long as the integral needs
    # To, fro and to again: friction is met before each of the two reversals.
    legs = len(motion.position) - 1 - (len(motion.position) - 1) // 4
    return ReferenceMotion(period=motion.period, position=motion.position[: legs + 1])
