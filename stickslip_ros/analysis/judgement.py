# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is said of a joint over a whole recording, from its stretches of one status each.

**Moving time** is the time in which the joint moved or stuck: in every status but ``at_rest`` and ``unknown``.
**The share of stick-slip** is the time in status ``stick_slip`` over the moving time.
**The status** of a recording is the one that held for most of the time in which the motion was judged: of
``stick_slip``, ``at_risk`` and ``smooth`` the one of the longest time, of two of the same time the more severe. That
time must be a fifth of the moving time: what an arm that stops and goes did in between says nothing of the whole. A
joint of which less was judged is ``not_judged`` if it moved for half a second, else ``at_rest`` if it stood, else
``unknown``. One that was smooth or at risk, and for longer stuck, stopped and went, or did not follow its reference, is
``not_judged``, too.
**Stuck** is a joint that stands for half a second or more while its reference goes on, but for where it turns round:
where its motions before and after, flicker aside, go opposite ways, and the one before was not against its reference.
**Stops and goes** are motions one way, each too short to be judged, with the stands between them, where no reference
tells commanded stops from sticking; they count as ``not_judged``, and as moving time, as the dwells of stick-slip do.
**Does not follow** is motion of less than two thirds or more than one and a half times the way of a reference that goes
on evenly, or the opposite way: no motion of that reference's joint.
**The worst status** is the most severe that occurred, by the order of ``SEVERITY``: stick-slip however short, since it
takes cycles; any other if it lasted half a second without a break, or is the status.
**A transient** is stick-slip that dies out: a joint that stuck a few times after starting, and moved smoothly from then
on.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection._swing_kernel import FLICKER
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import NotFollowing, Segment, Status, StopsAndGoes, Stuck, TooFewSamples

# The most severe first.
SEVERITY = (
    Status.STICK_SLIP,
    Status.AT_RISK,
    Status.SMOOTH,
    Status.NOT_JUDGED,
    Status.AT_REST,
    Status.UNKNOWN,
)
JUDGED = (Status.STICK_SLIP, Status.AT_RISK, Status.SMOOTH)
NOT_JUDGED = (Status.UNKNOWN, Status.NOT_JUDGED)
_NOT_MOVING = (Status.AT_REST, Status.UNKNOWN)
_LEAST_SHARE = 0.2  # of the moving time that must have been judged
_LEAST_TIME = 0.5  # [s] without a break, from which on a status says something of a recording
# Of a transient.
_PERIODS = 2.0  # that may pass between a start and the first stick, and between sticks
_LATEST = 2.0 / 3.0  # of the moving time, by which the last cycle must have ended
_FASTER = 3.0  # times the speed of the cycles, from which on smooth motion says nothing of them


def time_in(segments: Sequence[Segment], status: Status) -> float:
    """How long a joint was in a status [s]."""
    return sum(one.end - one.start for one in segments if one.status is status)


def moving_time(segments: Sequence[Segment]) -> float:
    """How long a joint moved or stuck [s]: see the module."""
    return sum(one.end - one.start for one in segments if moves(one))


def moves(segment: Segment) -> bool:
    """Whether a stretch counts as moving time: see the module."""
    return segment.status not in _NOT_MOVING


def stick_slip_share(segments: Sequence[Segment]) -> float:
    """Share of the moving time that was spent in stick-slip, 0 to 1; NaN if the joint did not move."""
    moving = moving_time(segments)
    return time_in(segments, Status.STICK_SLIP) / moving if moving > 0.0 else math.nan


def overall_status(segments: Sequence[Segment], band: float = 0.0) -> Status:
    """The status that held for most of the time in which the motion was judged: see the module."""
    times = {status: time_in(segments, status) for status in SEVERITY}
    # Of equal times max() takes the first, which is the more severe.
    most = max(JUDGED, key=times.__getitem__)
    seen = stuck(segments, band)
    perhaps_stuck = caveat(segments)[1] + (seen.duration if seen is not None else 0.0)
    if most is not Status.STICK_SLIP and perhaps_stuck > times[most] > 0.0:
        return Status.NOT_JUDGED
    if sum(times[status] for status in JUDGED) >= _LEAST_SHARE * moving_time(segments) > 0.0:
        return most
    if moving_time(segments) >= _LEAST_TIME:
        return Status.NOT_JUDGED
    for status in (Status.AT_REST, Status.NOT_JUDGED):
        if times[status] > 0.0:
            return status
    return segments[-1].status if segments else Status.UNKNOWN


def stuck(segments: Sequence[Segment], band: float = 0.0) -> Stuck | None:
    """How long the joint was stuck in all, see the module; None if it was not.

    Parameters
    ----------
    band : the smallest motion told from rest [rad].
    """
    ways = [one.velocity * (one.end - one.start) if moves(one) else 0.0 for one in segments]
    went = [number for number, way in enumerate(ways) if abs(way) > FLICKER * band]
    stands = []
    for number, one in enumerate(segments):
        after = bisect_left(went, number)
        turns = 0 < after < len(went) and ways[went[after - 1]] * ways[went[after]] < 0.0
        # What had left its reference, and stands until that has come back to it, does not turn with it.
        turns = turns and ways[went[after - 1]] * segments[went[after - 1]].led >= 0.0
        time = min(one.stuck, one.end - one.start)
        if one.status is Status.AT_REST and time >= _LEAST_TIME and not turns:
            stands.append((time, one.travel))
    if not stands:
        return None
    return Stuck(duration=sum(time for time, _ in stands), travel=sum(travel for _, travel in stands))


def caveat(segments: Sequence[Segment]) -> tuple[StopsAndGoes | NotFollowing | None, float]:
    """Why most of the time that bears on the whole was not judged, see the module, and how long that was so [s]."""
    unsettled = [one for one in segments if one.caveat is not None and one.status is Status.NOT_JUDGED]
    of_kind = [[one for one in unsettled if isinstance(one.caveat, kind)] for kind in (StopsAndGoes, NotFollowing)]
    most = max(of_kind, key=moving_time)
    longest = max(most, key=lambda one: one.end - one.start, default=None)
    return (longest.caveat if longest is not None else None), moving_time(most)


def worst_status(segments: Sequence[Segment], band: float = 0.0) -> Status:
    """The most severe status that occurred: see the module."""
    lasted = {one.status for one in segments if one.status is Status.STICK_SLIP or one.end - one.start > _LEAST_TIME}
    return min({*lasted, overall_status(segments, band)}, key=SEVERITY.index)


def lacks_data(status: Status, assessment: Assessment) -> bool:
    """Whether a joint could not be judged because of its data, not of its motion."""
    poor = isinstance(assessment.finding.reason, TooFewSamples) or assessment.restarts > 0
    return status is Status.UNKNOWN or (status is Status.NOT_JUDGED and poor)


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
