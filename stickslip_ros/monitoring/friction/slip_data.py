# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Observed slips of one joint side by side: where it was seen when, and what the detection has of each slip.

What an observation says depends on the speed, and on how far the stamps are trusted; slips that nothing explains are
set aside. That is the noise model, of which a fit ends with another one than it begins with. Where only the motion is
known the slips say at which speeds the reference moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import ROUNDING_STD, FloatArray

_LONG_SLIP = 1.6  # distance, of the neighbours': a longer slip is two, the rest between them unseen
_NEIGHBOURS = 5  # slips on either side that a slip is compared with, 1
_SAME_REST = 0.02  # difference of two cycles' arrests, of a dwell: with less they agree on the rest between them
_OTHER_SPEED = 0.12  # change of the mean speed of cycles, of it: with more the reference has another speed
_LASTING = 3  # slips, 1: a change of speed lasts
_SLOWEST = 0.02  # speed, of a slip's mean: slower motion says no more about an edge
_PARTS = 16  # parts of a slip in which residuals are compared from slip to slip, 1
_FINEST = 2e-5  # error of a position, of a slip: neither stamps nor integration are more exact
_WHITE = 2.0  # residuals in a run of one sign, if they are independent
# Errors of a reference's speed, of it: known, as a mean, of few cycles.
_KNOWN_SPEED, _MEAN_SPEED, _FEW_CYCLES = 1e-4, 0.01, 0.03


def follows_on(before: SlipWindow, window: SlipWindow) -> bool:
    """Whether a slip goes on from the rest that the one before ended in.

    Where the motion turns round, what the rest began with is not known well: a slip that ends as the reference turns
    may be followed by a hop that nobody sees.
    """
    return (
        before.direction == window.direction
        and abs(before.arrest - window.rest_begin) < _SAME_REST * (window.breakaway - window.rest_begin) + 1e-9
    )


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """What each observation says of the position, and which slips count.

    Attributes
    ----------
    usable : slips that count, shape (slips,). linked : slips that go on from one that counts, of the same shape.
    counted : observations of slips that count, shape (m,).
    targets, errors : position that an observation shows, and its standard deviation [rad], shape (m,).
    speeds : by which time stamps that are wrong move the joint [rad/s], shape (m,).
    jitter : standard deviation of time stamps [s].
    tolerance : part of every error that stands for what the model does not explain [rad].
    """

    usable: NDArray[np.bool_]
    linked: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    targets: FloatArray
    errors: FloatArray
    speeds: FloatArray
    jitter: float
    tolerance: float


