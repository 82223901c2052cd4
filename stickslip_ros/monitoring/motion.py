# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The recent past of a joint and its reference: speeds, travel, turns."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from stickslip_ros.monitoring.rests import RestDetector
from stickslip_ros.monitoring.samples import Batch, FloatArray

_KEPT = 20_000  # of the entries below, one a slice of samples


class MotionRecord:
    """What the judgement needs to remember of the samples, one entry a slice of them."""

    def __init__(self) -> None:
        self.first_time = math.nan
        self.last_time = -math.inf
        self.sample_interval = math.nan
        self.turned = -math.inf
        self.last_way = 0.0
        self._direction = 0
        self.position = math.nan
        self._travel = 0.0
        self._reference = math.nan
        self._reference_velocity = math.nan
        self._past_reference = math.nan
        # (time, position, reference position, way of the reference)
        self._past: deque[tuple[float, float, float, float]] = deque(maxlen=_KEPT)
        # (time, largest tracking error, error of the mean velocity)
        self._errors: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def take(self, batch: Batch) -> FloatArray:
        """Remember a slice of samples; returns the way that the reference has gone at each of them [rad], or NaN."""
        steps = np.diff(batch.time, prepend=self.last_time if math.isfinite(self.last_time) else batch.time[0])
        known = steps[steps > 0]
        if len(known):
            interval = float(np.median(known))
            old = self.sample_interval
            self.sample_interval = interval if math.isnan(old) else old + 0.1 * (interval - old)
        if math.isnan(self.first_time):
            self.first_time = float(batch.time[0])
            self.position = float(batch.position[0])
        travels = self._reference_way(batch, steps)
        self.last_way = float(batch.position[-1]) - self.position
        self._note_errors(batch, self.last_way)
        self.position = float(batch.position[-1])
        self.last_time = float(batch.time[-1])
        self._past.append(
            (self.last_time, self.position, self._reference, self._travel if self._has_reference else math.nan)
        )
        return travels

    def _note_errors(self, batch: Batch, way: float) -> None:
        errors = np.abs(batch.reference_position - batch.position)
        known = np.isfinite(errors)
        error = float(np.max(errors[known])) if known.any() else math.nan
        duration = float(batch.time[-1]) - self.last_time
        velocity_error = math.nan
        if 0.0 < duration < math.inf:
            desired = batch.reference_velocity[-1]
            if not math.isfinite(desired) and known.all():
                desired = (batch.reference_position[-1] - self._past_reference) / duration
            velocity_error = abs(float(desired) - way / duration)
        self._past_reference = float(batch.reference_position[-1])
        self._errors.append((float(batch.time[-1]), error, velocity_error))

    def errors(self, window: float) -> tuple[float, float]:
        """Largest tracking error [rad] and velocity error [rad/s] of the last ``window`` seconds; NaN if unknown."""
        recent = []
        for time, error, velocity_error in reversed(self._errors):
            if time < self.last_time - window:
                break
            recent.append((error, velocity_error))
        columns = list(zip(*recent, strict=True)) or [(), ()]
        known = [[value for value in column if math.isfinite(value)] for column in columns]
        return max(known[0], default=math.nan), max(known[1], default=math.nan)

    @property
    def _has_reference(self) -> bool:
        return not (math.isnan(self._reference) and math.isnan(self._reference_velocity))

    def _reference_way(self, batch: Batch, steps: FloatArray) -> FloatArray:
        """Way of the reference: from its position if given, else from its velocity."""
        with_position = np.isfinite(batch.reference_position)
        if with_position.all():
            moves = np.abs(np.diff(batch.reference_position, prepend=self._reference))
            moves[~np.isfinite(moves)] = 0.0
        elif np.isfinite(batch.reference_velocity).all():
            moves = np.abs(batch.reference_velocity) * steps
        else:
            self._reference = self._reference_velocity = math.nan
            return np.full(len(batch), np.nan)
        self._reference = float(batch.reference_position[-1])
        self._reference_velocity = float(batch.reference_velocity[-1])
        travels = self._travel + np.cumsum(moves)
        self._travel = float(travels[-1])
        return travels

    def follow_direction(self, detector: RestDetector) -> None:
        """Note when the motion turned."""
        direction = detector.direction
        if direction and direction != self._direction:
            if self._direction:
                self.turned = detector.last_knot_time
            self._direction = direction

    def _since(self, time: float) -> tuple[float, float, float, float] | None:
        """The latest entry not after ``time``, or the oldest one."""
        found = None
        for entry in reversed(self._past):
            found = entry
            if entry[0] <= time:
                break
        return found

    def reference_travel_since(self, time: float) -> float:
        """Way of the reference since a time [rad]; 0 if unknown."""
        entry = self._since(time)
        travel = self._travel - entry[3] if entry else math.nan
        return travel if math.isfinite(travel) else 0.0

    def reference_velocity(self, window: float) -> float:
        """Desired velocity now [rad/s]: as given, else over the last ``window`` seconds; NaN if unknown."""
        if math.isfinite(self._reference_velocity):
            return self._reference_velocity
        entry = self._since(self.last_time - window)
        if entry is None or not self.last_time > entry[0]:
            return math.nan
        return (self._reference - entry[2]) / (self.last_time - entry[0])

    def mean_velocity(self, window: float) -> float:
        """Mean velocity of the joint over the last ``window`` seconds [rad/s]; NaN if unknown."""
        entry = self._since(self.last_time - window)
        if entry is None or not self.last_time > entry[0]:
            return math.nan
        return (self.position - entry[1]) / (self.last_time - entry[0])
