# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Verdict on one joint by integration, with what would change it: the counterpart of model/margin.py."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from stickslip_ros.model._earlier_names import earlier_names
from stickslip_ros.model.bisection import first_reached
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.controlled import controlled_course
from stickslip_ros.model.dimensionless import (
    DimensionlessGroups,
    damping_for_ratio,
    damping_reserve,
    dimensionless_groups,
)
from stickslip_ros.model.exact import (
    LARGEST_DAMPING_RATIO,
    exact_critical_damping_ratio,
    exact_least_smooth_stiffness,
    exact_lowest_smooth_velocity,
)
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.hunting import hunting
from stickslip_ros.model.long_motion import UNSTABLE, UnstableLoopError, natural_period, too_fast
from stickslip_ros.model.outcome import Outcome, outcomes, steady_damping_ratio

HUNTING = "hunting"

_CONTROLLED_TOLERANCE = 1e-2  # error of a damping ratio, of it
_FIRST_RATIO = 0.05  # damping ratio that is tried first, 1; then twice as much
_LEAST_RATIO = 1e-3  # damping ratio, 1: a smaller one is none
_NO_ANSWER = "no answer, because "
_UNDECIDED = "a dimensionless group is too large to integrate, or the motion does not show what it leads to"


@dataclass(frozen=True, kw_only=True)
class ExactVerdict:
    """What becomes of a joint when Eqs (4)-(6) are integrated, and where that changes.

    Attributes
    ----------
    outcome : from the worst start; None where there is no answer.
    depends_on_start : whether another start leads to another outcome.
    smooth : whether stick-slip dies out, the paper's question, from every start; None where there is no answer.
    reason : why there is none, or "hunting", or None.
    critical_damping_ratio : ρ_c, the damping ratio at which the cycle of a stuck joint just dies, to a relative 1e-3
        (1e-2 with integral action or sampled control); NaN if none.
    damping_reserve : ρ/ρ_c − 1, by which the damping exceeds what ends the cycle; infinite where none is needed.
    steady_damping_ratio : ρ_steady, from which on the joint moves steadily from every start, to a relative 2e-3; 0
        where 0.01 is enough, NaN if none, and beyond the paper's case.
    lowest_smooth_velocity : [rad/s]; 0 if every speed is smooth, infinite if none is; NaN beyond the paper's case.
    least_smooth_stiffness : [N·m/rad], at the present damping; likewise.
    stick_slip_probability : that it does not die out, given the errors of what is known of the friction; NaN where that
        is given, not learnt.
    """

    smooth: bool | None
    outcome: Outcome | None = None
    depends_on_start: bool = False
    reason: str | None = None
    critical_damping_ratio: float = math.nan
    damping_reserve: float = math.nan
    steady_damping_ratio: float = math.nan
    lowest_smooth_velocity: float = math.nan
    least_smooth_stiffness: float = math.nan
    stick_slip_probability: float = math.nan

    @property
    def steady_reserve(self) -> float:
        """Damping reserve from which on the joint moves steadily from every start; NaN where it is not known, and where
        no damping is needed against stick-slip.
        """
        return self.steady_damping_ratio / (self.critical_damping_ratio or math.nan) - 1.0

    @property
    def unstable(self) -> bool:
        """Whether there is no answer because the motion grows without end."""
        return self.reason == f"{_NO_ANSWER}{UNSTABLE}"


class Detail(IntEnum):
    """How much of a verdict is wanted; each takes longer than the one before, and has all that it has."""

    SMOOTH = 0  # whether stick-slip dies out; no outcome where it can be decided without
    OUTCOME = 1  # what becomes of the joint
    BOUNDARY = 2  # the critical damping ratio
    LIMITS = 3  # ρ_steady, the lowest smooth velocity and the least smooth stiffness


def verdict(
    joint: Joint,
    gains: Gains,
    velocity: float,
    conditions: OperatingConditions | None = None,
    *,
    detail: Detail = Detail.LIMITS,
) -> ExactVerdict:
    """Verdict on one joint (scalars) at a commanded velocity [rad/s], by integration of Eqs (4)-(6).

    Parameters
    ----------
    conditions : load, sampled control; with them, integral action or two masses the joint is simulated in SI units,
        which takes up to seconds; in the paper's case milliseconds.
    detail : what is not wanted is NaN.
    """
    conditions = (conditions or OperatingConditions()).at_constant_speed
    joint = conditions.applied_to(joint)
    why = _obstacle(joint, gains, velocity, conditions)
    if why:
        return _no_answer(why)
    if velocity == 0:
        return _standstill(joint, gains, conditions)
    if beyond_the_paper(joint, gains, conditions):
        return _controlled(joint, gains, velocity, conditions, detail)
    groups = dimensionless_groups(joint, gains, velocity)
    found = outcomes(groups)
    if found.worst is None:
        return _no_answer(_UNDECIDED)
    answer = ExactVerdict(
        smooth=found.worst is not Outcome.STICKS, outcome=found.worst, depends_on_start=found.depends_on_start
    )
    if detail >= Detail.BOUNDARY:
        answer = _with_boundary(answer, groups, float(exact_critical_damping_ratio(groups)))
    if detail >= Detail.LIMITS:
        answer = replace(
            answer,
            steady_damping_ratio=float(steady_damping_ratio(groups)),
            lowest_smooth_velocity=exact_lowest_smooth_velocity(joint, gains),
            least_smooth_stiffness=exact_least_smooth_stiffness(joint, velocity, damping=float(gains.damping)),
        )
    return answer


