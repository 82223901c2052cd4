# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Batches of samples of one joint, and the sorting out of those that cannot be used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import LARGEST, LEAST_EFFORT_CHANGE, SMALLEST
from stickslip_ros.monitoring._samples_kernel import scan_bounds

FloatArray = NDArray[np.float64]


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


_BOUNDED = ("velocity", "effort", "reference_position", "reference_velocity")


def effort_is_measured(effort: FloatArray) -> bool:
    """Whether efforts are all known, and change: a constant is none that moved anything."""
    return bool(np.isfinite(effort).all()) and len(effort) > 0 and float(np.ptp(effort)) >= LEAST_EFFORT_CHANGE


ROUNDING_STD = 1.0 / math.sqrt(12.0)  # standard deviation of what rounding to a resolution leaves, resolutions
LATEST_STAMP = 1.0  # delay of a stamp behind the last one, s: with more, time began anew
LATE_IN_A_ROW = 20  # late stamps in a row, 1: with more, the clock was set back a little


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
