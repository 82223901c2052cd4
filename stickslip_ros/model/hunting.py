# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Standing still with integral action: does the joint hunt, from which starts, how far, and with which gains not?

A joint hunts if its slips alternate in direction and do not decay. Slips one way, which bring it ever closer to its
reference, are not hunting, nor is a slide that becomes ever slower.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import bisected_until
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import Event, EventKind, JointSimulation
from stickslip_ros.model.long_motion import (
    PERIODS_AT_ONCE,
    UnstableLoopError,
    advanced,
    cycles_persist,
    natural_period,
    too_fast,
)
from stickslip_ros.model.loop_modes import loop_is_unstable

# How far off the reference a joint begins, at rest, in stretches of the spring that static friction just holds.
STARTS = (1.0, 0.5, 3.0, 10.0)
# Likewise in stretches that Stribeck friction alone holds: a joint that hunts just so does it no farther than that.
NEAR_STARTS = (0.5, 0.7, 1.0, 1.4)
_SAMPLES_A_PERIOD = 8  # samples of continuous control in a natural period, 1
_LONGEST = 1e5  # simulated span, natural periods
_LONGEST_STRETCH = 64  # longest simulation between two looks, of the shortest one
_COARSER = 16  # factor on the interval between looks while the joint stands, 1
_VANISHED = 1e-3  # swing, of the stretch that Stribeck friction alone holds: with less it has vanished
_AGAIN = 4  # swings that are compared with as many before, 1
_ALIKE = 1e-3  # change of a swing, of the swing: with less there is none
_GROWING, _BLOCK = 200, 20  # swings that have grown all the time, 1; swings of a block, whose largest one counts, 1
_ONE_WAY = 30  # slips in one direction, 1: so many are no hunting
_FULL = 0.95  # Stribeck friction, of that after long contact: with more it does not rise any more
_SLOW = 0.5  # speed, Stribeck velocities: below it a slower slide is a more stable one
_STEADIER = 3  # stretches in a row, 1: with so many ever steadier ones the joint slides on
_DECADES, _A_DECADE = 3, 4  # range of gains that are tried, decades; gains in each, 1
_TOLERANCE = 0.02  # error of a gain's logarithm, 1


@dataclass(frozen=True, kw_only=True)
class Hunting:
    """What integral action makes of a joint whose reference stands still.

    Attributes
    ----------
    hunts : whether it slips to and fro without end, from any of :func:`starts_of`; None if that cannot be followed.
    starts : from which of them it does. period : from one swing to the next in the same direction [s], of the worst
        start; amplitude : half of what it goes to and fro [rad]; NaN without hunting.
    unstable : from which of them its motion grows without end.
    """

    hunts: bool | None
    starts: tuple[float, ...] = ()
    period: float = field(default=math.nan, metadata={"unit": "s"})
    amplitude: float = field(default=math.nan, metadata={"unit": "rad"})
    unstable: tuple[float, ...] = ()

    @property
    def settles(self) -> bool:
        """Whether it comes to rest from every start."""
        return self.hunts is False and not self.unstable


def starts_of(joint: Joint) -> tuple[float, ...]:
    """How far off the reference the joint begins, at rest, in stretches that static friction holds (STARTS)."""
    stribeck = float(joint.friction.stribeck)
    near = [round(share * stribeck / _held(joint), 6) for share in NEAR_STARTS]
    return tuple(dict.fromkeys(start for start in (*STARTS, *near) if start > 0))


