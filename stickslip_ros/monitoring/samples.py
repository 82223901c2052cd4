# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples of one joint: batches, the reference beside each, the sorting out of useless ones, and the latest ones.

The latest samples are in blocks that are used again: few objects, and a bound on their memory. Where they become too
many, samples of long rests are thinned out first: of a joint that stands still one sample tells as much as two. Then
those of the older half are, and in the end the oldest are forgotten. What is kept depends on the samples alone, not on
how they were batched.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import LARGEST, LEAST_EFFORT_CHANGE, SMALLEST
from stickslip_ros.monitoring.detection._motion_kernel import scan_bounds, store

FloatArray = NDArray[np.float64]
_BOUNDED = ("velocity", "effort", "reference_position", "reference_velocity")
ROUNDING_STD = 1.0 / math.sqrt(12.0)  # standard deviation of what rounding to a resolution leaves, resolutions
LATEST_STAMP = 1.0  # delay of a stamp behind the last one, s: with more, time began anew
LATE_IN_A_ROW = 20  # late stamps in a row, 1: with more, the clock was set back a little
MOST_BYTES = 450_000  # memory for the samples of one joint, bytes
_ROWS = 512  # samples of a block, 1
_HALF = _ROWS // 2
_THINNEST = 16  # ratio of samples to those kept of a motion, 1: at most
_AT_REST = 0.02  # way in a block, of the longest: with less the joint stands
_LONGEST_WAIT = 0.2  # time that samples may run ahead of the reference, s: of the data's own time, and on the clock
_STALE = 1.0  # age of a reference, s: an older one says nothing
_NEVER_NEAR = 2.0  # time of samples without any reference near, s: a pause of one of the topics is shorter


