# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Batches of samples of one joint, and the sorting out of those that cannot be used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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


_OUT_OF_ORDER = 1.0  # [s] a stamp may be late by that much before it means that time began anew
_BACKWARD_IN_A_ROW = 20
LARGEST = 1e12  # no joint's position and no clock's time; the arithmetic stays exact enough below it


@dataclass
class SampleFilter:
    """Keeps samples in strict order of time, with finite time and position, and counts what it drops.

    ``dropped`` maps a reason to how often it occurred; ``restarts`` counts how often time began anew.
    """

    last_time: float = -np.inf
    dropped: dict[str, int] = field(default_factory=dict)
    restarts: int = 0
    _backward: int = 0

    def pass_on(self, batch: Batch) -> None:
        """Take note of samples that simply go on."""
        self.last_time, self._backward = float(batch.time[-1]), 0

    def split(self, batch: Batch) -> list[tuple[bool, Batch]]:
        """The usable samples, in pieces; a piece marked True begins a new recording."""
        # Comparisons with NaN are false, so that it is left out too.
        finite_time = np.abs(batch.time) < LARGEST
        finite = finite_time & (np.abs(batch.position) < LARGEST)
        self._count("time is not finite", int((~finite_time).sum()))
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
                if self.last_time - time <= _OUT_OF_ORDER and self._backward <= _BACKWARD_IN_A_ROW:
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