def hunting(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> Hunting:
    """Whether a joint (scalars) hunts about a reference that stands still, by integration from several starts."""
    conditions = conditions or OperatingConditions()
    found = []
    for start in starts_of(joint):
        course = _course(joint, gains, conditions, _at_rest(joint, start))
        if course is None:
            return Hunting(hunts=None)
        found.append((start, course))
    hunted = [(start, course) for start, course in found if course.end is _End.HUNTS]
    worst = max((course for _, course in hunted), key=lambda course: course.amplitude, default=_SETTLED)
    return Hunting(
        hunts=bool(hunted),
        starts=tuple(start for start, _ in hunted),
        period=worst.period,
        amplitude=worst.amplitude,
        unstable=tuple(start for start, course in found if course.end is _End.GROWS),
    )


def largest_non_hunting_integral(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> float:
    """Largest k_i [N·m/(rad·s)] up to the present one below which it settles; 0 if it does with none that is tried.

    Tried are twelve of three decades, then what lies between: from each of the starts, and from the motion with which
    it hunts at the gain that was tried before.
    """
    highest = float(gains.integral)
    tried = highest * 10.0 ** (-np.arange(_DECADES * _A_DECADE + 1.0) / _A_DECADE)
    return _last_quiet(tried.tolist(), joint, lambda value: replace(gains, integral=value), conditions)


def least_quiet_stiffness(joint: Joint, gains: Gains, conditions: OperatingConditions | None = None) -> float:
    """Least k_p [N·m/rad] from the present one up beyond which it settles; infinite if it does with none that is tried.

    Tried as by :func:`largest_non_hunting_integral`.
    """
    least = float(gains.stiffness)
    tried = least * 10.0 ** (np.arange(_DECADES * _A_DECADE + 1.0) / _A_DECADE)
    found = _last_quiet(tried.tolist(), joint, lambda value: replace(gains, stiffness=value), conditions)
    return found if found > 0 else math.inf


class _End(Enum):
    SETTLES = "settles"
    HUNTS = "hunts"
    GROWS = "grows"


@dataclass(frozen=True, kw_only=True)
class _Start:
    """A joint at rest: the force of the spring [N·m], and of the integral beyond the load."""

    spring: float
    integral: float = 0.0


@dataclass(frozen=True, kw_only=True)
class _Course:
    """What becomes of a joint from one start; how it hunts, and where its last swing but one ended."""

    end: _End
    period: float = math.nan
    amplitude: float = math.nan
    rest: _Start | None = None


_SETTLED, _GROWN = _Course(end=_End.SETTLES), _Course(end=_End.GROWS)


def _held(joint: Joint) -> float:
    return max(float(joint.friction.coulomb) + float(joint.friction.stribeck), 1e-12)


def _at_rest(joint: Joint, start: float) -> _Start:
    return _Start(spring=start * _held(joint))


def _last_quiet(
    tried: Sequence[float], joint: Joint, gains: Callable[[float], Gains], conditions: OperatingConditions | None
) -> float:
    """The value beyond which, to the end of what is tried, a joint settles; 0 if it does not at the last."""
    conditions = conditions or OperatingConditions()
    rest: _Start | None = None

    def unquiet(value: float) -> bool:
        nonlocal rest
        starts = [*([rest] if rest else []), *(_at_rest(joint, start) for start in starts_of(joint))]
        for start in starts:
            course = _course(joint, gains(value), conditions, start)
            if course is None or course.end is not _End.SETTLES:
                rest = course.rest if course is not None and course.rest is not None else rest
                return True
        return False

    last, hunted_at_last = -1, None
    for number, value in enumerate(tried):
        if unquiet(value):
            last, hunted_at_last = number, rest
    if last == len(tried) - 1:
        return 0.0
    if last < 0:
        return tried[0]
    rest = hunted_at_last
    inside, _ = bisected_until(
        lambda logarithm: not unquiet(math.exp(logarithm)),
        math.log(tried[last + 1]),
        math.log(tried[last]),
        lambda inside, outside: abs(outside - inside) > _TOLERANCE,
    )
    return math.exp(inside)


def _course(joint: Joint, gains: Gains, conditions: OperatingConditions, start: _Start) -> _Course | None:
    """What becomes of it from one start; None if it cannot be followed."""
    if gains.integral == 0:
        return _SETTLED
    natural, stiffness = natural_period(joint, gains), float(gains.stiffness)
    if too_fast(conditions, natural):
        return None
    # Events are exact however seldom one looks.
    period = conditions.period or natural / _SAMPLES_A_PERIOD
    offset = start.spring / stiffness
    simulation = JointSimulation.under(joint, gains, conditions, carried=conditions.load + start.integral)
    count = max(1, round(PERIODS_AT_ONCE * natural / period))
    unstable = loop_is_unstable(joint, gains, conditions)
    slips = _Slips(offset)
    slow = _SLOW * float(joint.friction.stribeck_velocity)
    slide = [math.inf]  # changes of the speed in the last stretches of a slow slide
    reach = STARTS[-1] * _held(joint) / stiffness
    small = _VANISHED * (float(joint.friction.stribeck) or 1e-3 * _held(joint)) / stiffness
    stretch = 1
    while simulation.time < _LONGEST * natural:
        # A joint that neither slips nor stops is followed in ever longer stretches.
        coarser = min(stretch, _COARSER) if simulation.stuck and conditions.period == 0 else 1
        size = count * stretch // coarser
        try:
            motion = advanced(simulation, conditions, coarser * period, np.full(size, offset), 0.0, reach)
        except UnstableLoopError:
            return _GROWN
        errors = offset - motion.position
        for event in motion.events:
            slips.add_event(event)
        if slips.hunts(unstable=unstable):
            return slips.hunting(joint, gains)
        if unstable and slips.grow():
            return _GROWN
        quiet = not motion.events
        slides = quiet and not simulation.stuck and float(np.abs(motion.velocity).max()) <= slow
        spread = float(np.abs(np.diff(motion.velocity)).max(initial=0.0))
        slide = [*slide[-_STEADIER:], spread] if slides else [math.inf]
        stretch = min(2 * stretch, _LONGEST_STRETCH) if quiet else 1
        if (
            slips.decayed(small)
            or slips.creep(float(joint.friction.stribeck))
            or (quiet and float(np.abs(errors).max()) < small)
            or (quiet and simulation.stuck and _holds(joint, gains, conditions, simulation, float(errors[-1])))
            or (not unstable and len(slide) > _STEADIER and (np.diff(slide) <= 0.0).all())
        ):
            return _SETTLED
    return _SETTLED


def _holds(
    joint: Joint, gains: Gains, conditions: OperatingConditions, simulation: JointSimulation, error: float
) -> bool:
    """Whether a contact that gives way carries all that there is until the joint is at its reference."""
    friction = joint.friction
    if friction.rigid or conditions.period > 0:
        return False
    leaning = replace(
        gains,
        stiffness=float(gains.stiffness) + float(friction.presliding_stiffness),
        damping=float(gains.damping) + float(friction.presliding_damping),
    )
    if loop_is_unstable(joint, leaning, conditions):
        return False
    most = _FULL * (float(friction.coulomb) + simulation.stribeck_level) / float(friction.presliding_stiffness)
    return max(abs(simulation.deflection), abs(simulation.deflection + error)) < most


class _Slips:
    """Slips of one course, and the swings that they make: slips in the same direction, one after the other."""

    def __init__(self, offset: float) -> None:
        self._offset = offset
        self._from: Event | None = None
        self._lengths: list[float] = []  # of slips, with their directions
        self._levels: list[float] = []
        self._swings: list[float] = []
        self._ends: list[float] = []
        self._begun: list[float] = []
        self._one_way = 0

    def add_event(self, event: Event) -> None:
        if event.kind is EventKind.BREAKAWAY:
            self._from = event
            return
        if self._from is None:
            return
        length = event.position - self._from.position
        if self._lengths and length * self._lengths[-1] > 0:
            self._one_way += 1
            self._swings[-1] += abs(length)
            self._ends[-1] = event.position
        else:
            self._one_way = 1
            self._swings.append(abs(length))
            self._ends.append(event.position)
            self._begun.append(self._from.time)
        self._lengths.append(length)
        self._levels.append(self._from.stribeck_level)

    @property
    def _whole(self) -> NDArray[np.float64]:
        """Lengths of swings that have ended."""
        return np.array(self._swings[:-1])

    def hunts(self, *, unstable: bool) -> bool:
        """Whether the swings come to repeat themselves; or where they never quite do, do not decay."""
        return cycles_persist(self._whole, _ALIKE, group=_AGAIN, bounded=not unstable)

    def grow(self) -> bool:
        """Whether the swings have grown all the time, long enough to come to an end of that."""
        swings = self._whole
        if len(swings) < _GROWING:
            return False
        blocks = swings[-_GROWING:].reshape(-1, _BLOCK).max(axis=1)
        return bool((np.diff(blocks) > _ALIKE * blocks[:-1]).all())

    def decayed(self, small: float) -> bool:
        """Whether the slips have become next to nothing."""
        return len(self._lengths) >= _AGAIN and max(map(abs, self._lengths[-_AGAIN:])) < small

    def creep(self, stribeck: float) -> bool:
        """Whether slips in one direction become shorter, with static friction that has risen as far as it can.

        The closer to the reference, the slower the integral pulls, and the more gently the joint slips.
        """
        if self._one_way < _ONE_WAY or self._levels[-1] < _FULL * stribeck:
            return False
        lengths = np.abs(self._lengths[-_ONE_WAY:])
        third = _ONE_WAY // 3
        return bool(lengths[-third:].max() < lengths[:third].max())

    def hunting(self, joint: Joint, gains: Gains) -> _Course:
        """How it hunts; the last swing that ended is the one that counts."""
        at = len(self._swings) - 2
        error = self._offset - self._ends[at]
        spring = float(gains.stiffness) * error
        # The slip that follows begins where the controller's force is what static friction holds.
        direction = math.copysign(1.0, self._ends[at + 1] - self._ends[at])
        return _Course(
            end=_End.HUNTS,
            period=self._begun[at] - self._begun[at - 2],
            amplitude=0.5 * abs(self._ends[at] - self._ends[at - 1]),  # what a contact gives way is in it
            rest=_Start(spring=spring, integral=direction * _held(joint) - spring),
        )