class SlipData:
    """Several slips as they were observed; nothing of it changes.

    Parameters
    ----------
    windows : in order of time, all with the force from one source; at least one.
    """

    def __init__(self, windows: list[SlipWindow]) -> None:
        self.windows = windows
        # Counted from the first slip: stamps of this century leave no digits for the differences taken here.
        self.origin = origin = windows[0].rest_begin
        self.count = len(windows)
        self.normalised = windows[0].source is ForceSource.SPEED
        self.directions = np.array([float(window.direction) for window in windows])
        self.rests_begin = np.array([window.rest_begin - origin for window in windows])
        self.breakaways = np.array([window.breakaway - origin for window in windows])
        self.arrests = np.array([window.arrest - origin for window in windows])
        self.durations = self.arrests - self.breakaways
        self.dwells = self.breakaways - self.rests_begin
        self.distances = np.array([abs(window.slip_distance) for window in windows])
        self.usual_duration = float(np.median(self.durations))
        self.usual_dwell = float(np.median(self.dwells))
        self.usual_distance = float(np.median(self.distances))
        self.rests = np.array([window.rest_position for window in windows])
        self.rest_errors = np.array([window.rest_error for window in windows])
        # The controller's force where the joint stood before and after, NaN if that is not known [N·m].
        self.drives_before = np.array([window.before.drive if window.before else math.nan for window in windows])
        self.drives_after = np.array([window.after.drive if window.after else math.nan for window in windows])
        sizes = [len(window.times) for window in windows]
        self.edges = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.times = np.concatenate([window.times - origin for window in windows])
        self.first_times, self.last_times = self.times[self.edges[:-1]], self.times[self.edges[1:] - 1]
        self.sample_interval = float(np.median([window.sample_interval for window in windows]))
        self.usual_speed = float(np.median(self.distances / self.durations))
        self.usual = np.array([self.usual_duration, self.durations.max(), self.usual_speed])  # for the windows' kernel
        # What is read of the position at least, a count or the noise [rad].
        self.least_reading = float(np.median([max(window.resolution, window.noise) for window in windows]))
        self._collect_observations()
        self.follows = np.array([False] + [follows_on(*pair) for pair in pairwise(windows)])
        self.groups, self.speeds, self.speed_errors = self._reference_speeds()
        self.single = ~self._not_alone()  # slips that hold one slip
        self.measured_speeds = self._speeds_of_observations()
        self._collect_forces()
        # Of the time of the slips, from -1 to 0.
        self.since: FloatArray = (self.breakaways - self.breakaways[-1]) / max(float(np.ptp(self.breakaways)), TINY)

    def _collect_observations(self) -> None:
        windows = self.windows
        sizes = [len(window.observed) for window in windows]
        offsets = np.repeat(self.edges[:-1], sizes)
        self.observed = offsets + np.concatenate([window.observed for window in windows])
        self.slip_of = np.repeat(np.arange(self.count), sizes)
        self.observation_edges = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.last_observed = self.observed[self.observation_edges[1:] - 1]
        self.values = np.concatenate([window.values for window in windows])
        self.gaps = np.concatenate([window.gaps for window in windows])
        self._at_edge = np.isfinite(self.gaps)
        since = (self.times[self.observed] - self.breakaways[self.slip_of]) / self.durations[self.slip_of]
        self.parts_of_slips = np.clip(np.floor(_PARTS * since), 0, _PARTS - 1).astype(np.int64)
        self._resolutions = np.repeat([window.resolution for window in windows], sizes)
        self._noises = np.repeat([window.noise for window in windows], sizes)

    def _collect_forces(self) -> None:
        windows = self.windows
        self.references = np.concatenate([window.references for window in windows])
        self.forces = np.concatenate([window.forces for window in windows])
        self.slip_of_node = np.repeat(np.arange(self.count), np.diff(self.edges))
        self.gains = np.array(
            [
                (float(window.gains.stiffness), float(window.gains.damping)) if window.gains else (0.0, 0.0)
                for window in windows
            ]
        )
        self.rates = np.concatenate([np.gradient(window.references, window.times) for window in windows])
        stiffness, damping = self.gains[self.slip_of_node].T
        # Force at the nodes that would be on a joint at zero, without its velocity's part [N·m].
        self.drives = stiffness * self.references + damping * self.rates + self.forces

    def _not_alone(self) -> NDArray[np.bool_]:
        """Which slips hold more than one slip at one speed.

        Those that last much longer than their neighbours, as a rest within them was not seen, and where only
        speeds are known those at a change of speed.
        """
        long = np.zeros(self.count, dtype=bool)
        if self.normalised:
            changes = np.flatnonzero(np.diff(self.groups))
            long[changes] = long[changes + 1] = True
        for number in range(self.count):
            near = slice(max(0, number - _NEIGHBOURS), number + _NEIGHBOURS + 1)
            neighbours = self.durations[near][self.groups[near] == self.groups[number]]
            long[number] |= self.durations[number] > _LONG_SLIP * np.median(neighbours)
        return long

    def _reference_speeds(self) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Stretches of one speed of the reference: the number of each slip's, the speeds, their relative errors."""
        groups = np.zeros(self.count, dtype=np.int64)
        if not self.normalised:
            return groups, np.zeros(0), np.zeros(0)
        given = np.array([window.reference_speed for window in self.windows])
        known = bool(np.isfinite(given).all())
        means = given
        if not known:
            way = np.append(np.diff(self.rests), math.nan)
            way[:-1][~self.follows[1:]] = math.nan
            own = np.array([window.slip_distance for window in self.windows])
            time = np.append(np.diff(self.breakaways), math.nan)
            means = np.where(np.isfinite(way), way / time, own / (self.arrests - self.rests_begin))
        start = 0
        for number in range(1, self.count):
            ratios = means[number : number + _LASTING] / np.median(means[start:number])
            if (ratios > 1.0 + _OTHER_SPEED).all() or (ratios < 1.0 / (1.0 + _OTHER_SPEED)).all():
                start = number
            groups[number] = groups[number - 1] + (start == number)
        speeds, errors = [], []
        for group in range(int(groups[-1]) + 1):
            members = np.flatnonzero(groups == group)
            first, last = members[0], members[-1]
            if known:
                speeds.append(float(means[members].mean()))
                errors.append(_KNOWN_SPEED)
            elif len(members) > 2 and self.follows[members[1:]].all():
                # From breakaway to breakaway, so that only their scatter counts.
                time = self.breakaways[last] - self.breakaways[first]
                speeds.append(float(self.rests[last] - self.rests[first]) / float(time))
                errors.append(max(_MEAN_SPEED / (len(members) - 1), _KNOWN_SPEED))
            else:
                speeds.append(float(np.median(means[members])))
                errors.append(_FEW_CYCLES)
        return groups, np.array(speeds), np.array(errors)

    def _speeds_of_observations(self) -> FloatArray:
        """Speed at the observed nodes from the observations around them [rad/s]."""
        speeds = np.zeros(len(self.times))
        for number in range(self.count):
            mine = np.flatnonzero(self.slip_of == number)
            values, times = self.values[mine], self.times[self.observed[mine]]
            reach = max(2, len(mine) // 16)
            index = np.arange(len(mine))
            left, right = np.maximum(index - reach, 0), np.minimum(index + reach, len(mine) - 1)
            speeds[self.observed[mine]] = np.abs(values[right] - values[left]) / np.maximum(
                times[right] - times[left], 1e-9
            )
        return speeds

    def noise_model(
        self, speeds: FloatArray, *, tolerance: float, jitter: float, usable: NDArray[np.bool_]
    ) -> NoiseModel:
        """What the observations say at speeds of the nodes [rad/s]; the rest is as of :class:`NoiseModel`.

        Where a count changed the joint was at the edge between two counts some time in the sample's gap.
        """
        gaps = np.where(self._at_edge, self.gaps, 0.0)
        # In the middle of the gap: while the joint gets faster its way is shorter than its speed at the end has it.
        speed = np.interp(self.times[self.observed] - 0.5 * gaps, self.times, np.abs(speeds))
        way = np.minimum(np.maximum(speed, _SLOWEST * self.usual_speed) * gaps, self._resolutions)
        edge = self.values - 0.5 * self.directions[self.slip_of] * (self._resolutions - way)
        count = np.where(self._at_edge, np.maximum(way, _SLOWEST * self._resolutions), self._resolutions)
        finest = _FINEST * self.distances[self.slip_of]
        return NoiseModel(
            **self.counted(usable),
            targets=np.where(self._at_edge, edge, self.values),
            errors=np.sqrt(
                (ROUNDING_STD * count) ** 2 + self._noises**2 + (speed * jitter) ** 2 + tolerance**2 + finest**2
            ),
            speeds=speed,
            jitter=jitter,
            tolerance=tolerance,
        )

    def counted(self, usable: NDArray[np.bool_]) -> dict[str, Any]:
        """Slips that count, those that go on from one, and the observations of slips that count."""
        linked = self.follows & np.append(False, usable[:-1]) & usable
        return {"usable": usable, "linked": linked, "counted": usable[self.slip_of]}

    def jitter(self, noise: NoiseModel, residuals: FloatArray) -> float:
        """Jitter of time stamps [s] by residuals of a fit under a noise model [1] where the joint moves fast.

        With it they are as large as their errors, or it is the largest that the stamps may have.
        """
        from scipy.optimize import brentq

        fast = (noise.speeds > 0.3 * self.usual_speed) & (np.abs(residuals) < 4.0) & noise.counted
        if not fast.any():
            return noise.jitter
        # What even stamps do not show is something else, as the swing of a load on a spring, or a fit on its way.
        gaps = self.gaps[self._at_edge] if self._at_edge.any() else np.diff(self.times)
        uneven = gaps - self.sample_interval * np.round(gaps / self.sample_interval)
        largest = float(np.sqrt(np.mean(uneven**2)))
        squares, by_jitter = (residuals * noise.errors)[fast] ** 2, noise.speeds[fast] ** 2
        known = noise.errors[fast] ** 2 - by_jitter * noise.jitter**2

        def excess(jitter: float) -> float:
            return float(np.mean(squares / (known + by_jitter * jitter**2))) - 1.0

        if excess(0.0) <= 0.0:
            return 0.0
        return largest if excess(largest) >= 0.0 else float(brentq(excess, 0.0, largest, rtol=1e-6))

    def mean_run(self, counted: NDArray[np.bool_], residuals: FloatArray) -> float:
        """Mean length of the runs of residuals of one sign, of that of independent ones; at least one."""
        ends = (np.diff(np.sign(residuals)) != 0) | (np.diff(self.slip_of) != 0)
        runs = 1 + int(np.count_nonzero(ends[counted[1:]]))
        return max(float(counted.sum()) / runs / _WHITE, 1.0)

    def detected(self, level: float) -> FloatArray:
        """The slips' unknowns as the detection sees them, with one level [N·m] for all."""
        return np.stack([self.rests, self.breakaways, np.full(self.count, math.log(level))], axis=1)
