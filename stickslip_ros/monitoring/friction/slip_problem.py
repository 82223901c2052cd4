# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Several observed slips of one joint as one problem of least squares.

The logarithms of six parameters are unknown, and for each slip where the joint rested, when it broke away
and with what Stribeck friction. Each slip is simulated on its own from these; what ties the slips together
are Eq. (6), from one slip's end to the next one's beginning, and the balance of forces at every breakaway.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import HESS_SOOM
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import (
    INERTIA,
    LAG,
    LEVEL,
    RISE_TIME,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

PARAMETERS = RISE_TIME + 1  # beyond them stands what else slips have in common: see `SlipProblem.more_errors`
SHAPE = STRIBECK  # as many parameters, those before it, shape a single slip

# Steps of the simulation: parts of a radian of the spring's, of the time in which speed decays, of that in which the
# Stribeck friction changes, which is that of the speeding up to the Stribeck velocity and some of the lag.
_OF_RADIAN, _OF_DECAY, _OF_CHANGE, _OF_LAG = 0.4, 0.5, 0.25, 0.3
_SPEEDING_UP = 0.25  # of a slip, in which the joint comes up to the slip's mean speed
_LEAST_STEPS, _MOST_STEPS = 4.0, 400.0  # in a slip
_LONG_SLIP = 1.6  # of its neighbours: two slips, the rest between them unseen
_NEIGHBOURS = 5
_SAME_REST = 0.02  # of a dwell: how well two cycles agree on the rest between them
_OTHER_SPEED = 0.12  # a change of the mean speed of cycles by this factor is a change of the reference's
_LASTING = 3  # slips: a change of speed lasts
_SLOWEST = 0.02  # of a slip's mean speed: slower motion says no more about an edge
_DELAY = 1.5  # sample intervals, that a controller may be late
_UNIFORM = 1.0 / math.sqrt(12.0)
_PARTS = 16  # of a slip, in which residuals are compared from slip to slip
_FINEST = 2e-5  # of a slip: neither stamps nor integration are more exact
_KNOWN_SPEED, _MEAN_SPEED, _FEW_CYCLES = 1e-4, 0.01, 0.03  # relative errors of a reference's speed
_LEAST_INERTIA = 0.1  # share that a delay leaves
_LEAST_LEFT = 0.3  # of its error, that viscous friction is taken for where it seems to be less
_LARGEST_STRAY = 0.5  # of a sample interval, by which stamps may stray


def follows_on(before: SlipWindow, window: SlipWindow) -> bool:
    """Whether a slip goes on from the rest that the one before ended in.

    Where the motion turns round, what the rest began with is not known well: a slip that ends as the reference turns
    may be followed by a hop that nobody sees.
    """
    return (
        before.direction == window.direction
        and abs(before.arrest - window.rest_begin) < _SAME_REST * (window.breakaway - window.rest_begin) + 1e-9
    )


class SlipProblem:
    """Observed slips, and what a simulation of them needs.

    Where gains or force are unknown the inertia is taken as one, and its place among the parameters holds the
    stiffness, which then is ω²; damping and forces are per inertia likewise.

    Parameters
    ----------
    windows : in order of time, all with the force from one source; at least one.
    before : arrest before the first slip [s] and the share of F_s∞ that was left then, if known.
    both_directions : whether the load is told from the Coulomb friction even if these slips are all of one direction,
        because slips of both are known; where the reference's speeds are all that is known it means nothing.
    law : of the Stribeck friction, by its number in ``model._friction_law``.
    delay_shows : whether the controller's delay is unknown too; by default where the gains are not the same throughout,
        for a delay τ is as good as damping of -k_p τ and inertia of -k_v τ.

    ``more_errors`` are prior standard deviations of what stands beyond the parameters: the reference's speeds, where
    only they are known, relative; the controller's delay, in sample intervals, where it shows.
    """

    def __init__(
        self,
        windows: list[SlipWindow],
        before: tuple[float, float] | None = None,
        *,
        both_directions: bool = False,
        law: int = HESS_SOOM,
        delay_shows: bool | None = None,
    ) -> None:
        self.windows = windows
        self.law = law
        # Counted from the first slip: stamps of this century leave no digits for the differences taken here.
        self.origin = origin = windows[0].rest_begin
        self.before = (before[0] - origin, before[1]) if before else None
        self.count = count = len(windows)
        self.normalised = windows[0].source is ForceSource.SPEED
        self.directions = np.array([float(window.direction) for window in windows])
        self.rests_begin = np.array([window.rest_begin - origin for window in windows])
        self.breakaways = np.array([window.breakaway - origin for window in windows])
        self.arrests = np.array([window.arrest - origin for window in windows])
        self.durations = self.arrests - self.breakaways
        self._usual_duration = float(np.median(self.durations))
        self._least_rate = _LEAST_STEPS / self._usual_duration
        self._most_rate = _MOST_STEPS / float(self.durations.max())
        self.dwells = self.breakaways - self.rests_begin
        self.distances = np.array([abs(window.slip_distance) for window in windows])
        self.rests = np.array([window.rest_position for window in windows])
        self.rest_errors = np.array([window.rest_error for window in windows])
        sizes = [len(window.times) for window in windows]
        self.edges = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.times = np.concatenate([window.times - origin for window in windows])
        self.first_times, self.last_times = self.times[self.edges[:-1]], self.times[self.edges[1:] - 1]
        self.references = np.concatenate([window.references for window in windows])
        self.forces = np.concatenate([window.forces for window in windows])
        self._slip_of_node = np.repeat(np.arange(count), sizes)
        self._gains = np.array(
            [
                (float(window.gains.stiffness), float(window.gains.damping)) if window.gains else (0.0, 0.0)
                for window in windows
            ]
        )
        self._largest_gains = self._gains.max(axis=0)[None]
        if delay_shows is None:
            delay_shows = windows[0].source is ForceSource.GAINS and len({window.gains for window in windows}) > 1
        self.delay_shows = delay_shows
        self.sample_interval = float(np.median([window.sample_interval for window in windows]))
        self._rates = np.concatenate([np.gradient(window.references, window.times) for window in windows])
        stiffness, damping = self._gains[self._slip_of_node].T
        # Force at the nodes that would be on a joint at zero, without its velocity's part [N·m].
        self._drives = stiffness * self.references + damping * self._rates + self.forces
        self._collect_observations()
        self.follows = np.array([False] + [follows_on(*pair) for pair in pairwise(windows)])
        self.usable = np.ones(count, dtype=bool)
        self.groups, self.speeds, self.more_errors = self._reference_speeds()
        if self.delay_shows:
            self.more_errors = np.array([_DELAY])
        self.set_aside(self._not_alone())
        # Columns: what the kinetic friction is made of. With both directions the load shows, in one it is part of it.
        if self.normalised:
            self.balance = np.eye(len(self.speeds))[self.groups]
        elif both_directions or self.directions.min() < self.directions.max():
            self.balance = np.stack([np.ones(count), self.directions], axis=1)
        else:
            self.balance = np.ones((count, 1))
        self.usual_speed = float(np.median(self.distances / self.durations))
        self.stray = 0.0
        self.speeds_at_nodes = self._measured_speeds()
        self.weigh(self.speeds_at_nodes)

    def _collect_observations(self) -> None:
        windows = self.windows
        sizes = [len(window.observed) for window in windows]
        offsets = np.repeat(self.edges[:-1], sizes)
        self.observed = offsets + np.concatenate([window.observed for window in windows])
        self.slip_of = np.repeat(np.arange(self.count), sizes)
        self.observation_edges = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.values = np.concatenate([window.values for window in windows])
        self.gaps = np.concatenate([window.gaps for window in windows])
        self._at_edge = np.isfinite(self.gaps)
        since = (self.times[self.observed] - self.breakaways[self.slip_of]) / self.durations[self.slip_of]
        self.parts_of_slips = np.clip(np.floor(_PARTS * since), 0, _PARTS - 1).astype(np.int64)
        self._resolutions = np.repeat([window.resolution for window in windows], sizes)
        self._noises = np.repeat([window.noise for window in windows], sizes)

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
            alike = self.durations[near][self.groups[near] == self.groups[number]]
            long[number] |= self.durations[number] > _LONG_SLIP * np.median(alike)
        return long

    def set_aside(self, which: NDArray[np.bool_]) -> None:
        """Leave slips out of the fit; what follows them begins anew."""
        self.usable = self.usable & ~which
        self.linked = self.follows & np.append(False, self.usable[:-1]) & self.usable
        self.weights = self.usable[self.slip_of].astype(float)

    def take_up(
        self,
        *,
        stray: float,
        tolerance: float,
        usable: NDArray[np.bool_] | None = None,
        speeds: FloatArray | None = None,
    ) -> None:
        """Go on as an earlier fit left it, of these slips or of others of the joint.

        Parameters
        ----------
        stray : by how much the stamps stray [s]. tolerance : as of :meth:`weigh`.
        usable : which of these slips it explained; None if it was of others. speeds : at the nodes, likewise.
        """
        self.stray = stray
        if usable is not None:
            self.usable = np.ones(self.count, dtype=bool)
            self.set_aside(~usable)
        self.weigh(self.speeds_at_nodes if speeds is None else speeds, tolerance)

    def begin_anew(self) -> None:
        """Take back what earlier fits set aside or found of the stamps."""
        self.usable = np.ones(self.count, dtype=bool)
        self.stray = 0.0
        self.set_aside(self._not_alone())

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

    def stiffness(self, parameters: FloatArray) -> FloatArray:
        """Of the spring in each slip [N·m/rad], shape (slips,); per inertia ω²."""
        return np.full(self.count, math.exp(parameters[INERTIA])) if self.normalised else self._gains[:, 0]

    def natural_frequency(self, parameters: FloatArray) -> float:
        """ω [1/s] with the largest gain; that of the slips' duration where there is no stiffness."""
        stiffness = float(self.stiffness(parameters).max())
        if stiffness <= 0:
            return 2.0 * math.pi / self._usual_duration
        return math.sqrt(stiffness / (1.0 if self.normalised else math.exp(parameters[INERTIA])))

    def loading_rate(self, parameters: FloatArray) -> float:
        """How fast the force on the resting joint rises, median of the slips [N·m/s]."""
        if self.normalised:
            rates = np.abs(self.speeds * np.exp(parameters[PARAMETERS:]))[self.groups]
        else:
            ends = self.edges[1:] - 1
            rates = np.abs(self.references[ends] - self.references[self.edges[:-1]])
            rates /= self.last_times - self.first_times
        return float(np.median(self.stiffness(parameters) * rates))

    def simulate(self, parameters: FloatArray, unknowns: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and velocities at the nodes, and what is found of each slip (columns of the kernel).

        ``unknowns`` of shape (slips, 3): rest position [rad], breakaway [s], logarithm of the level [N·m].
        """
        positions, velocities, found = self.simulate_variants(parameters[None], unknowns[None])
        return positions[0], velocities[0], found[0]

    def simulate_variants(
        self, parameters: FloatArray, unknowns: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What :meth:`simulate` gives for several parameters and unknowns at once, each with its row."""
        plants = np.exp(parameters[:, :PARAMETERS])
        gains, drives = self._gains[None], self._drives[None]
        if self.normalised:
            stiffness = plants[:, INERTIA].copy()
            plants[:, INERTIA] = 1.0
            gains = np.zeros((len(plants), self.count, 2))
            gains[:, :, 0] = stiffness[:, None]
            speeds = stiffness[:, None] * self.speeds * np.exp(parameters[:, PARAMETERS:])
            drives = speeds[:, self.groups[self._slip_of_node]] * (self.times - self.times[0])
        starts = unknowns.copy()
        starts[:, :, LEVEL] = np.exp(unknowns[:, :, LEVEL])
        lighter = None
        if self.delay_shows:
            # The force of a time ago is that of now less its rate; by the inertia left, all that is per inertia grows.
            delay = parameters[:, PARAMETERS, None] * self.sample_interval
            stiffness, damping = self._gains.T
            lighter = np.maximum(1.0 - delay * damping / plants[:, INERTIA, None], _LEAST_INERTIA)
            viscous = plants[:, VISCOUS, None]
            gains = np.stack([stiffness / lighter, (damping - delay * stiffness + viscous) / lighter - viscous], axis=2)
            late = (delay * stiffness)[:, self._slip_of_node] * self._rates
            drives = (self._drives - late) / lighter[:, self._slip_of_node]
            starts[:, :, LEVEL] /= lighter
        positions, velocities = np.empty((2, len(plants), len(self.times)))
        found = np.empty((len(plants), self.count, kernel.FOUND_COLUMNS))
        kernel.simulate_windows(
            plants, self.law, self.directions, starts, gains, self.edges, self.times, drives,
            self._steps(plants, gains), positions, velocities, found,
        )  # fmt: skip
        if lighter is not None:
            found[:, :, kernel.HELD] *= lighter
        return positions, velocities, found

    def _steps(self, plants: FloatArray, gains: FloatArray) -> FloatArray:
        """Steps of the simulation [s], a smooth function of the parameters."""
        # As few calls as can be: they take longer than what they do.
        inertia = plants[:, INERTIA]
        largest = self._largest_gains if gains.base is self._gains else gains.max(axis=1)
        stiffness, damping = largest[:, 0], largest[:, 1]
        frequency = np.where(stiffness > 0, np.sqrt(stiffness / inertia), 2.0 * math.pi / self._usual_duration)
        speeding_up = _SPEEDING_UP * self._usual_duration / self.usual_speed
        change = plants[:, STRIBECK_VELOCITY] * speeding_up + _OF_LAG * plants[:, LAG]
        rate = np.maximum(frequency / _OF_RADIAN, (plants[:, VISCOUS] + damping) / inertia / _OF_DECAY)
        rate = np.maximum(rate, 1.0 / (_OF_CHANGE * change))
        rate = np.minimum(np.maximum(rate, self._least_rate), self._most_rate)
        return np.asarray(1.0 / rate)

    def weigh(self, speeds: FloatArray, tolerance: float = 0.0) -> None:
        """Set what each observation says of the position, and its standard deviation, for speeds at the nodes.

        Where a count changed the joint was at the edge between two counts some time in the sample's gap.
        ``tolerance`` [rad] is added to every error: it widens the valley while the parameters are far off.
        """
        gaps = np.where(self._at_edge, self.gaps, 0.0)
        # In the middle of the gap: while the joint gets faster its way is shorter than its speed at the end has it.
        speed = np.interp(self.times[self.observed] - 0.5 * gaps, self.times, np.abs(speeds))
        way = np.minimum(np.maximum(speed, _SLOWEST * self.usual_speed) * gaps, self._resolutions)
        edge = self.values - 0.5 * self.directions[self.slip_of] * (self._resolutions - way)
        self.targets = np.where(self._at_edge, edge, self.values)
        count = np.where(self._at_edge, np.maximum(way, _SLOWEST * self._resolutions), self._resolutions)
        finest = _FINEST * self.distances[self.slip_of]
        self.errors = np.sqrt(
            (_UNIFORM * count) ** 2 + self._noises**2 + (speed * self.stray) ** 2 + tolerance**2 + finest**2
        )

    def know_speeds(self, velocities: FloatArray) -> None:
        """Take a fit's velocities at the nodes for the speeds there, in place of the measured ones."""
        self.speeds_at_nodes = velocities

    def measure_stray(self, residuals: FloatArray, velocities: FloatArray) -> None:
        """Set by how much the stamps stray [s], from residuals of a fit [1], where the joint moves fast."""
        speed = np.abs(velocities[self.observed])
        fast = (speed > 0.3 * self.usual_speed) & (np.abs(residuals) < 4.0) & (self.weights > 0)
        if not fast.any():
            return
        in_time = self.errors[fast] / speed[fast]
        expected = in_time**2 - self.stray**2
        excess = float(np.mean((residuals[fast] * in_time) ** 2 - expected))
        gaps = self.gaps[self._at_edge] if self._at_edge.any() else np.diff(self.times)
        largest = _LARGEST_STRAY * float(np.median(gaps))
        self.stray = min(math.sqrt(excess), largest) if excess > 0.2 * float(np.mean(expected)) else 0.0

    def _measured_speeds(self) -> FloatArray:
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

    def detected(self, level: float) -> FloatArray:
        """The slips' unknowns as the detection sees them, with one level [N·m] for all."""
        return np.stack([self.rests, self.breakaways, np.full(self.count, math.log(level))], axis=1)

    def thinned(self, most: int) -> SlipProblem:
        """The problem with at most so many observations of each slip."""
        return SlipProblem(
            [window.thinned(most) for window in self.windows], law=self.law, delay_shows=self.delay_shows
        )

    def with_law(self, law: int) -> SlipProblem:
        """The problem of the same slips under another friction law; what was found of the stamps is kept."""
        other = SlipProblem(self.windows, self.before, law=law, delay_shows=self.delay_shows)
        other.balance = self.balance
        other.take_up(stray=self.stray, tolerance=0.0)
        return other

    def only(self, which: list[int]) -> SlipProblem:
        """The problem of some of the slips."""
        some = [self.windows[number] for number in which]
        return SlipProblem(some, law=self.law, delay_shows=self.delay_shows)

    def at_the_latest_gains(self, parameters: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Parameters and covariance with what a delay leaves of the viscous friction at the latest gains for viscous.

        What is taken off goes with the stiffness: k_p τ. Shapes (p,) and (p + k, p + k), as they were.
        """
        if not self.delay_shows:
            return parameters, covariance
        late = float(self._gains[-1, 0]) * self.sample_interval
        viscous = math.exp(parameters[VISCOUS])
        left = viscous - late * float(parameters[PARAMETERS])
        slopes = np.eye(len(covariance))
        slopes[VISCOUS, [VISCOUS, PARAMETERS]] = viscous, -late
        error = math.sqrt(max(float(slopes[VISCOUS] @ covariance @ slopes[VISCOUS]), 0.0))
        # Friction is not negative; the logarithm needs some.
        left = max(left, _LEAST_LEFT * error, 1e-6 * viscous)
        slopes[VISCOUS] /= left
        changed = parameters.copy()
        changed[VISCOUS] = math.log(left)
        return changed, np.asarray(slopes @ covariance @ slopes.T)
