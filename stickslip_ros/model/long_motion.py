# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a long simulated motion shows: it grows without end, its cycles persist, or sizes of them have no trend.

Sizes are one number a cycle: friction levels at breakaway, lengths of swings, departures from a speed. Their judge is
here for every simulation in SI units, :mod:`stickslip_ros.model.controlled` and :mod:`stickslip_ros.model.hunting`. The
cycle map of :mod:`stickslip_ros.model.exact` has one of its own: the level at breakaway is all its state, so that it
computes the limit of the levels. In SI units a cycle begins with more numbers, and a limit is waited for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation, Trajectory
from stickslip_ros.model.loop_modes import loop_is_unstable

UNSTABLE = "the loop is unstable: its motion grows without end"
PERIODS_AT_ONCE = 8  # natural periods simulated by one call, 1

_MANY_CYCLES, MOST_CYCLES = 80, 400  # cycles, 1: from which on their trend counts; that are followed
NO_TREND = 0.01  # change from block to block, of the size, 1: less is lost in what sampling scatters
_BLOCK = 10  # sizes of a block, 1: the mean of so many scatters by a third of what one of them does
_FASTEST_CONTROLLER = 3000  # controller periods in a natural period, 1: with more sampling is not followed
_FAR = 30.0  # distance, of what the joint has to do with and what friction holds: a joint so far off runs away


class UnstableLoopError(StickSlipError):
    """The motion grows without end, and nothing is read off it."""

    def __init__(self) -> None:
        super().__init__(UNSTABLE)


def natural_period(joint: Joint, gains: Gains) -> float:
    """2π/ω [s]."""
    return 2.0 * math.pi * math.sqrt(float(joint.inertia) / float(gains.stiffness))


def too_fast(conditions: OperatingConditions, natural: float) -> bool:
    """Whether what the controller does once in a while comes too often in a natural period [s] to be followed."""
    return 0.0 < conditions.period * _FASTEST_CONTROLLER < natural


def advanced(
    simulation: JointSimulation,
    conditions: OperatingConditions,
    period: float,
    references: NDArray[np.float64],
    speed: float | NDArray[np.float64],
    reach: float,
) -> Trajectory:
    """The motion over the next periods, :meth:`.JointSimulation.advance`, unless it grows without end.

    All friction but the viscous part is bounded, and so is what a compensation adds. What a joint does far away is
    therefore what the linear loop without them does: a loop that is stable keeps the motion bounded, one that is not
    may be held by friction near rest, and runs away from farther.

    Parameters
    ----------
    speed : of the references [rad/s].
    reach : what a joint has to do with anyway: its reference's travel, how far off it starts [rad].

    Raises
    ------
    UnstableLoopError
        If the errors of position are those of a loop that is unstable, and far beyond what friction can hold.
    """
    motion = simulation.advance(period, references, np.full(references.shape, speed))
    furthest = float(np.abs(references + period * speed - motion.position).max(initial=0.0))
    joint, gains = simulation.joint, simulation.gains
    held = float(joint.friction.coulomb) + float(joint.friction.stribeck) + abs(conditions.load)
    near = furthest <= _FAR * (reach + held / abs(float(gains.stiffness)))
    if not near and (not math.isfinite(furthest) or loop_is_unstable(joint, gains, conditions)):
        raise UnstableLoopError
    return motion


def trend(sizes: Sequence[float] | NDArray[np.float64]) -> float:
    """Relative change of the mean of a block of sizes from the block before it to the last; NaN without two blocks.

    A motion that never quite repeats itself, as one that a controller samples, lasts where it is within NO_TREND.
    """
    if len(sizes) < 2 * _BLOCK:
        return math.nan
    return float(np.mean(sizes[-_BLOCK:]) / np.mean(sizes[-2 * _BLOCK : -_BLOCK]) - 1.0)


def cycles_persist(
    sizes: Sequence[float] | NDArray[np.float64], change: float, *, group: int = 1, bounded: bool = True
) -> bool:
    """Whether cycles go on for ever: they come to repeat themselves, or after many of them have no trend.

    Parameters
    ----------
    sizes : of successive cycles. change : of the sizes, relative: with less, that does not grow, they repeat
        themselves; below the square of it a change is rounding, and may grow.
    group : cycles of which the largest one counts, where directions take turns.
    bounded : whether their growth comes to an end; where the loop is unstable, only the most cycles show that.
    """
    if len(sizes) < 3 * group:
        return False
    first, before, latest = np.reshape(sizes[-3 * group :], (3, group)).max(axis=1)
    latest_change = abs(latest - before)
    if latest_change <= change * before and latest_change <= max(abs(before - first), change**2 * before):
        return True
    if len(sizes) < _MANY_CYCLES:
        return False
    growth = trend(sizes)
    return (bounded and abs(growth) <= NO_TREND) or (len(sizes) >= MOST_CYCLES and growth > -NO_TREND)
