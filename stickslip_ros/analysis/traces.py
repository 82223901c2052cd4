# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is kept of a recording for drawing: little, however long it is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.sliding import sliding_points
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, FloatArray

_BUCKETS = 2000  # of an outline, up to twice as many while it is made
_CYCLES_KEPT = 5
_CYCLES_SHOWN, _AFTER = 3.0, 1.0  # periods before and after the end of the one that is drawn
_MOST_SAMPLES = 3000  # of a close-up
_MOST_POINTS = 4000  # of speed and friction
_POINTS_FROM = 20.0  # [s] of samples that are looked at at once for them


class Outline:
    """A curve over time by its lowest and highest values in equal steps of time, which grow with its length."""

    def __init__(self) -> None:
        self._step = 0.01  # [s]
        self._begin = math.nan
        self._low = np.zeros(0)
        self._high = np.zeros(0)

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Continue the curve; stamps before its beginning and unknown values are left out."""
        if math.isnan(self._begin) and len(time):
            self._begin = float(time[0])
        known = np.isfinite(value) & (time >= self._begin)
        time, value = time[known], value[known]
        if not len(time):
            return
        while (time.max() - self._begin) / self._step >= 2 * _BUCKETS:
            self._coarsen()
        buckets = ((time - self._begin) / self._step).astype(int)
        missing = int(buckets.max()) + 1 - len(self._low)
        if missing > 0:
            self._low = np.append(self._low, np.full(missing, np.inf))
            self._high = np.append(self._high, np.full(missing, -np.inf))
        np.minimum.at(self._low, buckets, value)
        np.maximum.at(self._high, buckets, value)

    def _coarsen(self) -> None:
        self._step *= 2.0
        odd = len(self._low) % 2
        low = np.append(self._low, np.full(odd, np.inf))
        high = np.append(self._high, np.full(odd, -np.inf))
        self._low, self._high = low.reshape(-1, 2).min(axis=1), high.reshape(-1, 2).max(axis=1)

    def points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Middle of each step [s], lowest and highest value there; NaN between steps where there was nothing."""
        time = self._begin + self._step * (0.5 + np.arange(len(self._low)))
        empty = ~np.isfinite(self._low)
        # Steps as short as the samples are apart leave gaps that mean nothing; long ones are silences.
        kept = ~empty | np.append(False, ~empty[:-1])
        low, high = np.where(empty, np.nan, self._low)[kept], np.where(empty, np.nan, self._high)[kept]
        time = time[kept]
        wide = np.diff(time, append=math.inf) > 2.0
        bridged = np.isnan(low) & ~wide
        return time[~bridged], low[~bridged], high[~bridged]


@dataclass(frozen=True)
class CloseUp:
    """One cycle with the samples around it, as they were recorded."""

    cycle: Cycle
    samples: Batch


class JointTraces:
    """Position, reference and their difference in outline, a few cycles in full, friction over speed."""

    def __init__(self) -> None:
        self.position = Outline()
        self.reference = Outline()
        self.error = Outline()
        self._close_ups: deque[CloseUp] = deque(maxlen=_CYCLES_KEPT)
        self._distances: list[float] = []
        self._points: list[FloatArray] = []
        self._waiting: list[Batch] = []

    def add(self, batch: Batch | None, cycles: Sequence[Cycle], monitor: JointMonitor) -> None:
        """Take usable samples, and the cycles that the monitor found in them."""
        if batch is not None:
            self.position.add(batch.time, batch.position)
            self.reference.add(batch.time, batch.reference_position)
            self.error.add(batch.time, batch.position - batch.reference_position)
            self._note_friction(batch, monitor.resolution)
        for cycle in cycles:
            self._distances.append(abs(cycle.slip_distance))
            samples = monitor.recent(monitor.last_time - cycle.arrest + _CYCLES_SHOWN * cycle.period)
            if samples is not None:
                # More than the cycle may have come at once.
                samples = samples.where(samples.time <= cycle.arrest + _AFTER * cycle.period)
            if samples is not None and len(samples) and samples.time[0] <= cycle.breakaway:
                every = max(1, math.ceil(len(samples) / _MOST_SAMPLES))
                self._close_ups.append(CloseUp(cycle, samples.where(slice(None, None, every))))

    def _note_friction(self, batch: Batch, resolution: float) -> None:
        if not np.isfinite(batch.effort).any():
            return
        self._waiting.append(batch)
        if self._waiting[-1].time[-1] - self._waiting[0].time[0] >= _POINTS_FROM:
            joined, self._waiting = Batch.joined(self._waiting), []
            points = sliding_points(joined, resolution)
            if points is not None:
                self._points.append(points)
                while len(self._points) > 1 and sum(part.shape[1] for part in self._points) > _MOST_POINTS:
                    # Every other point of all, so that the whole recording has its share.
                    self._points = [part[:, ::2] for part in self._points]

    def friction_points(self, resolution: float, inertia: float) -> tuple[FloatArray, FloatArray]:
        """Velocities [rad/s] and efforts less what accelerates an inertia [N·m], in stretches of sliding."""
        points = list(self._points)
        if self._waiting:
            last = sliding_points(Batch.joined(self._waiting), resolution)
            points += [last] if last is not None else []
        if not points:
            return np.zeros(0), np.zeros(0)
        velocity, effort, acceleration = np.concatenate(points, axis=1)
        return velocity, effort - inertia * acceleration

    def close_up(self) -> CloseUp | None:
        """Of the cycles kept, the one whose slip is the most usual."""
        if not self._close_ups:
            return None
        usual = float(np.median(self._distances))
        return min(self._close_ups, key=lambda one: abs(math.log(abs(one.cycle.slip_distance) / usual)))
