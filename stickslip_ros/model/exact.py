# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact verdict: integrate Eqs (4)-(6) from a stuck joint and see whether the cycle persists.

Eq. (43) is an approximation, mostly a conservative one; this is what it approximates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.dimensionless import damping_for_ratio, dimensionless_groups
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.model.simulation import EventKind, JointSimulation

_SAMPLES_A_PERIOD = 64
_PERIODS_AT_ONCE = 8
_SETTLED = 1e-7  # relative change of the breakaway level from one cycle to the next
_MOST_PERIODS = 1000
_SLIDING_PERIODS = 2 * _PERIODS_AT_ONCE
_COULOMB = 10.0  # of the Stribeck friction: enough that an arrested joint never slips back
_RELATIVE_TOLERANCE = 1e-3
_LARGEST_DAMPING_RATIO = 20.0
_LEAST_LAG = 0.002  # τ* below which the lag counts as none: steps may not be longer than it


@dataclass(frozen=True, kw_only=True)
class ExactVerdict:
    """Whether the stick-slip cycle dies out when Eqs (4)-(6) are integrated.

    Attributes
    ----------
    smooth : None where the question has no meaning.
    critical_damping_ratio : damping ratio at which the cycle just dies, to a relative 1e-3; NaN if none.
    """

    smooth: bool | None
    critical_damping_ratio: float


def exact_verdict(joint: Joint, gains: Gains, velocity: float) -> ExactVerdict:
    """Exact verdict on one joint (scalars) moving at a commanded velocity [rad/s] without integral action.

    Unknown for damping ratios beyond 20, where a step would be too small beside a period.
    """
    values = np.array([gains.stiffness, gains.damping, gains.integral, velocity], dtype=float)
    unknown = ExactVerdict(smooth=None, critical_damping_ratio=math.nan)
    if not np.isfinite(values).all() or gains.stiffness <= 0 or velocity == 0 or gains.integral != 0:
        return unknown
    with np.errstate(all="ignore"):
        groups = dimensionless_groups(joint, gains, velocity)
    if not abs(float(groups.damping_ratio)) <= _LARGEST_DAMPING_RATIO or not math.isfinite(float(groups.stribeck)):
        return unknown
    return ExactVerdict(
        smooth=not cycle_persists(joint, gains, velocity),
        critical_damping_ratio=exact_critical_damping_ratio(joint, gains, velocity),
    )


def cycle_persists(joint: Joint, gains: Gains, velocity: float) -> bool:
    """Whether stick slip, begun from a stuck joint with full static friction, goes on for ever.

    It does if the map from one breakaway level to the next has come to rest; the map converges
    geometrically. It has died if the joint slides on with an oscillation that does not grow.
    """
    stiffness, speed = float(gains.stiffness), abs(float(velocity))
    natural_period = 2.0 * math.pi * math.sqrt(float(joint.inertia) / stiffness)
    friction = joint.friction
    if 2.0 * math.pi * float(friction.lag) < _LEAST_LAG * natural_period:
        friction = replace(friction, lag=0.0)
    coulomb = _COULOMB * float(friction.stribeck)
    # Breakaway is at hand: the spring already carries all that friction can hold.
    reference = (coulomb + float(friction.stribeck) - float(gains.damping) * speed) / stiffness
    simulation = JointSimulation(replace(joint, friction=replace(friction, coulomb=coulomb)), gains)
    period = natural_period / _SAMPLES_A_PERIOD
    count = _SAMPLES_A_PERIOD * _PERIODS_AT_ONCE
    levels: list[float] = []
    slowest_before = -math.inf
    last_event = 0.0
    for _ in range(_MOST_PERIODS // _PERIODS_AT_ONCE):
        trajectory = simulation.advance(
            period, reference + speed * (simulation.time + period * np.arange(float(count))), np.full(count, speed)
        )
        for event in trajectory.events:
            last_event = event.time
            if event.kind is EventKind.BREAKAWAY:
                levels.append(event.stribeck_level)
        if _settled(levels):
            return True
        if simulation.stuck:
            continue
        slowest = float(trajectory.velocity.min()) if not trajectory.events else -math.inf
        if simulation.time - last_event > _SLIDING_PERIODS * natural_period and slowest >= slowest_before:
            return False
        slowest_before = slowest
    return True


def _settled(levels: list[float]) -> bool:
    if len(levels) < 4:
        return False
    steps = np.abs(np.diff(levels[-3:]))
    return bool(steps[-1] <= _SETTLED * max(levels[-1], 1e-300) and steps[-1] <= steps[0])


def exact_critical_damping_ratio(joint: Joint, gains: Gains, velocity: float) -> float:
    """ρ at which the cycle just dies at the given stiffness, by bisection to a relative 1e-3.

    0 if it dies undamped, NaN if even a damping ratio of 20 does not end it.
    """

    def persists(ratio: float) -> bool:
        damping = float(damping_for_ratio(joint, gains.stiffness, ratio))
        return cycle_persists(joint, Gains(stiffness=gains.stiffness, damping=damping), velocity)

    if not persists(0.0):
        return 0.0
    paper = float(stability_margin(joint, replace(gains, damping=0.0), velocity).critical_damping_ratio)
    low, high = 0.0, min(paper, _LARGEST_DAMPING_RATIO) if paper > 0 else 0.1
    while persists(high):
        low, high = high, 2.0 * high
        if high > _LARGEST_DAMPING_RATIO:
            return math.nan
    while high - low > _RELATIVE_TOLERANCE * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if persists(middle) else (low, middle)
    return 0.5 * (low + high)
