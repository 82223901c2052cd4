# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Beyond the paper at a constant speed: does stick-slip persist under integral action, sampled control, on a contact?

No condition in closed form covers these; the joint is simulated, in SI units, until its cycles tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip_ros.model._sliding_kernel import STEADY_SWING
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.model.long_motion import (
    MOST_CYCLES,
    NO_TREND,
    PERIODS_AT_ONCE,
    advanced,
    cycles_persist,
    natural_period,
    trend,
)
from stickslip_ros.model.outcome import Outcome

_COULOMB = 10.0  # Coulomb friction, of the Stribeck friction: enough that an arrested joint never slips back
# Change of the breakaway level from one cycle to the next, of the level: with less it has settled. Close to the
# boundary a level that falls in the end stays almost the same for long.
_SETTLED = 1e-6
_MOST_PERIODS = 1000  # simulated span, natural periods
_SAMPLES_A_PERIOD = 64  # samples of continuous control in a natural period, 1
_SLIDING_PERIODS = 16  # time without an event, natural periods: with more the joint slides
# Stretches simulated under dither, 1; how many of them are compared, 1; scatter of slowest speed and swing over these,
# of the commanded speed.
_MOST_DITHERED, _LAST_DITHERED, _SAME_DITHERED = 25, 3, 0.02
_AT_REST = 0.01  # speed between like phases of a dither, of the commanded one: with less the joint is at rest
# Periods of a dither in a number of samples, 1; error of the phase then, samples.
_MOST_CYCLES_OF_DITHER, _PHASE = 8, 0.1


def controlled_course(
    joint: Joint, gains: Gains, velocity: float, conditions: OperatingConditions, *, to_the_end: bool = True
) -> Outcome | None:
    """What becomes of a joint that breaks away with full static friction; scalars only.

    Stick-slip goes on if the breakaway levels do, by :func:`stickslip_ros.model.long_motion.cycles_persist`. It has
    died if the joint slides on with an oscillation that does not grow.

    Parameters
    ----------
    to_the_end : whether a joint that slides on is followed until its largest departure from the speed within eight
        natural periods is a tenth of that at most and does not grow, or has no trend.

    Returns
    -------
    None if stick-slip has died and no more is seen: in a thousand natural periods, or not ``to_the_end``.

    Raises
    ------
    UnstableLoopError
        If the motion grows without end.
    """
    speed, compensation = abs(float(velocity)), conditions.compensation
    natural = natural_period(joint, gains)
    period = conditions.period or natural / _SAMPLES_A_PERIOD
    if compensation is not None and compensation.dither > 0:
        return _dithered_course(joint, gains, speed, conditions, period, natural)
    stiffness, friction = float(gains.stiffness), joint.friction
    compensated = compensation is not None and compensation.by_motion
    # What compensates has the size of the Coulomb friction, or the sign of the error, which that makes; a contact that
    # gives way does so by all that it holds, and a load that rings pulls either way: there it does not cancel.
    whole = compensated or not friction.rigid or joint.transmission is not None
    coulomb = float(friction.coulomb) if whole else _COULOMB * float(friction.stribeck)
    # Breakaway is at hand: the spring already carries all that static friction can hold, and what is constant is
    # carried by the integral, if there is one.
    force = float(friction.stribeck) - float(gains.damping) * speed
    constant = coulomb + conditions.load
    if compensation is not None:
        constant -= float(compensation.feedforward_torque(speed))
        force -= min(force, compensation.push * float(friction.coulomb + friction.stribeck))
    if gains.integral == 0:
        force += constant
    joint = replace(joint, friction=replace(friction, coulomb=coulomb))
    simulation = JointSimulation.under(joint, gains, conditions, carried=constant)
    count = max(1, round(PERIODS_AT_ONCE * natural / period))
    # How far behind its reference a joint may be that has only begun to slide.
    reach = abs(force) / stiffness + speed * natural
    levels: list[float] = []
    swings: list[float] = []
    last_event = 0.0
    while simulation.time < _MOST_PERIODS * natural and len(levels) < MOST_CYCLES:
        times = simulation.time + period * np.arange(float(count))
        motion = advanced(simulation, conditions, period, force / stiffness + speed * times, speed, reach)
        if len(motion.event_rows):
            last_event = motion.last_event
            levels += motion.breakaway_levels.tolist()
            swings.clear()
        if cycles_persist(levels, _SETTLED):
            return Outcome.STICKS
        swing = float(np.abs(motion.velocity - speed).max()) / speed
        if simulation.stuck and swing > STEADY_SWING:
            continue  # a contact that creeps lets a joint move at its speed that has not broken away
        swings.append(swing)
        if simulation.time - last_event <= _SLIDING_PERIODS * natural or len(swings) < 2:
            continue
        if swings[-1] <= swings[-2]:
            if not to_the_end:
                return None
            if swings[-1] <= STEADY_SWING:
                return Outcome.STEADY
        if to_the_end and abs(trend(swings)) <= NO_TREND:
            return Outcome.STEADY if swings[-1] <= STEADY_SWING else Outcome.SWINGS
    died = simulation.time - last_event > _SLIDING_PERIODS * natural
    return None if died and to_the_end else Outcome.STICKS


def _dithered_course(
    joint: Joint, gains: Gains, speed: float, conditions: OperatingConditions, period: float, natural: float
) -> Outcome:
    """What becomes of a joint under dither, which stops and starts it all the time: of the motion between like phases.

    It sticks if that motion comes to rest again and again, is steady if its speed keeps within a tenth of the commanded
    one, and swings if it does neither.
    """
    assert conditions.compensation is not None
    phases = _samples_between_phases(period, conditions.compensation.dither_frequency)
    held = conditions.load + float(joint.friction.coulomb) + float(joint.friction.stribeck)
    simulation = JointSimulation.under(joint, gains, conditions, carried=held)
    start = 0.0 if gains.integral else held / float(gains.stiffness)
    count = max(phases + 1, round(PERIODS_AT_ONCE * natural / period))
    last, seen = np.zeros(0), []
    for _ in range(_MOST_DITHERED):
        times = simulation.time + period * np.arange(float(count))
        references = start + speed * times
        reach = abs(start) + speed * natural
        position = advanced(simulation, conditions, period, references, speed, reach).position
        position = np.concatenate([last, position])
        last = position[-phases:]
        mean_speed = (position[phases:] - position[:-phases]) / (phases * period * speed)
        seen.append((float(mean_speed.min()), float(np.abs(mean_speed - 1.0).max())))
        if len(seen) > _LAST_DITHERED and np.ptp(seen[-_LAST_DITHERED:], axis=0).max() <= _SAME_DITHERED:
            break
    slowest, swing = np.array(seen[-_LAST_DITHERED:]).T
    if slowest.min() <= _AT_REST:
        return Outcome.STICKS
    return Outcome.STEADY if swing.max() <= STEADY_SWING else Outcome.SWINGS


def _samples_between_phases(period: float, frequency: float) -> int:
    """Samples in so few periods of a dither that they are a whole number of them, as nearly as that matters."""
    cycle = 1.0 / (frequency * period)
    few = [number * cycle for number in range(1, _MOST_CYCLES_OF_DITHER + 1)]
    return round(next((one for one in few if abs(one - round(one)) <= _PHASE), few[-1]))
