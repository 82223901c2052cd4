# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Beyond the paper: does stick slip persist under integral action, sampled control, or at standstill?

No condition in closed form covers these; the joint is simulated, in SI units, until its cycles tell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.conditions import OperatingConditions as OperatingConditions
from stickslip_ros.model.divergence import runs_away
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, JointSimulation
from stickslip_ros.model.outcome import STEADY_SWING, Outcome

HUNTING = "hunting"

_COULOMB = 10.0  # of the Stribeck friction: enough that an arrested joint never slips back
_SETTLED = 1e-6  # relative change of the breakaway level from one cycle to the next
_BLOCK = 10  # cycles whose mean is compared where levels do not settle
_BLOCK_DROP = 0.01
_MOST_CYCLES = 400
_ALIKE, _ALIKE_IN_A_ROW = 2e-3, 3  # of a swing, from eight natural periods to the next
_MOST_PERIODS = 1000
_PERIODS_AT_ONCE = 8
_SAMPLES_A_PERIOD = 64
_SLIDING_PERIODS = 16
_FASTEST_CONTROLLER = 3000  # controller periods in a natural period, above which sampling is not followed


@dataclass(frozen=True, kw_only=True)
class ControlledCourse:
    """What becomes of a joint that breaks away with full static friction.

    Attributes
    ----------
    persists : whether stick slip goes on for ever: 1.0 or 0.0; NaN if it cannot be followed.
    outcome : None where there is none to tell. unstable : its motion grows without end.
    """

    persists: float
    outcome: Outcome | None = None
    unstable: bool = False


def controlled_cycle_persists(joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions) -> float:
    """Whether stick slip, begun from a stuck joint with full static friction, goes on for ever; scalars only.

    It does if the breakaway levels come to rest, or where sampling keeps them from that, if their mean over ten
    cycles does not fall any more. It has died if the joint slides on with an oscillation that does not grow.

    Returns
    -------
    1.0 if it does, or the motion grows without end; 0.0 if it dies out; NaN if the controller is too fast beside the
    joint to be followed.
    """
    return _course(joint, gains, velocity, conditions, to_the_end=False).persists


def controlled_course(joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions) -> ControlledCourse:
    """What becomes of a joint that breaks away with full static friction; scalars only.

    As :func:`controlled_cycle_persists`; a joint that slides on is followed until its largest departure from the speed
    within eight natural periods is a tenth of that at most and does not grow, or stays the same. If it does neither in
    a thousand natural periods, there is no outcome.
    """
    return _course(joint, gains, velocity, conditions, to_the_end=True)


def _course(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, to_the_end: bool
) -> ControlledCourse:
    """Whether the cycle persists, and what becomes of the joint if it is followed to the end."""
    stiffness, speed = float(gains.stiffness), abs(float(velocity))
    natural = natural_period(joint, gains)
    period = step_period(conditions, natural)
    if math.isnan(period):
        return ControlledCourse(persists=math.nan)
    friction = joint.friction
    # A contact that gives way does so by all that it holds, Coulomb friction too: that does not cancel.
    coulomb = _COULOMB * float(friction.stribeck) if friction.rigid else float(friction.coulomb)
    # Breakaway is at hand: the spring already carries all that static friction can hold, and what is constant is
    # carried by the integral, if there is one.
    force = float(friction.stribeck) - float(gains.damping) * speed
    constant = coulomb + conditions.load
    if gains.integral == 0:
        force += constant
    joint = replace(joint, friction=replace(friction, coulomb=coulomb))
    simulation = JointSimulation(
        joint,
        gains,
        error_integral=constant / float(gains.integral) if gains.integral else 0.0,
        load=conditions.load,
        sampled=conditions.controller_period > 0,
        control_delay=conditions.control_delay,
        compensation=conditions.compensation,
    )
    count = max(1, round(_PERIODS_AT_ONCE * natural / period))
    # How far behind its reference a joint may be that has only begun to slide.
    reach = abs(force) / stiffness + speed * natural
    sticks = ControlledCourse(persists=1.0, outcome=Outcome.STICKS)
    levels: list[float] = []
    slowest_before, last_event, swing_before, alike = -math.inf, 0.0, math.inf, 0
    while simulation.time < _MOST_PERIODS * natural and len(levels) < _MOST_CYCLES:
        times = simulation.time + period * np.arange(float(count))
        references = force / stiffness + speed * times
        motion = simulation.advance(period, references, np.full(count, speed))
        for event in motion.events:
            last_event = event.time
            if event.kind is EventKind.BREAKAWAY:
                levels.append(event.stribeck_level)
        if runs_away(joint, gains, conditions, references - motion.position, reach):
            return ControlledCourse(persists=1.0, unstable=True)
        if _settled(levels):
            return sticks
        if simulation.stuck:
            continue
        slowest = float(motion.velocity.min()) if not motion.events else -math.inf
        if simulation.time - last_event > _SLIDING_PERIODS * natural and slowest >= slowest_before:
            swing = float(np.abs(motion.velocity - speed).max()) / speed
            alike = alike + 1 if abs(swing - swing_before) <= _ALIKE * swing else 0
            if not to_the_end:
                return ControlledCourse(persists=0.0)
            if swing <= STEADY_SWING and swing <= swing_before:
                return ControlledCourse(persists=0.0, outcome=Outcome.STEADY)
            if alike >= _ALIKE_IN_A_ROW:
                return ControlledCourse(persists=0.0, outcome=Outcome.SWINGS)
            swing_before = swing
        slowest_before = slowest
    died = simulation.time - last_event > _SLIDING_PERIODS * natural
    return ControlledCourse(persists=0.0) if died and to_the_end else sticks


def natural_period(joint: Joint, gains: Gains) -> float:
    """2π/ω [s]."""
    return 2.0 * math.pi * math.sqrt(float(joint.inertia) / float(gains.stiffness))


def step_period(conditions: OperatingConditions, natural: float) -> float:
    """The controller's period, or a sampling of continuous control; NaN if too short to be followed [s]."""
    period = conditions.period or natural / _SAMPLES_A_PERIOD
    return math.nan if period * _FASTEST_CONTROLLER < natural else period


def _settled(levels: list[float]) -> bool:
    if len(levels) >= 4:
        steps = np.abs(np.diff(levels[-3:]))
        if steps[-1] <= _SETTLED * max(levels[-1], 1e-300) and steps[-1] <= steps[0]:
            return True
    if len(levels) < 6 * _BLOCK:
        return False
    before, after = np.mean(levels[-2 * _BLOCK : -_BLOCK]), np.mean(levels[-_BLOCK:])
    return bool(before - after < _BLOCK_DROP * before)
