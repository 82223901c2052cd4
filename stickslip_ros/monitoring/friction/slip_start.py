# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A first guess of the friction from the shape of one slip, without a guess to begin with.

Integrated twice, Eq. (4) is linear in 1/M, F_v/M and F_s,b/M once the Stribeck velocity, the lag and the
breakaway are given, and holds between smooth curves through the observed positions: nothing is
differentiated but those curves. The three are scanned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from stickslip_ros.model._friction_law import fallen_share
from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

_POINTS = 96  # points of a slip at which its equation is fitted, 1
_HIGHEST_DEGREE = 13  # degree of the polynomial through a slip, 1
_AROUND = 0.3  # distance of the breakaways tried from the detected one, of a slip: at most
_BREAKAWAYS = 14  # breakaways tried, 1
_STRIBECK_VELOCITIES = np.geomspace(0.006, 2.0, 12)  # Stribeck velocities tried, of the highest speed
_LAGS = np.concatenate([[0.002], np.geomspace(0.01, 0.4, 9)])  # lags tried, of the slip's duration
_RIDGE = 1e-3  # weight of small coefficients, of an observation
_LEAST = 1e-12  # addition to the diagonal of normal equations, whose diagonal is 1
_END_WEIGHT = 30.0  # weight of the slip's end, where it stands, of all observations


@dataclass(frozen=True, kw_only=True)
class ShapeGuess:
    """Parameters of one slip's shape, per inertia where that is unknown (then ``inertia`` holds ω²).

    Attributes
    ----------
    misfit : root mean square of position over slip distance.
    """

    misfit: float
    inertia: float
    viscous: float
    level: float
    stribeck_velocity: float
    lag: float
    breakaway: float


def shape_guesses(problem: SlipProblem, slip: int) -> list[ShapeGuess]:
    """Guesses from one slip, the best first; empty if the equations have no solution that can be."""
    duration, distance = float(problem.durations[slip]), float(problem.distances[slip])
    mine = problem.slip_of == slip
    detected = float(problem.breakaways[slip])
    latest = min(float(problem.times[problem.observed[mine]][0]), detected + _AROUND * duration)
    lags = duration * _LAGS
    guesses = []
    for breakaway in np.linspace(detected - _AROUND * duration, latest, _BREAKAWAYS):
        times, way, speed, misfit = _smooth(problem, slip, float(breakaway))
        lagged = np.stack([np.interp(times - lag, times, speed, left=0.0) for lag in lags])
        units = speed.max() * _STRIBECK_VELOCITIES
        falling = np.asarray(fallen_share(problem.model.law, lagged / units[:, None, None]))
        columns = np.empty((len(units), len(lags), 3, _POINTS))
        columns[:, :, 0] = _known_force(problem, slip, times, way)
        columns[:, :, 1] = -_integral(times, way)
        columns[:, :, 2] = _integral(times, _integral(times, falling))
        solutions, rests = _least_squares(columns / distance, way / distance)
        for place in zip(*np.nonzero(np.isfinite(rests)), strict=True):
            mobility, decay, level = solutions[place].tolist()
            # One of known stiffness has its inertia from the mobility; else that is ω² itself.
            inertia = mobility if problem.normalised else 1.0 / mobility
            unit = 1.0 if problem.normalised else inertia
            guesses.append(
                ShapeGuess(
                    misfit=math.hypot(float(rests[place]) / math.sqrt(_POINTS), misfit),
                    inertia=inertia,
                    viscous=decay * unit,
                    level=level * unit,
                    stribeck_velocity=float(units[place[0]]),
                    lag=float(lags[place[1]]),
                    breakaway=float(breakaway),
                )
            )
    return sorted(guesses, key=lambda guess: guess.misfit)


