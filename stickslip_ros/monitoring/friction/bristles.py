# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Slips on a contact that yields ever more before it breaks away, LuGre's: they begin slowly.

Where the paper's law does not explain the slips, those of a joint on bristles are fitted to the same observations. Such
a joint has neither lag nor rise of static friction, so that a slip depends on nothing but the parameters, the force and
where the joint rested, which is the only unknown of each slip; the equations are :mod:`._bristle_kernel`'s. Before a
slip the joint creeps as the force rises, and a slip that follows an arrest before the swing on the contact has died
is followed from where it has.

The result is the estimate or nothing: a fit that leaves anything over says that the joint is another one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import LAWS, LUGRE, PAPERS_LAW
from stickslip_ros.model.friction import Joint, Real
from stickslip_ros.monitoring.friction import _bristle_kernel as kernel
from stickslip_ros.monitoring.friction._bristle_kernel import (
    BRISTLE_DAMPING,
    COULOMB,
    INERTIA,
    LOAD,
    STIFFNESS,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.fit_errors import OF_HOLDING, covariance_by_residuals
from stickslip_ros.monitoring.friction.late_controller import LATE, SPREAD_LIMIT
from stickslip_ros.monitoring.friction.model_selection import EXCLUDED
from stickslip_ros.monitoring.friction.slip_data import NoiseModel, SlipData
from stickslip_ros.monitoring.friction.slip_fit import Prior, ScoredFit, robust, weights
from stickslip_ros.monitoring.friction.slip_problem import Budget
from stickslip_ros.monitoring.friction.slip_solution import FITS, WIDE
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

MOST_ON_BRISTLES = 24  # slips that are fitted, 1: more of them would not change what a fit finds
_LEAST_SLIPS = 4  # usable slips, 1: at least, as in a first study
_FEW, _OBSERVATIONS = 8, 60  # slips and observations of each while a start is searched, 1
_OUTLIER = 3.0  # mean square of a slip's residuals, 1: a slip with more, as two in one, is set aside
_MOST_ASIDE = 0.25  # slips set aside, of all: with more the joint is another one
_MOST_STEPS, _MOST_SEARCH = 2e7, 3e6  # steps of simulation for all fits, 1: 2 s of a core; for a start
_SHOWN = 0.15  # standard error of σ₀, of it: with more the slips do not show a contact that yields
_SCREENING = (0.03, 0.01)  # tolerances of positions in the search for a start, of the slip distance
_SCREENED, _TRIED = 2.0, 2  # mean square of residuals, 1: with less a start is good enough; of those so many are tried
_TIGHTENING = (0.005, 0.001, 0.0, 0.0)  # the same in the fit
_NEARLY = 2.0  # mean square of residuals, 1: with more before the end a fit does not come to be good
# Starts: stiffness of the contact, of the controller; Stribeck velocities, of the highest speed.
_CONTACT, _STRIBECK_VELOCITIES = 30.0, (0.6, 0.2, 0.05)
_VISCOUS = 0.05  # viscous friction to begin with, of M ω
_DAMPING_SPREAD = 1.5  # prior standard deviation of the logarithm of σ₁ about √(σ₀ M), 1
_LOAD_SPREAD = 10.0  # prior standard deviation of a load, of the Stribeck friction
_BETWEEN = (0.1, 0.9)  # ways, of a slip's: in the time between them a spring swings ...
_ANGLE = 1.855  # ... by such an angle, rad
_SETTLED = 7.0  # time after an arrest, of √(M/σ₀): a damping ratio of ½ leaves 3 % of the swing
_MOST_SETTLING = 0.5  # the same, of the rest: at most
# Longest step: of √(M/σ₀), of M/(σ₁ + F_v + k_v), of S/(σ₀ x˙), of M x˙_s/F_s.
_OF_SWING, _OF_DECAY, _OF_YIELDING, _OF_FALL = 0.33, 1.0, 2.0, 0.33
_STEP = 1e-4  # difference of a logarithm, and of a load in Stribeck frictions, for a slope, 1
_WAY = 2e-5  # difference of a rest's position for a slope, of the slip distance
_LONGEST_STEP, _FARTHEST = 0.7, 0.05  # change of a logarithm; of a rest, in slip distances, by an iteration: at most
_ATTEMPTS = 12  # dampings tried in an iteration, 1
# Factors of the damping after an iteration that fails and one that gains, and least damping. The valley of viscous and
# Stribeck friction is long and bent: by factors of ten a fit crept along it and ended where it was.
_MORE, _LESS, _LEAST = 3.0, 0.25, 1e-7
_ENDS = 0.01  # gain of an iteration, 1: with less a fit has ended


@dataclass(frozen=True, kw_only=True)
class BristleFit:
    """Slips fitted by a joint on bristles.

    Attributes
    ----------
    law : of the Stribeck curve. data, noise : the slips, with the noise of the fit.
    parameters : logarithms in the order of the kernel, and the load [N·m]; shape (8,).
    covariance : of these, with all that is known of misfit; zero for a load in motion one way.
    residuals, mean_square : of the observations in standard deviations, and of those that count.
    weight : probability of the law, from 0 to 1; those of all laws add up to 1.
    """

    law: str
    data: SlipData
    noise: NoiseModel
    parameters: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    mean_square: float
    weight: float = 1.0

    def misfit(self, counted: NDArray[np.bool_]) -> float:
        """Twice the negative logarithm of the likelihood of observations, but for a constant."""
        return robust(self.residuals[counted]) + 2.0 * float(np.log(self.noise.errors[counted]).sum())


@dataclass(frozen=True, kw_only=True)
class BristleContact:
    """A contact that yields as LuGre's, as it was estimated with the rest of a joint.

    Attributes
    ----------
    logarithms : of σ₀ and σ₁, shape (2,); standard errors ``stds`` (2,).
    slopes : by the logarithms of the joint's parameters, shape (2, 6). root : of their covariance given these, (2, 2).
    """

    logarithms: FloatArray
    stds: FloatArray
    slopes: FloatArray
    root: FloatArray

    @staticmethod
    def of(logarithms: FloatArray, covariance: FloatArray) -> BristleContact:
        """From the covariance of the joint's parameters and its own, shape (8, 8)."""
        own, joint = covariance[-2:, -2:], covariance[:-2, :-2]
        slopes = covariance[-2:, :-2] @ np.linalg.pinv(joint, hermitian=True)
        values, vectors = np.linalg.eigh(own - slopes @ joint @ slopes.T)
        return BristleContact(
            logarithms=logarithms,
            stds=np.sqrt(np.diag(own)),
            slopes=slopes,
            root=vectors * np.sqrt(np.maximum(values, 0.0)),
        )

    @property
    def values(self) -> FloatArray:
        """σ₀ [N·m/rad] and σ₁ [N·m·s/rad], shape (2,)."""
        return np.asarray(np.exp(self.logarithms))

    def applied_to(self, joint: Joint) -> Joint:
        """The joint on this contact, without lag and rise of static friction."""
        return self._on(joint, *self.values.tolist())

    def drawn(self, joint: Joint, offsets: FloatArray) -> Joint:
        """Joints as one of arrays, each on such a contact; ``offsets`` of their logarithms, shape (6, n)."""
        normal = np.random.default_rng(45).standard_normal((2, offsets.shape[1]))
        moves = np.clip(self.slopes @ offsets + self.root @ normal, -SPREAD_LIMIT, SPREAD_LIMIT)
        return self._on(joint, *np.exp(self.logarithms[:, None] + moves))

    @staticmethod
    def _on(joint: Joint, stiffness: Real, damping: Real) -> Joint:
        friction = replace(
            joint.friction, lag=0.0, rise_time=0.0, contact=LUGRE, presliding_stiffness=stiffness,
            presliding_damping=damping,
        )  # fmt: skip
        return replace(joint, friction=friction)

    @property
    def text(self) -> str:
        """In words."""
        stiffness, damping = self.values
        return (
            f"the contact yields before it breaks away ({LUGRE}, presliding stiffness {stiffness:.3g} N·m/rad ± "
            f"{100.0 * self.stds[0]:.1g} %, damping {damping:.2g} N·m·s/rad)"
        )


@dataclass(frozen=True, kw_only=True)
class _Point(ScoredFit):
    """A point of a fit: parameters, and where each slip begins; scored by the free parameters."""

    parameters: FloatArray
    rests: FloatArray
    velocities: FloatArray
    cost: float


class _Fit:
    """Least squares of some slips by one Stribeck curve."""

    def __init__(self, windows: list[SlipWindow], law: str, start: FloatArray, budget: Budget) -> None:
        self.data = data = SlipData([window.between_creep() for window in windows])
        self.law, self.budget = law, budget
        self.noise = data.noise_model(data.measured_speeds, tolerance=0.0, jitter=0.0, usable=data.single)
        self._firsts, self._leads = data.edges[:-1].copy(), np.zeros(data.count)
        self._highest = float(data.measured_speeds.max())
        deviation = np.full(len(start), WIDE)
        deviation[BRISTLE_DAMPING] = _DAMPING_SPREAD
        both = data.directions.min() < data.directions.max()
        deviation[LOAD] = _LOAD_SPREAD * math.exp(start[STRIBECK])
        bound = np.full(len(start), math.inf)
        self.prior = Prior.of(start, deviation, -bound, bound)
        self._free = np.arange(LOAD + both)
        self._steps = np.full(len(start), _STEP)
        self._steps[LOAD] *= math.exp(start[STRIBECK])
        self._longest = self._longest_step(start)

    def weigh(self, speeds: FloatArray | None, parameters: FloatArray, tolerance: float, jitter: float) -> None:
        """What the observations say at speeds of the nodes, from where the swing on the contact has died on."""
        data = self.data
        swing = _SETTLED * math.exp(0.5 * (parameters[INERTIA] - parameters[STIFFNESS]))
        settled = data.rests_begin + np.minimum(swing, _MOST_SETTLING * data.dwells)
        late = data.times < settled[data.slip_of_node]
        self._firsts = data.edges[:-1] + np.bincount(data.slip_of_node, late, data.count).astype(np.int64)
        self._firsts = np.minimum(self._firsts, data.edges[1:] - 2)
        self._leads = np.maximum(data.times[self._firsts] - settled, 0.0)
        noise = data.noise_model(
            data.measured_speeds if speeds is None else speeds, tolerance=tolerance * data.usual_distance,
            jitter=jitter, usable=self.noise.usable & (data.times[self._firsts] < data.breakaways),
        )  # fmt: skip
        counted = noise.counted & (data.observed >= self._firsts[data.slip_of])
        counted[data.observation_edges[1:] - 1] = False  # where the joint stands later is a mean over its creep
        self.noise = replace(noise, counted=counted)
        self._longest = self._longest_step(parameters)

    def _longest_step(self, parameters: FloatArray) -> float:
        plant = np.exp(parameters[:LOAD])
        damping = plant[BRISTLE_DAMPING] + plant[VISCOUS] + float(self.data.gains[:, 1].max())
        return float(
            min(
                _OF_SWING * math.sqrt(plant[INERTIA] / plant[STIFFNESS]),
                _OF_DECAY * plant[INERTIA] / damping,
                _OF_YIELDING * plant[COULOMB] / (plant[STIFFNESS] * self._highest),
                _OF_FALL * plant[INERTIA] * plant[STRIBECK_VELOCITY] / plant[STRIBECK],
            )
        )

    def _simulated(self, parameters: FloatArray, rests: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals of the variants, zero where they do not count, and velocities at the nodes."""
        data = self.data
        plants = parameters.copy()
        plants[:, :LOAD] = np.exp(parameters[:, :LOAD])
        positions, velocities = np.zeros((2, len(parameters), len(data.times)))
        self.budget.steps -= kernel.simulate_bristles(
            plants, LAWS[self.law], data.directions, rests, data.gains, self._leads, self._firsts,
            data.edges, data.times, data.drives, self._longest, positions, velocities,
        )  # fmt: skip
        residuals = (self.noise.targets - positions[:, data.observed]) / self.noise.errors
        return np.where(self.noise.counted, residuals, 0.0), velocities

    def point(self, parameters: FloatArray, rests: FloatArray) -> _Point:
        """The point of these parameters; of infinite cost where nothing can be simulated."""
        residuals, velocities = (one[0] for one in self._simulated(parameters[None], rests[None]))
        off = parameters - self.prior.mean
        cost = robust(residuals) + float(off @ self.prior.information @ off)
        return _Point(
            parameters=parameters, rests=rests, residuals=residuals, velocities=velocities,
            cost=cost if math.isfinite(cost) else math.inf,
        )  # fmt: skip

    def _equations(self, point: _Point) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Slopes of the residuals by the free parameters, shape (p, m), and by the rest of their slip, shape (m,).

        With the weights of the residuals, shape (m,); the products of both slopes, shape (p, slips); and the diagonal
        matrix of the rests, shape (slips,).
        """
        count = len(self._free)
        parameters, rests = (np.repeat(one[None], count + 1, axis=0) for one in (point.parameters, point.rests))
        way = _WAY * self.data.usual_distance
        steps = np.append(self._steps[self._free], way)
        parameters[np.arange(count), self._free] += steps[:count]
        rests[count] += way
        slopes = (self._simulated(parameters, rests)[0] - point.residuals) / steps[:, None]
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        by_shared, by_own, counts = slopes[:-1], slopes[-1], weights(point.residuals)
        mixed = np.array([self._by_slip(counts * one * by_own) for one in by_shared])
        return by_shared, by_own, counts, mixed, self._by_slip(counts * by_own * by_own) + 1e-12

    def fit(self, point: _Point, iterations: int, enough: float = 0.0) -> _Point:
        """Levenberg-Marquardt with each slip's own unknown eliminated; ends where an iteration gains too little."""
        data, damping = self.data, 1e-3
        for _ in range(iterations):
            if self.budget.spent:
                break
            by_shared, by_own, counts, mixed, own = self._equations(point)
            off = (self.prior.information @ (point.parameters - self.prior.mean))[self._free]
            matrix = (by_shared * counts) @ by_shared.T + self.prior.information[np.ix_(self._free, self._free)]
            gradient = (by_shared * counts) @ point.residuals + off
            own_gradient = self._by_slip(counts * by_own * point.residuals)
            found = point
            for _ in range(_ATTEMPTS):
                band = own * (1.0 + damping)
                damped = matrix + damping * np.diag(np.diag(matrix))
                try:
                    step = -np.linalg.solve(damped - (mixed / band) @ mixed.T, gradient - (mixed / band) @ own_gradient)
                except LinAlgError:
                    damping = _MORE * max(damping, _LEAST)
                    continue
                step *= min(1.0, _LONGEST_STEP / max(float(np.abs(step[:LOAD]).max()), _LONGEST_STEP))
                most = _FARTHEST * data.distances
                rests = point.rests + np.clip(-(own_gradient + step @ mixed) / band, -most, most)
                parameters = point.parameters.copy()
                parameters[self._free] += step
                found = self.point(parameters, rests)
                if found.cost < point.cost:
                    break
                damping = _MORE * max(damping, _LEAST)
            if not found.cost < point.cost:
                break
            gain, point, damping = point.cost - found.cost, found, _LESS * damping
            if gain < max(enough * point.cost, _ENDS):
                break
        return point

    def _by_slip(self, values: FloatArray) -> FloatArray:
        return np.bincount(self.data.slip_of, values, self.data.count).astype(float)

    def without_outliers(self, point: _Point) -> None:
        """Set aside the slips that nothing explains."""
        squares = self._by_slip(np.square(point.residuals)) / np.maximum(
            self._by_slip(self.noise.counted.astype(float)), 1.0
        )
        usable = self.noise.usable & ~(squares > _OUTLIER)
        if usable.any():
            self.noise = replace(self.noise, usable=usable, counted=self.noise.counted & usable[self.data.slip_of])

    def mean_square(self, point: _Point) -> float:
        """Of the residuals that count."""
        return float(np.mean(point.residuals[self.noise.counted] ** 2)) if self.noise.counted.any() else math.inf

    def scored(self, point: _Point) -> _Point:
        """The point with information, scores and bias sensitivity, the slips' own unknowns eliminated."""
        data = self.data
        by_shared, by_own, counts, mixed, own = self._equations(point)
        left = by_shared - (mixed / own)[:, data.slip_of] * by_own
        shares = data.directions[data.slip_of] * data.distances[data.slip_of] / self.noise.errors
        parts = range(int(data.parts_of_slips.max()) + 1)
        return replace(
            point,
            information=(left * counts) @ by_shared.T,
            scores=np.array([self._by_slip(counts * one * point.residuals) for one in left]).T,
            bias_sensitivity=np.array(
                [(left * counts * shares)[:, data.parts_of_slips == part].sum(1) for part in parts]
            ),
        )

    def covariance(self, point: _Point) -> FloatArray:
        """Of all parameters, with what a controller that acts on samples makes of them."""
        data, free = self.data, self._free
        deviation = 1.0 / np.sqrt(np.diag(self.prior.information)[free])
        bound = np.full(len(free), math.inf)
        prior = Prior.of(point.parameters[free], deviation, -bound, bound)
        covariance = np.zeros((len(point.parameters),) * 2)
        covariance[np.ix_(free, free)] = covariance_by_residuals(self, self.scored(point), prior)
        stiffness, damping = data.gains[-1]
        inertia = math.exp(point.parameters[INERTIA])
        angle = math.sqrt(stiffness / inertia) * data.sample_interval
        covariance[np.arange(LOAD), np.arange(LOAD)] += ((0.5 * LATE**2 + OF_HOLDING) * angle**2) ** 2
        covariance[INERTIA, INERTIA] += (LATE * data.sample_interval * damping / inertia) ** 2
        return covariance


def bristle_fits(windows: list[SlipWindow], start: FloatArray | None = None) -> tuple[BristleFit, ...]:
    """Fits of slips by a joint on bristles, of each Stribeck curve that they do not exclude; the likeliest first.

    There are none unless they leave nothing over and show the stiffness of the contact: a joint of many parameters
    explains much. ``start``: parameters that fitted earlier slips, shape (8,), or None.
    """
    windows = [window for window in windows if window.source is ForceSource.GAINS]
    if len(windows) < _LEAST_SLIPS:
        return ()
    windows, budget = _spread(windows, MOST_ON_BRISTLES), Budget(_MOST_STEPS)
    for begin in islice(_screened(windows, start), _TRIED):
        found = [fit for law in LAWS if (fit := _explaining_fit(windows, law, begin, budget)) is not None]
        if budget.spent:
            # A curve whose fit did not come to its end is not excluded.
            break
        if found:
            return _weighed(found)
    return ()


def _screened(windows: list[SlipWindow], known: FloatArray | None) -> Iterator[FloatArray]:
    """Parameters that nearly fit a few of the slips, with the paper's curve: another one is hardly seen in so few."""
    few = [window.thinned(_OBSERVATIONS) for window in _spread(windows, _FEW)]
    for start in chain([] if known is None else [known], _starts(SlipData(windows))):
        fit = _Fit(few, PAPERS_LAW, start, Budget(_MOST_SEARCH))
        point = _fitted(fit, start, _SCREENING, iterations=12, enough=0.02)
        if point is not None and fit.mean_square(point) <= _SCREENED:
            yield point.parameters


def _explaining_fit(windows: list[SlipWindow], law: str, start: FloatArray, budget: Budget) -> BristleFit | None:
    """The fit of one Stribeck curve; None if it leaves anything over, or does not show the stiffness of the contact.

    A contact that yields by less than is read of the position does not show, however small the errors: slips of other
    friction are fitted so.
    """
    fit = _Fit(windows, law, start, budget)
    point = _fitted(fit, start, _TIGHTENING, iterations=30, enough=1e-3)
    if point is None or not _explains(fit, point):
        return None
    covariance = fit.covariance(point)
    plant = np.exp(point.parameters)
    yielding = (plant[COULOMB] + plant[STRIBECK]) / plant[STIFFNESS]
    if yielding < fit.data.least_reading or not covariance[STIFFNESS, STIFFNESS] < _SHOWN**2:
        return None
    return BristleFit(
        law=law,
        data=fit.data,
        noise=fit.noise,
        parameters=point.parameters,
        covariance=covariance,
        residuals=point.residuals,
        mean_square=fit.mean_square(point),
    )


def _weighed(found: list[BristleFit]) -> tuple[BristleFit, ...]:
    """With their weights, without those that the slips exclude, the likeliest first."""
    counted = np.logical_and.reduce([fit.noise.counted for fit in found])
    misfits = np.array([fit.misfit(counted) for fit in found])
    best = found[int(np.argmin(misfits))]
    odds = np.exp(-0.5 * (misfits - misfits.min()) / best.data.mean_run(counted, best.residuals))
    weighed = [replace(fit, weight=float(weight)) for fit, weight in zip(found, odds / odds.sum(), strict=True)]
    return tuple(sorted((fit for fit in weighed if fit.weight > EXCLUDED), key=lambda fit: -fit.weight))


def _fitted(
    fit: _Fit, start: FloatArray, tolerances: tuple[float, ...], *, iterations: int, enough: float
) -> _Point | None:
    """The fit from a start, with ever smaller tolerances; None where it comes to nothing."""
    point, speeds, jitter = None, None, 0.0
    for tolerance in tolerances:
        parameters, rests = (start, fit.data.rests) if point is None else (point.parameters, point.rests)
        fit.weigh(speeds, parameters, tolerance, jitter)
        point = fit.fit(fit.point(parameters, rests), iterations, enough if tolerance > 0.0 else 0.0)
        if not math.isfinite(point.cost) or fit.budget.spent:
            return None
        if tolerances is _TIGHTENING:
            fit.without_outliers(point)
            if fit.mean_square(point) > _NEARLY or fit.noise.usable.sum() < _LEAST_SLIPS:
                return None
            jitter = fit.data.jitter(fit.noise, point.residuals)
        speeds = point.velocities
    return point


def _explains(fit: _Fit, point: _Point) -> bool:
    usable = fit.noise.usable
    few_aside = (~usable).mean() <= _MOST_ASIDE
    return bool(fit.mean_square(point) < FITS and few_aside and usable.sum() >= _LEAST_SLIPS)


def _spread(windows: list[SlipWindow], most: int) -> list[SlipWindow]:
    """At most so many of the slips, from everywhere."""
    return [
        windows[k] for k in np.unique(np.round(np.linspace(0, len(windows) - 1, min(most, len(windows)))).astype(int))
    ]


def _starts(data: SlipData) -> Iterator[FloatArray]:
    """Logarithms of parameters, and no load, from which a fit may begin; by what a spring does that lets go."""
    stiffness, distance = float(np.median(data.gains[:, 0])), data.usual_distance
    held, times = [], []
    for n in range(data.count):
        nodes, mine = slice(data.edges[n], data.edges[n + 1]), data.slip_of == n
        drive = np.interp(data.breakaways[n], data.times[nodes], data.drives[nodes])
        held.append(data.directions[n] * (drive - data.gains[n, 0] * data.rests[n]))
        way = np.maximum.accumulate(data.directions[n] * (data.values[mine] - data.rests[n])) / data.distances[n]
        begin, end = np.minimum(np.searchsorted(way, _BETWEEN), len(way) - 1)
        times.append(np.ptp(data.times[data.observed[mine]][[begin, end]]))
    frequency = _ANGLE / max(float(np.median(times)), data.sample_interval)
    inertia, stribeck = stiffness / frequency**2, 0.5 * stiffness * distance
    coulomb = max(float(np.median(held)) - stribeck, 0.1 * stribeck)
    contact = _CONTACT * stiffness
    for fall in _STRIBECK_VELOCITIES:
        values = [
            inertia, coulomb, _VISCOUS * inertia * frequency, stribeck, fall * 0.5 * distance * frequency,
            contact, math.sqrt(contact * inertia),
        ]  # fmt: skip
        yield np.append(np.log(values), 0.0)
