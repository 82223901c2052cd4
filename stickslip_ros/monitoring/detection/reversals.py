# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reversals that are seen: how long the joint stood, how far it fell behind, as `model/reversal.py` predicts it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from stickslip_ros.model.reversal import Reversal, following_error
from stickslip_ros.monitoring.detection.rests import Rest
from stickslip_ros.monitoring.samples import Batch, FloatArray, SampleBuffer

_KEPT = 200  # latest reversals whose medians are reported, 1
_BEFORE = 1.0  # dwells, or seconds if that is more, before the arrest, in which the reference may have turned
_LONGEST = 25.0  # time after the breakaway, s: the following error is not measured later
_LEAD = 2.0  # time by which the reference may turn before a joint that turns without a stop, s
_LEAST_TURN = 0.1  # way of the reference before a turn, of that after it
_LARGEST_STEP = 0.5  # change of the reference from sample to sample, of its way after the turn: more is a jump
_TURNS = 64  # latest turns that are kept, 1


@dataclass(frozen=True, kw_only=True)
class ReversalRecord:
    """The reversals seen, in which joint and reference turned.

    Attributes
    ----------
    count : how many. last : the latest.
    standing, lost_motion, peak_error : medians of the latest ones [s], [rad], [rad]; NaN before any. It stands for no
        time where it turns without a stop.
    largest_error : of these [rad].
    """

    count: int
    last: Reversal
    standing: float = field(metadata={"unit": "s"})
    lost_motion: float = field(metadata={"unit": "rad"})
    peak_error: float = field(metadata={"unit": "rad"})
    largest_error: float = field(metadata={"unit": "rad"})


class ReversalMeter:
    """Measures each reversal of a joint that follows a reference.

    A reversal is measured when the joint has turned, and turns again, or half a minute later; whether it stood in
    between or not. ``record`` : what was seen, None if there was no reversal. ``due`` : when :meth:`poll` has something
    to do [s].
    """

    def __init__(self) -> None:
        self.record: ReversalRecord | None = None
        self.due = math.inf
        self._count = 0
        self._latest: deque[Reversal] = deque(maxlen=_KEPT)
        self._open: Rest | None = None
        self._stops = 0
        self._settled = math.nan
        self._stood: deque[float] = deque(maxlen=_TURNS)
        self._passing: tuple[float, float] | None = None

    def _add(self, found: Reversal | None) -> None:
        if found is None:
            return
        self._count += 1
        self._latest.append(found)
        numbers = np.array([(one.standing, one.lost_motion, one.peak_error) for one in self._latest])
        standing, lost_motion, peak_error = np.median(numbers, axis=0).tolist()
        self.record = ReversalRecord(
            count=self._count, last=found, standing=standing, lost_motion=lost_motion,
            peak_error=peak_error, largest_error=float(numbers[:, 2].max()),
        )  # fmt: skip

    def forget(self) -> None:
        """Forget all that was seen."""
        self._count, self.record = 0, None
        self._latest.clear()
        self.break_off()

    def break_off(self) -> None:
        """What follows has nothing to do with what was before."""
        self._open = self._passing = None
        self._stood.clear()

    def add_rest(self, rest: Rest, samples: SampleBuffer) -> None:
        """Take a rest that is known in full."""
        if rest.direction_before == 0:
            return
        if rest.direction_after == rest.direction_before:
            self._stops += 1
            self._settled = rest.breakaway
            return
        self._close(rest.arrest, samples)
        self._open, self._stops, self._settled = rest, 0, rest.breakaway
        self.due = min(self.due, rest.breakaway + _LONGEST)
        self._stood.append(rest.breakaway)

    def turn(self, time: float, samples: SampleBuffer) -> None:
        """The joint is seen to move the other way at a time [s]; whether it stood before is known by the next one."""
        before = self._passing[1] if self._passing is not None else -math.inf
        self._pass(time, samples)
        self._passing = before, time
        self.due = min(self.due, time + _LONGEST)

    def poll(self, now: float, samples: SampleBuffer) -> None:
        """Measure a reversal that was so long ago that its samples would be forgotten."""
        if self._open is not None and now - self._open.breakaway > _LONGEST:
            self._close(now, samples)
        if self._passing is not None and now - self._passing[1] > _LONGEST:
            self._pass(now, samples)
        opened = [] if self._open is None else [self._open.breakaway]
        opened += [] if self._passing is None else [self._passing[1]]
        self.due = min(opened, default=math.inf) + _LONGEST

    def finish(self, now: float, samples: SampleBuffer) -> None:
        """Measure what is open: no more samples come."""
        self._close(now, samples)
        self._pass(now, samples)

    def _pass(self, end: float, samples: SampleBuffer) -> None:
        """Measure the last turn, if the joint made it without a stop."""
        if self._passing is None:
            return
        (before, time), self._passing = self._passing, None
        if any(before < stood <= time for stood in self._stood):
            return
        seen = samples.between(max(time - _LEAD, before), end)
        self._add(None if seen is None else _passed(time, seen))

    def _close(self, end: float, samples: SampleBuffer) -> None:
        rest, self._open = self._open, None
        if rest is None:
            return
        begin = rest.arrest - _BEFORE * max(rest.dwell, 1.0)
        seen = samples.between(begin, end)
        self._add(None if seen is None else _measured(rest, seen, self._stops, self._settled))