def _least_squares(columns: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solutions of many problems of shape (..., 3, n) at once, and how far they miss; infinite where there is none.

    Of the three unknowns the first and the last have to be positive, the second not negative.
    """
    scale = np.sqrt((columns * columns).sum(axis=-1)) + TINY
    columns = columns / scale[..., None]
    products, sides = columns @ np.swapaxes(columns, -1, -2), columns @ right
    solution = _solved(products, sides)
    # Without the second.
    outer = np.array([0, 2])
    without = np.zeros_like(solution)
    without[..., outer] = _solved(products[..., outer[:, None], outer], sides[..., outer])
    solution = np.where(solution[..., 1:2] >= 0.0, solution, without)
    missed = np.linalg.norm((solution[..., None, :] @ columns)[..., 0, :] - right, axis=-1)
    possible = (solution[..., 0] > 0.0) & (solution[..., 2] > 0.0) & (solution[..., 1] >= 0.0)
    return solution / scale, np.where(possible, missed, math.inf)


def _solved(products: FloatArray, sides: FloatArray) -> FloatArray:
    """Solutions of normal equations whose matrices have ones on the diagonal; columns all but alike have none."""
    regular = products + _LEAST * np.eye(products.shape[-1])
    return np.asarray(np.linalg.solve(regular, sides[..., None])[..., 0])


def _smooth(problem: SlipProblem, slip: int, breakaway: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Time, way and speed since breakaway as a polynomial that begins and ends at rest, and its misfit."""
    mine = problem.slip_of == slip
    duration = float(problem.arrests[slip]) - breakaway
    distance, direction = float(problem.distances[slip]), float(problem.directions[slip])
    gaps = np.nan_to_num(problem.gaps[mine])
    at_edge = np.isfinite(problem.gaps[mine])
    resolution = problem.windows[slip].resolution
    times = problem.times[problem.observed[mine]] - 0.5 * gaps - breakaway
    ways = (problem.values[mine] - problem.rests[slip]) * direction - np.where(at_edge, 0.5 * resolution, 0.0)
    inside = times < duration
    share, ways = np.maximum(times[inside] / duration, 0.0), ways[inside] / distance
    degree = min(_HIGHEST_DEGREE, max(4, len(share) // 3))

    def basis(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = chebyshev.chebvander(2.0 * at - 1.0, degree)
        slopes = chebyshev.chebval(2.0 * at - 1.0, 2.0 * chebyshev.chebder(np.eye(degree + 1), axis=0)).T
        at = at[:, None]
        return at**2 * values, 2.0 * at * values + at**2 * slopes

    weight = _END_WEIGHT * math.sqrt(len(share) + 1.0)
    end, end_slope = basis(np.ones(1))
    rows = np.vstack([basis(share)[0], weight * end, 0.25 * weight * end_slope, _RIDGE * np.eye(degree + 1)])
    right = np.concatenate([ways, [weight, 0.0], np.zeros(degree + 1)])
    coefficients = np.linalg.lstsq(rows, right, rcond=None)[0]
    misfit = math.sqrt(float(np.mean((rows[: len(share)] @ coefficients - ways) ** 2))) if len(share) else 1.0
    grid = np.linspace(0.0, 1.0, _POINTS)
    values, slopes = basis(grid)
    speed = np.maximum(slopes @ coefficients * distance / duration, 0.0)
    return grid * duration, values @ coefficients * distance, speed, misfit


def _known_force(problem: SlipProblem, slip: int, times: FloatArray, way: FloatArray) -> FloatArray:
    """The force that is known, less that at breakaway, integrated twice, in the slip's direction."""
    if problem.normalised:
        ahead = abs(float(problem.speeds[problem.groups[slip]])) * times
        return _integral(times, _integral(times, ahead - way))
    window, direction = problem.windows[slip], float(problem.directions[slip])
    assert window.gains is not None
    # Times here count from the breakaway; the windows begin before it.
    nodes = slice(problem.edges[slip], problem.edges[slip + 1])
    absolute = times + (float(problem.arrests[slip]) - times[-1])
    ahead = np.interp(absolute, problem.times[nodes], problem.references[nodes]) * direction
    ahead = ahead - ahead[0]
    force = np.interp(absolute, problem.times[nodes], problem.forces[nodes]) * direction
    force = float(window.gains.stiffness) * (ahead - way) + force - force[0]
    known = _integral(times, _integral(times, force))
    begin_speed = (ahead[1] - ahead[0]) / times[1]
    known += float(window.gains.damping) * (_integral(times, ahead - way) - 0.5 * begin_speed * times**2)
    return known


def _integral(times: FloatArray, values: FloatArray) -> FloatArray:
    """Integral from the first time, by trapezia on a uniform grid."""
    total = np.zeros_like(values)
    np.cumsum(values[..., 1:] + values[..., :-1], axis=-1, out=total[..., 1:])
    total *= 0.5 * (times[1] - times[0])
    return total
