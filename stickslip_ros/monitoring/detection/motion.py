# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The recent past of a joint and its reference, and what it shows: speeds, travel, turns."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.monitoring.detection import _motion_kernel as kernel
from stickslip_ros.monitoring.samples import FloatArray


class MotionRecord:
    """What the judgement needs to remember of the samples, one entry a slice of them; filled by the rest detector.

    Attributes
    ----------
    window : over which velocities are taken where none is given [s].
    """

    def __init__(self, window: float = 1.0) -> None:
        self.window = window
        self.state = np.zeros(kernel.STATE_SIZE)
        self.state[[kernel.NOW, kernel.TURNED, kernel.RESTED_AT, kernel.LAST_END]] = -np.inf
        self.state[
            [
                kernel.FIRST_TIME,
                kernel.POSITION,
                kernel.REFERENCE,
                kernel.REFERENCE_VELOCITY,
                kernel.INTERVAL,
                kernel.SLICE,
                kernel.LAST_REFERENCE,
                kernel.LAST_BREAKAWAY,
                kernel.LOOKED,
            ]
        ] = np.nan
        self.past = np.zeros((kernel.PAST, kernel.PAST_COLUMNS))
        self.steps = np.zeros(kernel.STEPS)
        self.slices = np.zeros((1, kernel.SLICE_COLUMNS))

    def make_room(self, count: int) -> None:
        """Let so many slices be closed before they are taken."""
        waiting = self.closed()
        self.slices = np.zeros((len(waiting) + count, kernel.SLICE_COLUMNS))
        self.slices[: len(waiting)] = waiting
        self.state[kernel.CLOSED] = len(waiting)

    def closed(self) -> FloatArray:
        """Take the slices closed since the last time, in the columns of the kernel."""
        rows: FloatArray = self.slices[: int(self.state[kernel.CLOSED])].copy()
        self.state[kernel.CLOSED] = 0.0
        return rows

    @property
    def last_time(self) -> float:
        """Stamp of the last sample [s]; -inf before any."""
        return float(self.state[kernel.NOW])

    @property
    def position(self) -> float:
        """At the last sample [rad]."""
        return float(self.state[kernel.POSITION])

    @property
    def sample_interval(self) -> float:
        """Usual time between samples [s]; NaN if unknown."""
        return float(self.state[kernel.INTERVAL])

    def errors(self, window: float) -> tuple[float, float]:
        """Largest tracking error [rad] and velocity error [rad/s] of the last ``window`` seconds; NaN if unknown."""
        if not self.state[kernel.FIRST_TIME] <= self.last_time:
            return math.nan, math.nan
        tracking, velocity = kernel.errors(self.last_time - window, self.state, self.past)
        return float(tracking), float(velocity)

    def reference_velocity(self) -> float:
        """Desired velocity now [rad/s]: as given, else over the window; NaN if unknown."""
        return float(kernel.reference_velocity(self.window, self.state, self.past))

    def mean_velocity(self, window: float) -> float:
        """Mean velocity of the joint over the last ``window`` seconds [rad/s]; NaN if unknown."""
        return float(kernel.mean_velocity(window, self.state, self.past))