def _measured(rest: Rest, samples: Batch, stops: int, settled: float) -> Reversal | None:
    """The reversal about a rest; None where the reference did not turn there, or has no position."""
    known = np.isfinite(samples.reference_position)
    times, reference = samples.time[known], samples.reference_position[known]
    before = times <= rest.breakaway
    if not before.any():
        return None
    direction = rest.direction_after
    # The last sample at the extreme: a reference that rests there turns where it leaves.
    turn = int(np.flatnonzero(before)[-1] - np.argmin((direction * reference[before])[::-1]))
    lost = float(direction * (reference[before][-1] - reference[turn]))
    after = slice(turn + 1, None)
    if not 0 < turn < len(times) - 1 or lost <= 0.0 or not direction * (reference[turn] - reference[0]) < 0.0:
        return None
    onward = int(np.argmax(direction * reference[after])) + turn + 2
    position = samples.position[known]
    if _jumps(reference[turn:onward]):
        return None
    peak, running = following_error(reference[turn + 1 : onward], position[turn + 1 : onward], direction)
    start = float(times[turn])
    # As long as the reference rests at the turn the joint is to stand.
    rests = int(turn - np.argmax((reference[: turn + 1] != reference[turn])[::-1])) + 1
    paused = max(min(start, rest.breakaway) - max(float(times[rests]), rest.arrest), 0.0)
    return Reversal(
        time=start,
        direction=direction,
        standing=rest.dwell - paused,
        lost_motion=lost,
        peak_error=peak,
        running_error=running,
        stops=stops,
        settles_after=max(settled - start, 0.0),
    )


def _jumps(reference: FloatArray) -> bool:
    """Whether a reference, from a turn on, jumps to where it goes."""
    return bool(np.abs(np.diff(reference)).max() > _LARGEST_STEP * np.ptp(reference))


def _passed(time: float, samples: Batch) -> Reversal | None:
    """A reversal that the joint passed without a stop; None where the reference did not turn there."""
    known = np.isfinite(samples.reference_position)
    times, reference, position = (
        values[known] for values in (samples.time, samples.reference_position, samples.position)
    )
    near = times <= time
    if np.count_nonzero(near) < 2 or near.all():
        return None
    here = int(np.flatnonzero(near)[-1])
    direction = 1 if position[-1] > position[here] else -1
    # The last sample at the extreme: a reference that rests there turns where it leaves.
    turn = int(here - np.argmin((direction * reference[near])[::-1]))
    onward = int(np.argmax(direction * reference[turn + 1 :])) + turn + 2 if turn + 1 < len(reference) else turn
    came, goes = (direction * (reference[other] - reference[turn]) for other in (0, onward - 1))
    if turn == 0 or not came > _LEAST_TURN * goes > 0.0 or _jumps(reference[turn:onward]):
        return None
    peak, running = following_error(reference[turn + 1 : onward], position[turn + 1 : onward], direction)
    # Only what comes after the reference's turn answers it, which may have been a jump.
    behind = direction * position[turn : here + 1]
    turns = turn + int(np.median(np.flatnonzero(behind == behind.min())))  # the middle of a count
    return Reversal(
        time=float(times[turn]),
        direction=direction,
        standing=0.0,
        lost_motion=max(float(direction * (reference[turns] - reference[turn])), 0.0),
        peak_error=peak,
        running_error=running,
        stops=0,
        settles_after=0.0,
    )
