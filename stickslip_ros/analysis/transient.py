# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stick-slip that dies out: a joint that stuck a few times after starting, and moved smoothly from then on."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_ros.analysis.judgement import moves
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Segment, Status

_PERIODS = 2.0  # that may pass between a start and the first stick, and between sticks
_LATEST = 2.0 / 3.0  # of the moving time, by which the last cycle must have ended
_FASTER = 3.0  # times the speed of the cycles, from which on smooth motion says nothing of them


@dataclass(frozen=True, kw_only=True)
class Transient:
    """Stick-slip after starting that died out.

    Attributes
    ----------
    cycles : how many there were. end : arrest of the last one [s]. smooth : how long the joint was smooth after it [s].
    """

    cycles: int
    end: float
    smooth: float


def transient(segments: Sequence[Segment], cycles: Sequence[Cycle]) -> Transient | None:
    """The transient that the stick-slip of a recording was; None if it was something else, or there was none.

    It was one if all of this holds, whereby a start is where a joint leaves rest, or is first seen to move:

    - every cycle follows upon a start or upon another cycle, within two periods, and none is hunting;
    - the last cycle ended before the last third of the moving time;
    - since then the joint was smooth for longer than it was in stick-slip, and for most of the time it moved, at no
      more than three times the speed: what moves smoothly because it is faster would stick again.

    Parameters
    ----------
    segments : stretches of one status of the whole recording, in order of time. cycles : all of them, likewise.
    """
    if not cycles or any(cycle.hunting for cycle in cycles) or not _each_follows(segments, cycles):
        return None
    end = cycles[-1].arrest
    moving = [one for one in segments if moves(one)]
    total, after = _time_after(moving, -math.inf), _time_after(moving, end)
    fastest = _FASTER * max(cycle.mean_speed for cycle in cycles)
    comparable = [one for one in moving if one.status is Status.SMOOTH and abs(one.velocity) <= fastest]
    smooth = _time_after(comparable, end)
    stuck = _time_after([one for one in moving if one.status is Status.STICK_SLIP], -math.inf)
    dies_out = total - after < _LATEST * total and smooth > stuck and smooth > 0.5 * after
    return Transient(cycles=len(cycles), end=end, smooth=smooth) if dies_out else None


def _each_follows(segments: Sequence[Segment], cycles: Sequence[Cycle]) -> bool:
    """Whether every cycle comes soon after a start, or after the cycle before it."""
    starts = _starts(segments, cycles)
    arrest = -math.inf
    for cycle in cycles:
        number = bisect_right(starts, cycle.arrest)
        latest = max(arrest, starts[number - 1] if number else -math.inf)
        if cycle.breakaway - cycle.dwell - latest > _PERIODS * cycle.period:
            return False
        arrest = cycle.arrest
    return True


def _starts(segments: Sequence[Segment], cycles: Sequence[Cycle]) -> list[float]:
    """When the joint left rest, or was first seen to move [s]; leaving the rest before a slip is no start."""
    breakaways = [cycle.breakaway for cycle in cycles]
    starts = []
    for number, one in enumerate(segments):
        if moves(one):
            starts += [one.start] if number == 0 else []
            continue
        middle = 0.5 * (one.start + one.end)
        following = bisect_left(breakaways, middle)
        sticks = following < len(cycles) and cycles[following].breakaway - cycles[following].dwell <= middle
        # A recording that begins at rest begins before a start, whatever the reference did.
        starts += [one.end] if number == 0 or not sticks else []
    return starts


def _time_after(segments: Sequence[Segment], time: float) -> float:
    """How much of some stretches lies after a time [s]."""
    return sum(max(one.end - max(one.start, time), 0.0) for one in segments)
