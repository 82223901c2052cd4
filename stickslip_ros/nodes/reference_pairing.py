# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples of a joint wait here until the reference at their time is known.

Joint states and references come on two topics, in any order of arrival. Pairing by stamp, not by
arrival, makes the result the same live and recorded.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.monitoring.samples import Batch

_LONGEST_WAIT = 0.2  # [s] of the data's own time: how far samples may run ahead of the reference
_STALE = 1.0  # [s] from when on an old reference says nothing any more

Row = tuple[float, float, float, float]


class ReferencePairing:
    """Joins the samples and the references of one joint."""

    def __init__(self) -> None:
        self._samples: list[Row] = []
        self._references: list[tuple[float, float, float]] = []

    def add_sample(self, time: float, position: float, velocity: float, effort: float) -> None:
        """A row of joint states; NaN for what is missing."""
        self._samples.append((time, position, velocity, effort))

    def add_reference(self, time: float, position: float, velocity: float) -> None:
        """A desired position and velocity; NaN for what is missing."""
        if math.isfinite(time):
            if self._references and time < self._references[-1][0]:
                # Time began anew, or two publishers disagree: what was ahead is void.
                self._references.clear()
            self._references.append((time, position, velocity))

    def take(self) -> Batch | None:
        """The samples whose reference is known, or will not come any more; None if there are none."""
        if not self._samples:
            return None
        ready = len(self._samples)
        if self._references:
            last = self._references[-1][0]
            newest = self._samples[-1][0]
            if newest > last and newest - last < _LONGEST_WAIT:
                ready = next((i for i, row in enumerate(self._samples) if row[0] > last), ready)
        if ready == 0:
            return None
        rows = np.array(self._samples[:ready])
        del self._samples[:ready]
        times = rows[:, 0]
        position, velocity = self._at(times)
        return Batch(
            time=times,
            position=rows[:, 1],
            velocity=rows[:, 2],
            effort=rows[:, 3],
            reference_position=position,
            reference_velocity=velocity,
        )

    def _at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reference position and velocity at these times: interpolated, held after the last, NaN where too old."""
        if not self._references:
            unknown = np.full(len(times), np.nan)
            return unknown, unknown.copy()
        references = np.array(self._references)
        known = references[:, 0]
        position = np.interp(times, known, references[:, 1], left=np.nan)
        velocity = np.interp(times, known, references[:, 2], left=np.nan)
        before = np.searchsorted(known, times, side="right") - 1
        stale = times - known[np.maximum(before, 0)] > _STALE
        position[stale] = np.nan
        velocity[stale] = np.nan
        newest = float(np.nanmax(times)) if np.isfinite(times).any() else math.inf
        used = int(np.searchsorted(known, newest, side="right")) - 1
        del self._references[: max(used, 0)]
        return position, velocity
