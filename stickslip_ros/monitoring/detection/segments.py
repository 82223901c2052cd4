# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A joint's past as stretches of one status each, from the slices of time that are judged one by one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.monitoring.detection import _judgement_kernel as judgement
from stickslip_ros.monitoring.detection import _motion_kernel as kernel
from stickslip_ros.monitoring.detection.status import NotFollowing, Segment, Status, StopsAndGoes
from stickslip_ros.monitoring.samples import FloatArray

STATUS_OF = {
    judgement.TOO_FEW: Status.NOT_JUDGED,
    judgement.STICKS: Status.STICK_SLIP,
    judgement.AT_REST: Status.AT_REST,
    judgement.STUCK: Status.AT_REST,
    judgement.REVERSING: Status.NOT_JUDGED,
    judgement.TOO_SHORT: Status.NOT_JUDGED,
    judgement.STOPS_AND_GOES: Status.NOT_JUDGED,
    judgement.DIPS: Status.AT_RISK,
    judgement.MOVES: Status.SMOOTH,
    judgement.STEPS_OF_COUNTS: Status.NOT_JUDGED,
    judgement.FEW_COUNTS: Status.NOT_JUDGED,
    judgement.FEW_READINGS: Status.NOT_JUDGED,
    judgement.NOT_FOLLOWING: Status.NOT_JUDGED,
    judgement.BURSTS: Status.NOT_JUDGED,
}
_MENDED = (Status.NOT_JUDGED, Status.AT_REST)


class Segments:
    """See the module.

    Parameters
    ----------
    kept : the latest ones; None for all.

    Attributes
    ----------
    all : oldest first.
    """

    def __init__(self, kept: int | None) -> None:
        self.all: deque[Segment] = deque(maxlen=kept)
        self._from = math.nan  # where the last segment began [rad]
        self._unmeasured = False  # whether it is the first samples, of which nothing is known yet

    def extend(self, rows: FloatArray, codes: NDArray[np.int_]) -> None:
        """Go on with slices of time, one or more, as the compiled path reports them, and what each shows."""
        if len(rows) == 1:
            self._extend(rows, int(codes[0]))
            return
        edges = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist(), len(rows)]
        for begin, end in pairwise(edges):
            self._extend(rows[begin:end], int(codes[begin]))

    def relabel(self, start: float, end: float, stuck: float) -> None:
        """Let a stretch of time be stick-slip after all; since ``stuck`` the joint rested, or slipped."""
        reached = self._from + _way(self.all[-1]) if self.all else math.nan
        later: list[Segment] = []
        while self.all and self.all[-1].end > start:
            later.append(self.all.pop())
        for segment in reversed(later):
            # What is called smooth, or was stick-slip before, was judged by itself. But a joint at rest may creep.
            mended = segment.status in _MENDED or segment.start >= stuck
            status = Status.STICK_SLIP if mended else segment.status
            for begin, until, which in (
                (segment.start, start, segment.status),
                (max(segment.start, start), min(segment.end, end), status),
                (end, segment.end, segment.status),
            ):
                self._append(
                    replace(segment, start=max(begin, segment.start), end=min(until, segment.end), status=which)
                )
        if self.all:
            self._from = reached - _way(self.all[-1])

    def _join_stand(self, begins: float, goes: float) -> None:
        """Let a stand be part of stops and goes, if the motion before it was not judged, and that after it goes on.

        That begins at a place, and goes a way [rad].
        """
        between = len(self.all) > 1 and (self.all[-2].status, self.all[-1].status) == (
            Status.NOT_JUDGED,
            Status.AT_REST,
        )
        if between and _way(self.all[-2]) * goes > 0.0:
            self._append(replace(self.all.pop(), status=Status.NOT_JUDGED))
            self._from = begins - _way(self.all[-1])

    def _append(self, segment: Segment) -> None:
        """Add a stretch, joined with the one before if that is of the same status."""
        if segment.end <= segment.start:
            return
        last = self.all[-1] if self.all else None
        if (
            last is not None
            and last.status is segment.status
            and 0.0 <= segment.start - last.end <= kernel.LONGEST_SILENCE
        ):
            velocity = (_way(last) + _way(segment)) / (segment.end - last.start)
            segment = replace(
                segment, start=self.all.pop().start, velocity=velocity, stuck=last.stuck + segment.stuck,
                travel=last.travel + segment.travel, led=last.led + segment.led,
                caveat=last.caveat or segment.caveat,
            )  # fmt: skip
        self.all.append(segment)

    def _extend(self, rows: FloatArray, code: int) -> None:
        status = STATUS_OF[code]
        start, end = float(rows[0, kernel.BEGIN]), float(rows[-1, kernel.END])
        if code == judgement.STOPS_AND_GOES:
            begins, until = rows[0, [kernel.FROM, kernel.TO]].tolist()
            self._join_stand(begins, until - begins)
        last = self.all[-1] if self.all else None
        # A joint that stands as soon as its samples can be measured stood before: waiting for samples is no motion.
        same = last is not None and (last.status is status or (self._unmeasured and status is Status.AT_REST))
        self._unmeasured = code == judgement.TOO_FEW
        begun = Segment(start=start, end=start, status=status, velocity=0.0)
        if last is not None and same and 0.0 <= start - last.end <= kernel.LONGEST_SILENCE:
            begun = self.all.pop()
        else:
            self._from = float(rows[0, kernel.FROM])
        start, until, stuck, travel, led = begun.start, begun.end, begun.stuck, begun.travel, begun.led
        for end_of_slice, velocity in rows[:, [kernel.END, kernel.VELOCITY]].tolist():
            duration, until = end_of_slice - until, end_of_slice
            led += velocity * duration if math.isfinite(velocity) else 0.0
            if code == judgement.STUCK:
                stuck, travel = stuck + duration, travel + abs(velocity) * duration
        velocity = (float(rows[-1, kernel.TO]) - self._from) / (end - start) if end > start else 0.0
        caveat = begun.caveat
        if code == judgement.STOPS_AND_GOES:
            caveat = StopsAndGoes()
        if code == judgement.NOT_FOLLOWING:
            caveat = NotFollowing(share=float(rows[-1, kernel.NUMBER]))
        self.all.append(
            replace(
                begun, end=end, status=status, velocity=velocity, stuck=stuck, travel=travel, led=led, caveat=caveat
            )
        )


def _way(segment: Segment) -> float:
    return segment.velocity * (segment.end - segment.start)