def _missing() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class Batch:
    """Samples of one joint in the order of their arrival; what is missing is NaN.

    Attributes
    ----------
    time : [s]; position : [rad].
    velocity : [rad/s]; effort : [N·m]; reference_position : [rad]; reference_velocity : [rad/s].
        All of shape (n,); those that are left out or empty become NaN.

    Raises
    ------
    ValueError
        If the shapes differ or are not one-dimensional.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray = field(default_factory=_missing)
    effort: FloatArray = field(default_factory=_missing)
    reference_position: FloatArray = field(default_factory=_missing)
    reference_velocity: FloatArray = field(default_factory=_missing)

    def __post_init__(self) -> None:
        time = np.ascontiguousarray(self.time, dtype=float)
        for name in self.__dataclass_fields__:
            array = np.ascontiguousarray(getattr(self, name), dtype=float)
            if array.size == 0 and name not in ("time", "position"):
                array = np.full(time.shape, np.nan)
            if array.shape != time.shape or time.ndim != 1:
                raise ValueError(f"{name} has shape {array.shape} but time has {time.shape}; both must be (n,)")
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of_columns(cls, columns: FloatArray) -> Batch:
        """Of a contiguous array of shape (6, n), the attributes in their order; what is missing is NaN there."""
        batch = object.__new__(cls)
        # Nothing of it needs a check, which takes longer than a few samples are worth.
        batch.__dict__.update(zip(cls.__dataclass_fields__, columns, strict=True))
        return batch

    @staticmethod
    def joined(parts: Sequence[Batch]) -> Batch:
        """Batches one after the other, at least one."""
        return Batch(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in Batch.__dataclass_fields__}
        )

    def where(self, mask: NDArray[np.bool_] | slice) -> Batch:
        """The samples that the mask keeps."""
        return Batch(**{name: getattr(self, name)[mask] for name in self.__dataclass_fields__})

    def usable(self) -> Batch:
        """The samples whose time and position can be, without their values that cannot."""
        # Comparisons with NaN are false.
        return self.bounded()[0].where((np.abs(self.time) < LARGEST) & (np.abs(self.position) < LARGEST))

    def bounded(self) -> tuple[Batch, dict[str, int]]:
        """The same with NaN in place of values that cannot be; and how many there were, by reason.

        Samples whose time or position cannot be are left out as a whole, by :class:`SampleFilter`.
        """
        values = {name: getattr(self, name) for name in _BOUNDED}
        size = np.abs(self.effort)
        wrong = {(name, f"infinite or larger than {LARGEST:g}"): np.abs(values[name]) >= LARGEST for name in _BOUNDED}
        wrong["effort", f"denormal (below {SMALLEST:.2g}), as memory that nobody wrote is"] = (size > 0.0) & (
            size < SMALLEST
        )
        counts = {}
        for (name, why), mask in wrong.items():
            if mask.any():
                values[name] = np.where(mask, math.nan, values[name])
                counts[f"{name.replace('_', ' ')} is {why}"] = int(mask.sum())
        return replace(self, **values), counts


def effort_is_measured(effort: FloatArray) -> bool:
    """Whether efforts are all known, and change: a constant is none that moved anything."""
    return bool(np.isfinite(effort).all()) and len(effort) > 0 and float(np.ptp(effort)) >= LEAST_EFFORT_CHANGE


@dataclass
class SampleFilter:
    """Keeps samples in strict order of time, with finite time and position, and counts what it drops.

    ``dropped`` maps a reason to how many samples were left out for it, ``blanked`` to how many values of samples that
    were kept; ``restarts`` counts how often time began anew.
    """

    last_time: float = -np.inf
    dropped: dict[str, int] = field(default_factory=dict)
    blanked: dict[str, int] = field(default_factory=dict)
    restarts: int = 0
    _backward: int = 0
    # Whether any reference position and any reference velocity came; lowest and highest effort and position.
    _referred: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(2, dtype=np.bool_))
    _extremes: FloatArray = field(default_factory=lambda: np.array([[np.inf, -np.inf], [np.inf, -np.inf]]))

    def blank(self, batch: Batch) -> Batch:
        """The samples without values that cannot be, which are counted; to be called once for each."""
        if scan_bounds(
            self._extremes, self._referred, LARGEST, SMALLEST, batch.position, batch.velocity, batch.effort,
            batch.reference_position, batch.reference_velocity,
        ):  # fmt: skip
            return batch
        batch, counts = batch.bounded()
        for reason, number in counts.items():
            self.blanked[reason] = self.blanked.get(reason, 0) + number
        return batch

    @property
    def constant_effort(self) -> float:
        """The one effort that there was while the joint moved [N·m]: no measured one; else NaN."""
        (least, most), (low, high) = self._extremes.tolist()
        return float(least) if 0.0 <= most - least < LEAST_EFFORT_CHANGE and low < high else math.nan

    def pass_on(self, batch: Batch) -> None:
        """Take note of samples that simply go on."""
        self.last_time, self._backward = float(batch.time[-1]), 0

    @property
    def velocity_alone(self) -> bool:
        """Whether the references that came have velocities and no positions."""
        return bool(self._referred[1] and not self._referred[0])

    def split(self, batch: Batch) -> list[tuple[bool, Batch]]:
        """The usable samples, in pieces; a piece marked True begins a new recording."""
        # Comparisons with NaN are false, so that it is left out too.
        finite_time = np.abs(batch.time) < LARGEST
        finite = finite_time & (np.abs(batch.position) < LARGEST)
        self._count(f"time is missing, infinite or larger than {LARGEST:g}", int((~finite_time).sum()))
        unknown = finite_time & np.isnan(batch.position)
        self._count("position is missing or not a number", int(unknown.sum()))
        self._count(f"position is infinite or larger than {LARGEST:g}", int((finite_time & ~finite & ~unknown).sum()))
        if not finite.all():
            batch = batch.where(finite)
        if len(batch) == 0:
            return []
        if batch.time[0] > self.last_time and np.all(np.diff(batch.time) > 0):
            self.last_time = float(batch.time[-1])
            self._backward = 0
            return [(False, batch)]
        keep, begins = self._sort_out(batch.time)
        edges = [0, *begins, len(batch)]
        pieces = []
        for number, (begin, end) in enumerate(pairwise(edges)):
            piece = batch.where(slice(begin, end)).where(keep[begin:end])
            if len(piece):
                pieces.append((number > 0, piece))
        return pieces

    def _sort_out(self, times: FloatArray) -> tuple[NDArray[np.bool_], list[int]]:
        """Which samples to keep, and at which of them time began anew."""
        keep = np.zeros(len(times), dtype=bool)
        begins = []
        for index, time in enumerate(times.tolist()):
            if time == self.last_time:
                self._count("stamp stands still", 1)
                continue
            if time < self.last_time:
                self._backward += 1
                if self.last_time - time <= LATEST_STAMP and self._backward <= LATE_IN_A_ROW:
                    self._count("stamp goes backwards", 1)
                    continue
                begins.append(index)
                self.restarts += 1
            keep[index] = True
            self._backward = 0
            self.last_time = time
        return keep, begins

    def _count(self, reason: str, number: int) -> None:
        if number:
            self.dropped[reason] = self.dropped.get(reason, 0) + number


_FIELDS = tuple(Batch.__dataclass_fields__)  # the first is the time, the second the position


class _Block:
    """Some hundred samples; a column that has only NaN is not written, and takes no memory.

    Attributes
    ----------
    every : so many samples there were for each that is here.
    way : of a block that is full, from its lowest to its highest position [rad]; size : its memory [bytes].
    """

    def __init__(self) -> None:
        self.columns = np.zeros((len(_FIELDS), _ROWS))
        self.known = np.zeros(len(_FIELDS), dtype=np.bool_)
        self.clear()

    def clear(self) -> None:
        """Begin anew with other samples."""
        self.known[:] = False
        self.count, self.every, self.way, self.size = 0, 1, 0.0, 0

    def finish(self) -> None:
        """It is full."""
        self.way = float(self.columns[1].max() - self.columns[1].min())
        self.size = 8 * _ROWS * int(np.count_nonzero(self.known))

    def first(self) -> float:
        """Time of the first sample [s]."""
        return float(self.columns[0, 0])

    def last(self) -> float:
        """Time of the last sample [s]."""
        return float(self.columns[0, self.count - 1])


class SampleBuffer:
    """The latest samples, bounded in time and memory.

    Parameters
    ----------
    longest : kept [s]. most_bytes : of memory.
    """

    def __init__(self, longest: float = 58.0, most_bytes: int = MOST_BYTES) -> None:
        self._longest, self._most_bytes = longest, most_bytes
        self._blocks: deque[_Block] = deque()
        self._spare: list[_Block] = []
        self._size = 0

    def add(self, batch: Batch) -> None:
        """Keep samples that follow those kept."""
        begin = 0
        while begin < len(batch):
            if not self._blocks or self._blocks[-1].count == _ROWS:
                self._begin_block()
            block = self._blocks[-1]
            taken = min(len(batch) - begin, _ROWS - block.count)
            store(
                block.columns, block.known, block.count, begin, taken,
                batch.time, batch.position, batch.velocity, batch.effort,
                batch.reference_position, batch.reference_velocity,
            )  # fmt: skip
            block.count += taken
            begin += taken

    @property
    def size(self) -> int:
        """Memory that the samples take, but those of the last block [bytes]."""
        return self._size

    def _begin_block(self) -> None:
        if self._blocks:
            self._blocks[-1].finish()
            self._size += self._blocks[-1].size
            now = self._blocks[-1].last()
            while len(self._blocks) > 1 and self._blocks[1].first() < now - self._longest:
                self._forget_the_oldest()
            # The block to come will be like the last one.
            while len(self._blocks) > 1 and self._size + self._blocks[-1].size > self._most_bytes:
                self._make_room()
        self._blocks.append(self._new())

    def _new(self) -> _Block:
        return self._spare.pop() if self._spare else _Block()

    def _make_room(self) -> None:
        begin = self._to_join()
        if begin is None:
            self._forget_the_oldest()
            return
        first, second = self._blocks[begin], self._blocks[begin + 1]
        joined = self._new()
        # Every second sample of theirs.
        joined.columns[:, :_HALF], joined.columns[:, _HALF:] = first.columns[:, ::2], second.columns[:, ::2]
        if not np.array_equal(first.known, second.known):
            joined.columns[~first.known, :_HALF], joined.columns[~second.known, _HALF:] = np.nan, np.nan
        np.logical_or(first.known, second.known, out=joined.known)
        joined.count, joined.every = _ROWS, 2 * first.every
        joined.finish()
        self._size += joined.size - first.size - second.size
        self._give_back(first)
        self._give_back(second)
        self._blocks[begin] = joined
        del self._blocks[begin + 1]

    def _to_join(self) -> int | None:
        """Where two blocks begin that are to become one: of rests if there are such, else old ones; None for none."""
        blocks = list(self._blocks)
        least = _AT_REST * max(block.way for block in blocks)
        stands = [block.way <= least for block in blocks]
        # A slip begins gently, in a block that seems one of the rest before.
        inside = [
            here and before and after
            for here, before, after in zip(stands, [True, *stands[:-1]], [*stands[1:], False], strict=True)
        ]
        older = [at < len(blocks) // 2 and block.every < _THINNEST for at, block in enumerate(blocks)]
        for eligible in (inside, older):
            for at in range(len(blocks) - 1):
                if eligible[at] and eligible[at + 1] and blocks[at].every == blocks[at + 1].every:
                    return at
        return None

    def _forget_the_oldest(self) -> None:
        oldest = self._blocks.popleft()
        self._size -= oldest.size
        self._give_back(oldest)

    def _give_back(self, block: _Block) -> None:
        block.clear()
        self._spare.append(block)

    def between(self, begin: float, end: float) -> Batch | None:
        """Samples from one time to another, and the one before; None if there are none."""
        blocks = [block for block in self._blocks if block.count and block.last() >= begin and block.first() <= end]
        if not blocks:
            return None
        joined = Batch(**{name: _column(blocks, number) for number, name in enumerate(_FIELDS)})
        first, last = np.searchsorted(joined.time, [begin, end], side="right")
        return joined.where(slice(max(int(first) - 1, 0), int(last))) if last > first else None


def _column(blocks: list[_Block], number: int) -> FloatArray:
    parts = [
        block.columns[number, : block.count] if block.known[number] else np.full(block.count, np.nan)
        for block in blocks
    ]
    return np.concatenate(parts)


class ReferencePairing:
    """Joins the samples and the references of one joint: samples wait until the reference at their time is known.

    Joint states and references come on two topics, in any order of arrival. Pairing by stamp, not by arrival, makes the
    result the same live and recorded.

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

    def add_samples(self, rows: FloatArray, effort_scale: float = 1.0) -> None:
        """Add rows of time, position, velocity and effort, NaN for what is missing, shape (n, 4); they are not changed.

        Parameters
        ----------
        effort_scale : N·m in one unit of the effort.
        """
        if effort_scale != 1.0:
            # What is too large for a number is infinite, and is left out as such.
            with np.errstate(over="ignore"):
                rows = np.asarray(rows * (1.0, 1.0, 1.0, effort_scale))
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