def beyond_the_paper(joint: Joint, gains: Gains, conditions: OperatingConditions) -> bool:
    """Whether the five dimensionless groups do not tell the verdict, so that the joint is simulated in SI units."""
    if joint.transmission is not None or not joint.friction.rigid:
        return True
    return bool(gains.integral != 0) or conditions.period > 0


def _obstacle(joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions) -> str:
    """Why there can be no exact answer, or ""."""
    values = np.array([gains.stiffness, gains.damping, gains.integral, velocity], dtype=float)
    if not np.isfinite(values).all():
        return "a gain or the commanded velocity is not a finite number"
    if gains.stiffness <= 0:
        return "the stiffness is not positive"
    if velocity == 0 and gains.integral == 0:
        return "the commanded velocity is zero and there is no integral action"
    with np.errstate(all="ignore"):
        groups = dimensionless_groups(joint, gains, velocity)
    if float(groups.damping_ratio) < 0:
        return "the total damping is negative: the joint is unstable by itself"
    if not float(groups.damping_ratio) <= LARGEST_DAMPING_RATIO:
        return f"the damping ratio is beyond {LARGEST_DAMPING_RATIO:g}"
    if not np.isfinite([float(value) for value in groups.numbers]).all():
        return "a gain is too small or too large to compute with"
    if too_fast(conditions, natural_period(joint, gains)):
        return "the controller is too fast beside the joint to be followed"
    return ""


def _no_answer(why: str) -> ExactVerdict:
    return ExactVerdict(smooth=None, reason=f"{_NO_ANSWER}{why}")


def _standstill(joint: Joint, gains: Gains, conditions: OperatingConditions) -> ExactVerdict:
    found = hunting(joint, gains, conditions)
    if found.unstable and not (found.hunts and min(found.unstable) > 1.0):
        return _no_answer(UNSTABLE)
    return ExactVerdict(
        smooth=not found.hunts,
        outcome=Outcome.STICKS if found.hunts else Outcome.STEADY,
        reason=HUNTING if found.hunts else None,
    )


def _controlled(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, detail: Detail
) -> ExactVerdict:
    try:
        outcome = controlled_course(joint, gains, velocity, conditions, to_the_end=detail >= Detail.OUTCOME)
    except UnstableLoopError:
        return _no_answer(UNSTABLE)
    if outcome is None and detail >= Detail.OUTCOME:
        return _no_answer("the motion does not show in a thousand periods what it leads to")
    answer = ExactVerdict(smooth=outcome is not Outcome.STICKS, outcome=outcome)
    if detail <= Detail.OUTCOME:
        return answer

    def persists_at(ratio: float) -> bool:
        damped = replace(gains, damping=float(damping_for_ratio(joint, gains.stiffness, ratio)))
        try:
            return controlled_course(joint, damped, velocity, conditions, to_the_end=False) is Outcome.STICKS
        except UnstableLoopError:
            return True

    return _with_boundary(answer, dimensionless_groups(joint, gains, velocity), _least_calming_ratio(persists_at))


def _with_boundary(answer: ExactVerdict, groups: DimensionlessGroups, critical: float) -> ExactVerdict:
    reserve = float(damping_reserve(float(groups.damping_ratio), critical))
    return replace(answer, critical_damping_ratio=critical, damping_reserve=reserve)


def _least_calming_ratio(persists_at: Callable[[float], bool]) -> float:
    """Least damping ratio that ends the cycle, looked for from below: too much sampled damping is unstable."""
    doublings = math.floor(math.log2(LARGEST_DAMPING_RATIO / _FIRST_RATIO))
    high, low = first_reached(
        lambda ratio: not persists_at(ratio),
        [0.0, *(_FIRST_RATIO * 2.0**n for n in range(doublings + 1))],
        lambda high, low: high - low > _CONTROLLED_TOLERANCE * high and high > _LEAST_RATIO,
    )
    if high is None:
        return math.nan
    return 0.0 if low is None else 0.5 * (low + high)


def _exact_verdict(joint: Joint, gains: Gains, velocity: float, *conditions: Any, limits: bool = True) -> ExactVerdict:
    return verdict(joint, gains, velocity, *conditions, detail=Detail.LIMITS if limits else Detail.BOUNDARY)


def _exactly_smooth(*arguments: Any) -> bool | None:
    found = verdict(*arguments, detail=Detail.SMOOTH)
    return False if found.unstable else found.smooth


if not TYPE_CHECKING:
    __getattr__ = earlier_names(
        __name__,
        {
            "exact_verdict": ("verdict(…)", _exact_verdict),
            "exactly_smooth": ("verdict(…, detail=Detail.SMOOTH).smooth", _exactly_smooth),
            "exact_outcome": ("verdict(…, detail=Detail.OUTCOME)", partial(verdict, detail=Detail.OUTCOME)),
        },
    )
