# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact verdict on one joint, with what would change it: the exact counterpart of model/margin.py."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.bisection import bisected_until
from stickslip_ros.model.controlled import (
    HUNTING,
    OperatingConditions,
    controlled_course,
    controlled_cycle_persists,
)
from stickslip_ros.model.dimensionless import damping_for_ratio, dimensionless_groups
from stickslip_ros.model.divergence import UNSTABLE
from stickslip_ros.model.exact import (
    LARGEST_DAMPING_RATIO,
    exact_critical_damping_ratio,
    exact_least_smooth_stiffness,
    exact_lowest_smooth_velocity,
)
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.hunting import hunting
from stickslip_ros.model.margin import damping_reserve
from stickslip_ros.model.outcome import Outcome, outcomes, steady_damping_ratio

_CONTROLLED_TOLERANCE = 1e-2  # error of a damping ratio, of it
_FIRST_RATIO = 0.05  # damping ratio that is tried first, 1; then twice as much
_LEAST_RATIO = 1e-3  # damping ratio, 1: a smaller one is none
_UNDECIDED = "a dimensionless group is too large to integrate, or the motion does not show what it leads to"


@dataclass(frozen=True, kw_only=True)
class ExactVerdict:
    """What becomes of a joint when Eqs (4)-(6) are integrated, and where that changes.

    Attributes
    ----------
    outcome : from the worst start; None where there is no answer.
    depends_on_start : whether another start leads to another outcome.
    smooth : whether stick slip dies out, the paper's question, from every start; None where there is no answer.
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


def exact_verdict(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions | None = None, *, limits: bool = True
) -> ExactVerdict:
    """Exact verdict on one joint (scalars) at a commanded velocity [rad/s].

    Parameters
    ----------
    conditions : load, sampled control; with them or integral action the joint is simulated in SI units, which
        takes up to seconds; in the paper's case milliseconds.
    limits : whether ρ_steady, the lowest smooth velocity and the least smooth stiffness are wanted too.
    """
    conditions = (conditions or OperatingConditions()).at_constant_speed
    joint = conditions.applied_to(joint)
    why = _obstacle(joint, gains, velocity)
    if why:
        return _no_answer(why)
    if velocity == 0:
        return _standstill(joint, gains, conditions)
    if beyond_the_paper(joint, gains, conditions):
        return _controlled(joint, gains, velocity, conditions)
    groups = dimensionless_groups(joint, gains, velocity)
    found = outcomes(groups)
    if found.worst is None:
        return _no_answer(_UNDECIDED)
    critical = float(exact_critical_damping_ratio(groups))
    return ExactVerdict(
        smooth=found.worst is not Outcome.STICKS,
        outcome=found.worst,
        depends_on_start=found.depends_on_start,
        steady_damping_ratio=float(steady_damping_ratio(groups)) if limits else math.nan,
        critical_damping_ratio=critical,
        damping_reserve=float(damping_reserve(float(groups.damping_ratio), critical)),
        lowest_smooth_velocity=exact_lowest_smooth_velocity(joint, gains) if limits else math.nan,
        least_smooth_stiffness=(
            exact_least_smooth_stiffness(joint, velocity, damping=float(gains.damping)) if limits else math.nan
        ),
    )


def exactly_smooth(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions | None = None
) -> bool | None:
    """Whether stick slip dies out, as in :func:`exact_verdict`, and nothing else; None where there is no answer.

    False too where the loop is unstable, of which the verdict says that.
    """
    conditions = (conditions or OperatingConditions()).at_constant_speed
    joint = conditions.applied_to(joint)
    if _obstacle(joint, gains, velocity):
        return None
    if velocity == 0:
        found = hunting(joint, gains, conditions)
        return None if found.hunts is None else found.settles
    if beyond_the_paper(joint, gains, conditions):
        persists = controlled_cycle_persists(joint, gains, velocity, conditions)
        return None if math.isnan(persists) else persists == 0.0
    worst = outcomes(dimensionless_groups(joint, gains, velocity)).worst
    return None if worst is None else worst is not Outcome.STICKS


def exact_outcome(joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions) -> ExactVerdict:
    """What becomes of a joint that moves, as in :func:`exact_verdict` without a boundary, which takes most time."""
    conditions = conditions.at_constant_speed
    joint = conditions.applied_to(joint)
    why = _obstacle(joint, gains, velocity)
    if why or velocity == 0:
        return _no_answer(why or "the joint does not move")
    if beyond_the_paper(joint, gains, conditions):
        return _controlled(joint, gains, velocity, conditions, boundary=False)
    found = outcomes(dimensionless_groups(joint, gains, velocity))
    if found.worst is None:
        return _no_answer(_UNDECIDED)
    return ExactVerdict(
        smooth=found.worst is not Outcome.STICKS, outcome=found.worst, depends_on_start=found.depends_on_start
    )


def beyond_the_paper(joint: Joint, gains: Gains, conditions: OperatingConditions) -> bool:
    """Whether the five dimensionless groups do not tell the verdict, so that the joint is simulated in SI units."""
    return bool(gains.integral != 0) or conditions.period > 0 or not joint.friction.rigid


def _obstacle(joint: Joint, gains: Gains, velocity: float) -> str:
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
    return ""


def _no_answer(why: str) -> ExactVerdict:
    return ExactVerdict(smooth=None, reason=f"no answer, because {why}")


def _standstill(joint: Joint, gains: Gains, conditions: OperatingConditions) -> ExactVerdict:
    found = hunting(joint, gains, conditions)
    if found.hunts is None:
        return _no_answer("the controller is too fast beside the joint to be followed")
    if found.unstable and not (found.hunts and min(found.unstable) > 1.0):
        return _no_answer(UNSTABLE)
    return ExactVerdict(
        smooth=not found.hunts,
        outcome=Outcome.STICKS if found.hunts else Outcome.STEADY,
        reason=HUNTING if found.hunts else None,
    )


def _controlled(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, boundary: bool = True
) -> ExactVerdict:
    course = controlled_course(joint, gains, velocity, conditions)
    if math.isnan(course.persists):
        return _no_answer("the controller is too fast beside the joint to be followed")
    if course.unstable:
        return _no_answer(UNSTABLE)
    outcome = course.outcome
    if outcome is None:
        return _no_answer("the motion does not show in a thousand periods what it leads to")

    def persists_at(ratio: float) -> bool:
        damping = float(damping_for_ratio(joint, gains.stiffness, ratio))
        return controlled_cycle_persists(joint, replace(gains, damping=damping), velocity, conditions) == 1.0

    critical = _least_calming_ratio(persists_at) if boundary else math.nan
    ratio = float(dimensionless_groups(joint, gains, velocity).damping_ratio)
    return ExactVerdict(
        smooth=outcome is not Outcome.STICKS,
        outcome=outcome,
        critical_damping_ratio=critical,
        damping_reserve=float(damping_reserve(ratio, critical)),
    )


def _least_calming_ratio(persists_at: Callable[[float], bool]) -> float:
    """Least damping ratio that ends the cycle, looked for from below: too much sampled damping is unstable."""
    if not persists_at(0.0):
        return 0.0
    low, high = 0.0, _FIRST_RATIO
    while persists_at(high):
        low, high = high, 2.0 * high
        if high > LARGEST_DAMPING_RATIO:
            return math.nan
    low, high = bisected_until(
        persists_at,
        low,
        high,
        lambda inside, outside: outside - inside > _CONTROLLED_TOLERANCE * outside and outside > _LEAST_RATIO,
    )
    return 0.5 * (low + high)
