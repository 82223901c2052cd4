# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a long simulated motion shows: it grows without end, or its sizes repeat themselves, or they last.

Sizes are one number a cycle: friction levels at breakaway, lengths of swings, departures from a speed. Their judge is
here for every simulation in SI units (:mod:`.controlled`, :mod:`.hunting`). The cycle map has its own
(:mod:`.exact`, :mod:`.outcome`): from one number, the level at breakaway, it computes the next cycle of any level, so
that it looks ahead to a limit in place of waiting for it. Beyond the paper's case a cycle begins with more numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import StickSlipError
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation, Trajectory
from stickslip_ros.model.loop_modes import loop_is_unstable

UNSTABLE = "the loop is unstable: its motion grows without end"
PERIODS_AT_ONCE = 8  # natural periods simulated by one call, 1

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
    motion = simulation.advance(period, references, np.broadcast_to(speed, references.shape))
    furthest = float(np.abs(references + period * speed - motion.position).max(initial=0.0))
    joint, gains = simulation.joint, simulation.gains
    held = float(joint.friction.coulomb) + float(joint.friction.stribeck) + abs(conditions.load)
    near = furthest <= _FAR * (reach + held / abs(float(gains.stiffness)))
    if not near and (not math.isfinite(furthest) or loop_is_unstable(joint, gains, conditions)):
        raise UnstableLoopError
    return motion


def repeats(sizes: Sequence[float] | NDArray[np.float64], change: float) -> bool:
    """Whether the last of three or more sizes is the one before to a relative change that does not grow.

    Below the square of it a change is rounding, and may grow.
    """
    first, before, latest = sizes[-3:]
    latest_change = abs(latest - before)
    return bool(latest_change <= change * before and latest_change <= max(abs(before - first), change**2 * before))


def block_ratio(
    sizes: Sequence[float] | NDArray[np.float64], block: int, size_of: Callable[..., float] = np.mean
) -> float:
    """Mean, or another size, of a last block of sizes over that of the block before; NaN if there are too few.

    A motion that never quite repeats itself, as one that a controller samples, lasts where this is 1.
    """
    if len(sizes) < 2 * block:
        return math.nan
    return float(size_of(sizes[-block:]) / size_of(sizes[-2 * block : -block]))
