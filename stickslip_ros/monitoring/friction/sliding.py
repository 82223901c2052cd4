# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction-speed curve of a joint from sliding: measured force against speed, where the force is known.

Eq. (4) averaged over short stretches of sliding says force = load ± (F_k + F_s Ψ) + F_v v + M a, with Ψ of the
paper's law. Every range
of speeds counts the same, however long the joint went at it. Such stretches show the curve of steady friction;
of its lag and of the rise of static friction they show nothing that could be told from other transients.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.friction import stribeck_shape
from stickslip_ros.monitoring.friction.estimate import ParameterEstimate
from stickslip_ros.monitoring.samples import Batch, FloatArray, effort_is_measured

# Parameters of friction in the order of the table in `model.friction`, then the forces beside friction.
NAMES = ("coulomb", "viscous", "stribeck", "stribeck_velocity", "load", "inertia")
_COULOMB, _VISCOUS, _STRIBECK, _STRIBECK_VELOCITY, _LOAD, _INERTIA = range(6)
_STRETCHES = 3000  # stretches of a record, 1: at most
_LEAST_STRETCHES = 12  # stretches, 1: fewer show no curve
_COUNTS = 4.0  # way of a stretch, resolutions: with less its speed means nothing
_LONGEST = 1.0  # duration of a stretch, s
_GAP = 0.3  # time without a sample, s: a longer one ends a stretch
_STARTS = (0.1, 0.3, 1.0, 3.0)  # Stribeck velocities from which a fit begins, of the median speed
_IDENTIFIED = 0.15  # standard error, of the value: a curve from noisy efforts is of use with three times that of slips
# Ranges of speeds of equal weight, 1; stretches with less than which a range weighs less, 1.
_SPEED_RANGES, _LEAST_IN_RANGE = 10, 3
_RUNS = 12  # parts of a record, 1: their scatter gives the errors


@dataclass(frozen=True, kw_only=True)
class SlidingFriction:
    """A friction-speed curve with errors.

    Attributes
    ----------
    values, errors : in the order of NAMES, SI units; NaN where the motion shows nothing of one.
    slowest, fastest : the speeds that were seen [rad/s]; beyond them the curve is a guess.
    scatter : of the force about the curve [N·m].
    covariance : of the values, shape (6, 6).
    """

    values: FloatArray
    errors: FloatArray
    slowest: float
    fastest: float
    scatter: float
    covariance: FloatArray

    def identified(self, name: str) -> bool:
        """Whether the motion determines a parameter to 15 %; in one direction never Coulomb friction."""
        index = NAMES.index(name)
        if index == _COULOMB and math.isnan(self.errors[_LOAD]):
            return False
        return bool(self.errors[index] <= _IDENTIFIED * abs(self.values[index]))

    def estimate(self, name: str) -> ParameterEstimate:
        """A parameter by its name."""
        index = NAMES.index(name)
        return ParameterEstimate(
            value=float(self.values[index]), std=float(self.errors[index]), identified=self.identified(name)
        )

    def friction(self, velocity: FloatArray) -> FloatArray:
        """Friction in steady sliding [N·m], odd in the velocity [rad/s]; the load is not in it."""
        return _curve(self.values, np.asarray(velocity, dtype=float))

    def error(self, velocity: float) -> float:
        """Standard error of the friction at a speed [N·m]."""
        slopes = np.zeros(len(self.values))
        for index in range(_STRIBECK_VELOCITY + 1):
            step = 1e-4 * max(abs(self.values[index]), 1e-9)
            moved = self.values.copy()
            moved[index] += step
            at = np.array([velocity])
            slopes[index] = float((_curve(moved, at) - _curve(self.values, at))[0]) / step
        return math.sqrt(max(float(slopes @ self.covariance @ slopes), 0.0))


def sliding_points(batch: Batch, resolution: float) -> FloatArray | None:
    """Velocities [rad/s], mean efforts [N·m] and accelerations [rad/s²] of stretches of sliding, of shape (3, n).

    None if there are too few, or the effort is unknown.
    """
    stretches = _stretches(batch, resolution)
    return None if stretches is None else np.array(stretches[:3])


def sliding_friction(batch: Batch, *, resolution: float = 0.0, inertia: float | None = None) -> SlidingFriction | None:
    """Fit the curve; None if there is too little sliding with known effort.

    Parameters
    ----------
    resolution : of the position [rad]. inertia : [kg·m²] if known, else it is fitted.
    """
    stretches = _stretches(batch, resolution)
    if stretches is None:
        return None
    velocity, force, acceleration, part = stretches
    weights = _weights(velocity)
    usual, level = float(np.median(np.abs(velocity))), float(np.median(np.abs(force)))
    both = velocity.min() < 0 < velocity.max()
    free = np.ones(len(NAMES), dtype=bool)
    free[_LOAD] = both
    free[_INERTIA] = inertia is None
    best = None
    for start in _STARTS:
        guess = np.array([0.6 * level, 0.05 * level / usual, 0.5 * level, start * usual, 0.0, inertia or 0.0])
        fit = _fit(guess, free, velocity, force, acceleration, weights, level)
        if best is None or fit[1] < best[1]:
            best = fit
    assert best is not None
    values, _, residuals, jacobian = best
    covariance = _covariance(jacobian, residuals, part, free)
    errors = np.sqrt(np.diag(covariance))
    errors[~free] = math.nan
    return SlidingFriction(
        values=values,
        errors=errors,
        slowest=float(np.quantile(np.abs(velocity), 0.01)),
        fastest=float(np.quantile(np.abs(velocity), 0.99)),
        scatter=1.48 * float(np.median(np.abs(residuals))),
        covariance=covariance,
    )


