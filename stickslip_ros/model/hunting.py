# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Standing still with integral action: does the joint hunt, from which starts, how far, and with which gains not?"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip_ros.model.controlled import OperatingConditions, natural_period, step_period
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation

# How far off the reference a joint begins, at rest, in stretches of the spring that static friction just holds.
STARTS = (1.0, 0.5, 3.0, 10.0)
_PERIODS_AT_ONCE = 8
_HUNTS = 40  # slips
_LONGEST = 1e5  # natural periods
_KEEPS = 0.9  # share of the slips' length that is left twenty slips later
_VANISHED = 1e-3
_LONGEST_STRETCH = 64
_DECADES, _A_DECADE = 3, 4  # of gains that are tried, and how many of them
_TOLERANCE = 0.02


@dataclass(frozen=True, kw_only=True)
class Hunting:
    """What integral action makes of a joint whose reference stands still.

    Attributes
    ----------
    hunts : whether it slips to and fro without end, from any of the STARTS; None if that cannot be followed.
    starts : from which of them it does. period : from one slip to the next in the same direction [s], of the worst
        start; amplitude : half of what it goes to and fro [rad]; NaN without hunting.
    """

    hunts: bool | None
    starts: tuple[float, ...] = ()
    period: float = field(default=math.nan, metadata={"unit": "s"})
    amplitude: float = field(default=math.nan, metadata={"unit": "rad"})


def hunting(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> Hunting:
    """Whether a joint (scalars) hunts about a reference that stands still, by integration from each of the STARTS."""
    conditions = conditions or OperatingConditions()
    found = [(start, _course(joint, gains, conditions, start)) for start in STARTS]
    if any(course is None for _, course in found):
        return Hunting(hunts=None)
    hunted = [(start, course) for start, course in found if course is not None and course[0]]
    if not hunted:
        return Hunting(hunts=False)
    _, (_, period, amplitude) = max(hunted, key=lambda one: one[1][2])
    return Hunting(hunts=True, starts=tuple(start for start, _ in hunted), period=period, amplitude=amplitude)


def largest_quiet_integral(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> float:
    """Largest k_i [N·m/(rad·s)] up to the present one below which none hunts; 0 if all that are tried do.

    Tried are twelve of three decades, then what lies between.
    """
    highest = float(gains.integral)
    tried = highest * 10.0 ** (-np.arange(_DECADES * _A_DECADE, -1, -1) / _A_DECADE)
    return _last_quiet(tried.tolist(), lambda value: _quiet(joint, replace(gains, integral=value), conditions))


def least_quiet_stiffness(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> float:
    """Least k_p [N·m/rad] from the present one up beyond which none hunts with this k_i; infinite if all tried do."""
    least = float(gains.stiffness)
    tried = least * 10.0 ** (np.arange(_DECADES * _A_DECADE, -1, -1) / _A_DECADE)
    found = _last_quiet(tried.tolist(), lambda value: _quiet(joint, replace(gains, stiffness=value), conditions))
    return found if found > 0 else math.inf


def _quiet(joint: Joint, gains: Gains, conditions: OperatingConditions | None) -> bool:
    return hunting(joint, gains, conditions).hunts is False


def _last_quiet(tried: list[float], quiet: Callable[[float], bool]) -> float:
    """The last of the values, in their order, up to which all are quiet; 0 if the first is not."""
    last = 0.0
    for value in tried:
        if quiet(value):
            last = value
            continue
        if last == 0.0:
            return 0.0
        inside, outside = math.log(last), math.log(value)
        while abs(outside - inside) > _TOLERANCE:
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if quiet(math.exp(middle)) else (inside, middle)
        return math.exp(inside)
    return last


def _course(
    joint: Joint, gains: Gains, conditions: OperatingConditions, start: float
) -> tuple[bool, float, float] | None:
    """Whether it hunts from one start, its period and amplitude; None if it cannot be followed."""
    if gains.integral == 0:
        return False, math.nan, math.nan
    natural, friction = natural_period(joint, gains), joint.friction
    # Events are exact however seldom one looks.
    period = step_period(conditions, natural) if conditions.period > 0 else natural
    if math.isnan(period):
        return None
    offset = start * max(float(friction.coulomb) + float(friction.stribeck), 1e-12) / float(gains.stiffness)
    simulation = JointSimulation(
        joint,
        gains,
        load=conditions.load,
        error_integral=conditions.load / float(gains.integral),
        sampled=conditions.controller_period > 0,
        control_delay=conditions.control_delay,
        compensation=conditions.compensation,
    )
    count = max(1, round(_PERIODS_AT_ONCE * natural / period))
    slips: list[float] = []
    times: list[tuple[float, int]] = []
    slipped_from, stretch = 0.0, 1
    ends: tuple[float, float] = (0.0, 0.0)
    while len(slips) < _HUNTS and simulation.time < _LONGEST * natural:
        # A joint that stays stuck is followed in ever longer stretches.
        size = count * stretch
        motion = simulation.advance(period, np.full(size, offset), np.zeros(size))
        if not np.isfinite(motion.position).all():
            return True, math.nan, math.inf
        for event in motion.events:
            if event.kind is EventKind.BREAKAWAY:
                slipped_from = event.position
                times.append((event.time, event.direction))
            else:
                slips.append(abs(event.position - slipped_from))
                ends = (ends[1], event.position)
        stretch = min(2 * stretch, _LONGEST_STRETCH) if not motion.events else 1
        error = float(np.abs(motion.position - offset).max())
        if error < _VANISHED * offset or (slips and slips[-1] < _VANISHED * slips[0]):
            return False, math.nan, math.nan
    if len(slips) < _HUNTS:
        # Long slips: an oscillation without a stop, or a slow creep to the reference.
        hunts = len(slips) > 2
    else:
        recent, earlier = max(slips[-4:]), max(slips[-_HUNTS // 2 - 4 : -_HUNTS // 2])
        hunts = recent > _KEEPS * earlier
    if not hunts:
        return False, math.nan, math.nan
    alike = [time for time, direction in times if direction == times[-1][1]]
    lasted = alike[-1] - alike[-2] if len(alike) > 1 else math.nan
    return True, lasted, 0.5 * abs(ends[1] - ends[0])
