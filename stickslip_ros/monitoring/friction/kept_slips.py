# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The slips that a study is made of: those that together tell most, whatever their age.

A slip tells of friction at its speed, after its dwell, in its direction, with its gains, where it happened. Slips that
agree in all of these repeat each other; the one that follows the only long rest of an hour does not. How much some
slips tell together is the logarithm of a determinant, that of their information, with the covariance of what two slips
tell falling with the distance between their circumstances (Shewry and Wynn, "Maximum entropy sampling", Journal of
Applied Statistics 14, 1987).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.slip_data import follows_on
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

MOST_SLIPS = 48  # slips that a study has, 1; once so many came, slips like the last one are learnt from now and then
_RUN = 4  # slips in a row that are kept or dropped together: Eq. (6) ties each to the one before
# Circumstances so far apart tell different things. Of speeds, dwells and gains the logarithms.
_SPEED, _DWELL, _GAIN = 0.25, 0.25, 0.2
_OTHER_DIRECTION = 2.0  # coordinate of a slip's direction, 1: opposite ones are twice as far apart
_PLACES, _TIMES = 4.0, 1.5  # of the positions and of the times that the slips extend over, so many are distinguished
_OTHER_PLACES = 8.0  # parts of the slips' range: a slip that is a part away from all others is at a new position
_FEW_WAYS = 8.0  # range of positions, slips one after the other: in a narrower one no position is another
_OWN = 0.5  # variance of a slip's own noise, so that a second slip like it adds information


class KeptSlips:
    """A bounded number of slips, in order of time."""

    def __init__(self, windows: Iterable[SlipWindow] = ()) -> None:
        self._runs: list[list[SlipWindow]] = []
        for window in windows:
            self.add(window)

    def __len__(self) -> int:
        return sum(len(run) for run in self._runs)

    @property
    def windows(self) -> list[SlipWindow]:
        """The slips, oldest first."""
        return [window for run in self._runs for window in run]

    def add(self, window: SlipWindow) -> None:
        """Keep a slip, which is later than all others; the least informative run makes room."""
        last = self._runs[-1] if self._runs else []
        if last and len(last) < _RUN and follows_on(last[-1], window):
            last.append(window)
        else:
            self._runs.append([window])
        if len(self) > MOST_SLIPS:
            del self._runs[self._least_informative()]

    def is_at_new_position(self, cycle: Cycle) -> bool:
        """Whether a slip began where no slip that is kept began in its direction, nor nearly.

        False for motion one way: changes with position and with time are not distinguished there.
        """
        windows = self.windows
        places = [one.rest_position for one in windows if one.direction * cycle.slip_distance > 0.0]
        if len(places) in (0, len(windows)):
            return not places and bool(windows)
        near = max(max(places) - min(places), _FEW_WAYS * abs(cycle.slip_distance)) / _OTHER_PLACES
        return min(abs(cycle.position - place) for place in places) > near

    def _least_informative(self) -> int:
        """Index of the run with the least information beside the others, by slip; the latest, incomplete run stays."""
        runs = self._runs
        count = len(self)
        inverse = np.linalg.inv(_OWN * np.eye(count) + _likeness(self.windows))
        edges = np.cumsum([0, *(len(run) for run in runs)])
        # What a run tells beside the others is the logarithm of the determinant of its block of the inverse.
        information = [
            -np.linalg.slogdet(inverse[first:last, first:last])[1] / (last - first) for first, last in pairwise(edges)
        ]
        return int(np.argmin(information[:-1]))


def _likeness(windows: list[SlipWindow]) -> FloatArray:
    """How far slips repeat each other, from their circumstances: 1 if wholly, 0 if not at all; shape (n, n)."""
    gains = [window.gains for window in windows]
    stiffness = np.array([float(one.stiffness) if one else 0.0 for one in gains])
    damping = np.array([float(one.damping) if one else 0.0 for one in gains])
    places = np.array([window.rest_position for window in windows])
    times = np.array([window.breakaway for window in windows])
    dwells = np.array([window.breakaway - window.rest_begin for window in windows])
    ways = np.array([abs(window.slip_distance) for window in windows])
    periods = np.array([window.arrest - window.rest_begin for window in windows])
    circumstances = [
        np.log(np.maximum(ways, _least(ways)) / periods) / _SPEED,
        np.log(np.maximum(dwells, _least(dwells))) / _DWELL,
        np.log(np.maximum(stiffness, _least(stiffness))) / _GAIN,
        np.log(np.maximum(damping, 0.1 * max(float(damping.max()), TINY))) / _GAIN,
        np.array([_OTHER_DIRECTION * float(window.direction) for window in windows]),
        _PLACES * places / max(float(np.ptp(places)), TINY),
        _TIMES * times / max(float(np.ptp(times)), TINY),
    ]
    square = sum((one[:, None] - one[None, :]) ** 2 for one in circumstances)
    return np.asarray(np.exp(-0.5 * square))


def _least(values: FloatArray) -> float:
    """A thousandth of the largest: less is as good as none."""
    return 1e-3 * max(float(values.max()), math.ulp(0.0) * 1e3)