def _stretches(batch: Batch, resolution: float) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]] | None:
    """Mean velocity, force and acceleration of stretches of sliding, and which part of the record they are in."""
    known = np.isfinite(batch.effort)
    if known.sum() < 2 * _LEAST_STRETCHES or not effort_is_measured(batch.effort[known]):
        return None
    batch = batch.where(known)
    time, position = batch.time, batch.position
    # Stretches long enough for their counts and for the number of them to be bounded.
    usual = float(np.median(np.abs(np.diff(position)) / np.diff(time)[: len(position) - 1]))
    span = float(time[-1] - time[0])
    speed = max(usual, float(np.sum(np.abs(np.diff(position)))) / span, 1e-12)
    length = float(np.clip(_COUNTS * resolution / speed, span / _STRETCHES, _LONGEST))
    length = max(length, 3.0 * float(np.median(np.diff(time))))
    number = np.floor((time - time[0]) / length).astype(np.int64)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    ends = np.append(starts[1:], len(time) - 1)
    whole = (ends > starts) & (time[ends] - time[starts] < length + _GAP) & (time[ends] - time[starts] > 0.5 * length)
    starts, ends = starts[whole], ends[whole]
    if len(starts) < _LEAST_STRETCHES:
        return None
    spans = time[ends] - time[starts]
    velocity = (position[ends] - position[starts]) / spans
    sums = np.concatenate([[0.0], np.cumsum(batch.effort)])
    force = (sums[ends] - sums[starts]) / (ends - starts)
    middle = 0.5 * (time[ends] + time[starts])
    acceleration = np.gradient(velocity, middle)
    # Sliding: one direction throughout, and before and after.
    turning = np.append(False, velocity[1:] * velocity[:-1] <= 0)
    turning |= np.append(turning[1:], False)
    sliding = ~turning & (np.abs(velocity) * spans >= max(_COUNTS * resolution, TINY))
    if sliding.sum() < _LEAST_STRETCHES:
        return None
    part = (np.arange(len(velocity)) * _RUNS // len(velocity))[sliding]
    return velocity[sliding], force[sliding], acceleration[sliding], part


def _weights(velocity: FloatArray) -> FloatArray:
    """Weights that give every range of speeds the same say, in each direction; their mean is one."""
    speed = np.abs(velocity)
    low, high = np.quantile(speed, [0.01, 0.99])
    bins = np.clip(np.floor(_SPEED_RANGES * (speed - low) / max(high - low, TINY)), 0, _SPEED_RANGES - 1)
    ranges = (bins + _SPEED_RANGES * (velocity < 0)).astype(np.int64)
    counts = np.bincount(ranges)
    weights = 1.0 / np.maximum(counts[ranges], _LEAST_IN_RANGE)
    return np.asarray(weights / weights.mean())


def _curve(values: FloatArray, velocity: FloatArray) -> FloatArray:
    shape = stribeck_shape(velocity, values[_STRIBECK_VELOCITY])
    return np.asarray(np.sign(velocity) * (values[_COULOMB] + values[_STRIBECK] * shape) + values[_VISCOUS] * velocity)


def _fit(
    guess: FloatArray,
    free: NDArray[np.bool_],
    velocity: FloatArray,
    force: FloatArray,
    acceleration: FloatArray,
    weights: FloatArray,
    level: float,
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Values, cost, residuals and their slopes from one start."""
    # scipy loads slowly, and most uses of this package have no use for it.
    from scipy.optimize import least_squares

    def expand(unknown: FloatArray) -> FloatArray:
        values = guess.copy()
        values[free] = unknown
        return np.asarray(values)

    def residuals(unknown: FloatArray) -> FloatArray:
        values = expand(unknown)
        model = _curve(values, velocity) + values[_LOAD] + values[_INERTIA] * acceleration
        return np.asarray(np.sqrt(weights) * (force - model), dtype=float)

    usual = float(np.median(np.abs(velocity)))
    lower = np.array([0.0, 0.0, 0.0, 1e-3 * usual, -math.inf, 0.0])
    upper = np.array([math.inf, math.inf, 20.0 * level, 100.0 * usual, math.inf, math.inf])
    scale = np.array([level, level / usual, level, usual, level, level / usual])
    found = least_squares(
        residuals,
        np.clip(guess, lower + 1e-12, upper)[free],
        bounds=(lower[free], upper[free]),
        x_scale=scale[free],
        loss="soft_l1",
        f_scale=0.05 * level,
    )
    slopes = np.zeros((len(velocity), len(guess)))
    slopes[:, free] = found.jac
    return expand(found.x), float(found.cost), residuals(found.x), slopes


def _covariance(
    slopes: FloatArray, residuals: FloatArray, part: NDArray[np.int64], free: NDArray[np.bool_]
) -> FloatArray:
    """Covariance from the scatter between parts of the record: neighbours in time are not independent."""
    covariance = np.zeros((len(free), len(free)))
    used = slopes[:, free]
    scale = 1.0 / np.maximum(np.sqrt((used * used).sum(axis=0)), TINY)
    inverse = np.linalg.pinv((used * scale).T @ (used * scale), rcond=1e-10, hermitian=True)
    scores = np.stack([(used * scale)[part == run].T @ residuals[part == run] for run in np.unique(part)])
    freedom = max(len(scores) - 1, 1)
    middle = inverse @ (scores.T @ scores * len(scores) / freedom) @ inverse
    plain = inverse * float(np.mean(residuals**2))
    middle = np.where(np.eye(len(middle), dtype=bool), np.maximum(middle, plain), middle)
    # What shows in no residual has an infinite scale, and an error that is no number: it is not identified.
    with np.errstate(over="ignore", invalid="ignore"):
        covariance[np.ix_(free, free)] = middle * np.outer(scale, scale)
    return covariance
