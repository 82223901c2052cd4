# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples of a joint wait here until the reference at their time is known.

Joint states and references come on two topics, in any order of arrival. Pairing by stamp, not by
arrival, makes the result the same live and recorded.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.monitoring.samples import LATE_IN_A_ROW, LATEST_STAMP, Batch, FloatArray

_LONGEST_WAIT = 0.2  # time that samples may run ahead of the reference, s: of the data's own time, and on the clock
_STALE = 1.0  # age of a reference, s: an older one says nothing
_NEVER_NEAR = 2.0  # time of samples without any reference near, s: a pause of one of the topics is shorter


class ReferencePairing:
    """Joins the samples and the references of one joint.

    Attributes
    ----------
    too_late : how many references came when the samples of their time had gone on without them [1].
    """

    def __init__(self) -> None:
        self._samples = np.zeros((0, 4))
        self._new_samples: list[FloatArray] = []
        self._references = np.zeros((0, 3))
        self._new_references: list[FloatArray] = []
        self._late_in_a_row = 0
        self._went_on = -math.inf  # when a sample had its reference last, as a steady time [s]
        self._gone_until = -math.inf  # stamp of the last sample that was taken [s]
        self._came = (math.inf, -math.inf)  # earliest and latest stamp of the references since the last batch [s]
        self._offset = math.nan  # of these references from the samples [s], NaN where they are near
        self._near_at = self._compared_at = math.nan  # stamps of samples, when references were near, and came, last [s]
        self.too_late = 0

    @property
    def offset(self) -> float:
        """Stamps of the references that come less those of the samples that come [s], where they are never near, as by
        two clocks: such references are not used. NaN where they are near, or none come.
        """
        return self._offset if self._compared_at - self._near_at > _NEVER_NEAR else math.nan

    def add_samples(self, rows: FloatArray) -> None:
        """Rows of time, position, velocity and effort, NaN for what is missing; of shape (n, 4)."""
        self._new_samples.append(rows)

    def add_references(self, rows: FloatArray) -> None:
        """Rows of time, position and velocity of the reference, NaN for what is missing; of shape (n, 3)."""
        self._new_references.append(rows)

    @property
    def waiting(self) -> int:
        """How many samples wait."""
        return len(self._samples) + sum(len(rows) for rows in self._new_samples)

    def next_batch(self, now: float = math.inf, *, all_of_them: bool = False) -> Batch | None:
        """The samples whose reference is known, or will not come any more; None if there are none.

        ``now`` is a steady time [s]: what is played fast has no less time to arrive.
        """
        self._collect()
        if not len(self._samples):
            return None
        times = self._samples[:, 0]
        ready = len(times)
        if self._came[1] > -math.inf:
            self._compare(float(times[0]), float(times[-1]))
        if len(self._references) and not all_of_them:
            last, newest = self._references[-1, 0], times[-1]
            waits = np.flatnonzero(times > last)
            if len(waits) == 0 or waits[0] > 0:
                self._went_on = now
            if last < newest and (newest < last + _LONGEST_WAIT or now < self._went_on + _LONGEST_WAIT):
                ready = int(waits[0]) if len(waits) else ready
        if ready == 0:
            return None
        rows, self._samples = self._samples[:ready], self._samples[ready:]
        self._gone_until = float(rows[-1, 0])
        columns = np.empty((6, ready))
        columns[:4] = rows.T
        columns[4], columns[5] = self._at(columns[0]) if len(self._references) else (math.nan, math.nan)
        return Batch.of_columns(columns)

    def _compare(self, begin: float, end: float) -> None:
        """Compare the stamps of the references that came with those of the first and the last sample [s]."""
        earliest, latest = self._came
        self._came = (math.inf, -math.inf)
        apart = earliest - end > _STALE or begin - latest > _STALE
        self._offset, self._compared_at = latest - end if apart else math.nan, end
        # Time may begin anew.
        if not apart or not self._near_at <= begin:
            self._near_at = begin if apart else end
        if self.offset > 0.0:
            # Of a clock that is ahead they would become ever more, and meet samples that they have nothing to do with.
            self._references = self._references[-1:]

    def _collect(self) -> None:
        if self._new_samples:
            waiting = [self._samples] if len(self._samples) else []
            parts = [*waiting, *self._new_samples]
            self._samples = parts[0] if len(parts) == 1 else np.concatenate(parts)
            self._new_samples.clear()
        if not self._new_references:
            return
        new = np.concatenate(self._new_references)
        self._new_references.clear()
        new = new[np.abs(new[:, 0]) < LARGEST]
        if len(new):
            self._came = min(self._came[0], float(new[:, 0].min())), max(self._came[1], float(new[:, 0].max()))
        # What is older by more belongs to a clock that was set back.
        self.too_late += int(((new[:, 0] <= self._gone_until) & (new[:, 0] > self._gone_until - LATEST_STAMP)).sum())
        joined = np.concatenate([self._references, new])
        if len(self._references) and len(new):
            late = new[:, 0] < self._references[-1, 0]
            self._late_in_a_row = self._late_in_a_row + len(new) if late.all() else 0
            if self._late_in_a_row > LATE_IN_A_ROW:
                # Not late, but by a clock that was set back a little.
                joined, self._late_in_a_row = new, 0
        steps = np.diff(joined[:, 0])
        if (steps <= 0.0).any():
            # Where time began anew, what was ahead is void; what is a little late finds its place.
            anew = np.flatnonzero(steps < -LATEST_STAMP)
            joined = joined[int(anew[-1]) + 1 if len(anew) else 0 :]
            joined = joined[np.argsort(joined[:, 0], kind="stable")]
            joined = joined[np.append(np.diff(joined[:, 0]) > 0.0, True)]
        self._references = joined

    def _at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Reference position and velocity at these times, some references being known.

        Between two references that follow each other closely they are interpolated, else the earlier one holds until it
        is too old: which does not depend on whether the later one is known yet.
        """
        known = self._references[:, 0]
        first = int(np.searchsorted(known, times[0]))
        if np.array_equal(known[first : first + len(times)], times):
            # Published together, as is usual: every sample has a reference of its own stamp.
            taken = self._references[first : first + len(times)]
            self._references = self._references[first + len(times) - 1 :]
            return taken[:, 1], taken[:, 2]
        before = np.searchsorted(known, times, side="right") - 1
        at = np.maximum(before, 0)
        after = np.minimum(at + 1, len(known) - 1)
        gap = known[after] - known[at]
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where((gap > 0.0) & (gap <= _LONGEST_WAIT), (times - known[at]) / gap, 0.0)[:, None]
            values = self._references[at, 1:]
            # Where the share is zero the later one, which may be unknown, does not count.
            values = np.where(share == 0.0, values, values + share * (self._references[after, 1:] - values))
        values[(before < 0) | (times - known[at] > _STALE) | ~np.isfinite(times)] = np.nan
        finite = times[np.isfinite(times)]
        if len(finite):
            used = int(np.searchsorted(known, np.max(finite), side="right")) - 1
            self._references = self._references[max(used, 0) :]
        return values[:, 0], values[:, 1]
