# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction behind many slips, from no guess at all.

First guesses of the shape of one slip; then the shape of a few similar slips, then of slips from everywhere; each shape
is the start of a fit of all slips.

Integrated twice, Eq. (4) is linear in 1/M, F_v/M and F_s,b/M once the Stribeck velocity, the lag and the
breakaway are given, and holds between smooth curves through the observed positions: nothing is
differentiated but those curves. The three are scanned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from numpy.polynomial import chebyshev

from stickslip_ros.model._friction_law import fallen_share
from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction._window_kernel import (
    INERTIA,
    LAG,
    RISE_TIME,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from stickslip_ros.monitoring.friction.profile_likelihood import in_the_deepest_valley
from stickslip_ros.monitoring.friction.slip_data import SlipData
from stickslip_ros.monitoring.friction.slip_fit import Prior, SlipFit, Tolerances, fit_slips
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import (
    FIXED_STD,
    GOOD,
    ROUGHLY,
    USUAL_RISE_TIME,
    WIDE,
    Solution,
    bounds,
    fit_again,
    fit_all,
    fit_loosely,
    usual_level,
)
from stickslip_ros.monitoring.samples import FloatArray

_SIMILAR = 4  # similar slips that a first shape is fitted to, 1
_OBSERVATIONS_OF_A_SHAPE = 60  # observations of each slip while only a rough shape is searched, 1
_STARTS = 6  # guesses that are fitted, 1: at most
_GENERALISED = 4  # shapes tried on slips from everywhere, 1
_APART = 0.8  # difference of a logarithm, 1: closer guesses are one
_SHAPE_TOLERANCES = (0.01, 0.002)  # tolerances of a shape's fit, of the slip distance: ever tighter
_SHAPES_TRIED = 2  # shapes tried on all slips, 1
_LOOSE_TRIED = 3  # shapes fitted loosely, 1
_POINTS = 96  # points of a slip at which its equation is fitted, 1
_HIGHEST_DEGREE = 13  # degree of the polynomial through a slip, 1
_AROUND = 0.3  # distance of the breakaways tried from the detected one, of a slip: at most
_BREAKAWAYS = 14  # breakaways tried, 1
_STRIBECK_VELOCITIES = np.geomspace(0.006, 2.0, 12)  # Stribeck velocities tried, of the highest speed
_LAGS = np.concatenate([[0.002], np.geomspace(0.01, 0.4, 9)])  # lags tried, of the slip's duration
_RIDGE = 1e-3  # weight of small coefficients, of an observation
_LEAST = 1e-12  # addition to the diagonal of normal equations, whose diagonal is 1
_END_WEIGHT = 30.0  # weight of the slip's end, where it stands, of all observations


def search(problem: SlipProblem, start: FloatArray | None = None) -> Solution | None:
    """Find the friction behind the slips; None if nothing fits at all, or no slip is usable.

    Parameters
    ----------
    start : logarithms that fitted slips of this joint before, of shape (6,): if they lead to a good fit, nothing is
        searched.
    """
    if not problem.noise.usable.any():
        return None
    best = fit_again(problem, start) if start is not None else None
    best = best or _search_anew(problem)
    return in_the_deepest_valley(best) if best is not None else None


def _search_anew(problem: SlipProblem) -> Solution | None:
    similar = _most_similar(problem)
    rough = problem.thinned(_OBSERVATIONS_OF_A_SHAPE)
    some = rough.only(similar)
    shapes = []
    for guess in _distinct([guess for slip in (0, min(1, len(similar) - 1)) for guess in _shape_guesses(some, slip)]):
        try:
            shapes.append(_fit_shape(some, guess))
        except LinAlgError:
            continue
    shapes = _generalised(rough, shapes)
    best: Solution | None = None
    for shape in shapes[:_SHAPES_TRIED]:
        try:
            solution = fit_all(problem, shape.parameters, usual_level(shape))
        except LinAlgError:
            continue
        if best is None or solution.mean_square < best.mean_square:
            best = solution
        if solution.mean_square < GOOD:
            break
    if best is not None and best.mean_square >= GOOD:
        best = _best_loose_fit(problem, best, shapes)
    return best


def _best_loose_fit(problem: SlipProblem, tight: Solution, shapes: list[SlipFit]) -> Solution:
    """Where the model explains the slips only in part: of fits that explain about as much the one of least memory."""
    kept: list[SlipFit] = []
    for shape in shapes:
        if all(abs(float(shape.parameters[LAG] - other.parameters[LAG])) > _APART for other in kept):
            kept.append(shape)
    loose = [fit for shape in kept[:_LOOSE_TRIED] if (fit := fit_loosely(problem, tight.prior, shape)) is not None]

    def badness(solution: Solution) -> float:
        parameters = solution.fit.parameters
        return solution.tolerance * (1.0 + problem.natural_frequency(parameters) * math.exp(parameters[LAG]))

    return min(loose, key=badness, default=tight)


def _most_similar(problem: SlipProblem) -> list[int]:
    """Indices of a few consecutive slips, the most similar ones."""
    data = problem.data
    number = min(_SIMILAR, data.count)
    best, least = 0, math.inf
    for first in range(data.count - number + 1):
        part = slice(first, first + number)
        distances, durations = data.distances[part], data.durations[part]
        spread = float(np.std(distances) / np.mean(distances) + np.std(durations) / np.mean(durations))
        spread += 5.0 * len(np.unique(data.groups[part])) + 5.0 * float((~problem.noise.usable[part]).sum())
        spread += float((~data.follows[first + 1 : first + number]).sum())
        spread += 5.0 * len({data.windows[slip].gains for slip in range(first, first + number)})
        spread += 5.0 * float(np.ptp(data.directions[part]))
        # Of longer slips there are more counts.
        spread += 0.05 * float(data.distances.max() / np.mean(distances))
        if spread < least:
            best, least = first, spread
    return list(range(best, best + number))


def _distinct(guesses: list[_ShapeGuess]) -> list[_ShapeGuess]:
    """The best guesses that are not nearly the same."""
    kept: list[tuple[FloatArray, _ShapeGuess]] = []
    for guess in sorted(guesses, key=lambda guess: guess.misfit):
        place = np.log([guess.inertia, guess.level, guess.stribeck_velocity, guess.lag])
        if all(float(np.max(np.abs(place - other))) > _APART for other, _ in kept):
            kept.append((place, guess))
        if len(kept) == _STARTS:
            break
    return [guess for _, guess in kept]


def _fit_shape(problem: SlipProblem, guess: _ShapeGuess) -> SlipFit:
    """Fit similar slips, each with its own level."""
    duration = problem.data.usual_duration
    parameters = np.concatenate([np.zeros(PARAMETERS), problem.term_means])
    parameters[INERTIA] = math.log(guess.inertia)
    mass = 1.0 if problem.data.normalised else guess.inertia
    parameters[VISCOUS] = math.log(max(guess.viscous, 0.02 * mass * problem.natural_frequency(parameters)))
    parameters[STRIBECK_VELOCITY] = math.log(guess.stribeck_velocity)
    parameters[LAG] = math.log(max(guess.lag, 0.003 * duration))
    parameters[STRIBECK] = math.log(guess.level)
    parameters[RISE_TIME] = math.log(USUAL_RISE_TIME)
    return _free_fit(problem, parameters, guess.level)


def _free_fit(problem: SlipProblem, parameters: FloatArray, level: float) -> SlipFit:
    """Fit the shape alone: every slip has its own level and kinetic friction."""
    deviation = np.concatenate([np.full(PARAMETERS, WIDE), problem.term_stds])
    deviation[[STRIBECK, RISE_TIME]] = FIXED_STD
    lower, upper = bounds(problem, math.exp(parameters[INERTIA]))
    lower[RISE_TIME], upper[RISE_TIME] = -math.inf, math.inf
    prior = Prior.of(parameters, deviation, lower, upper)
    unknowns = problem.data.detected(level)
    distance = problem.data.usual_distance
    speeds: FloatArray | None = None
    for tolerance in _SHAPE_TOLERANCES:
        problem = problem.weighed(speeds, tolerance=tolerance * distance)
        fit = fit_slips(problem, prior, Tolerances(), parameters=parameters, unknowns=unknowns, enough=ROUGHLY)
        parameters, unknowns, speeds = fit.parameters, fit.unknowns, fit.velocities
    return fit


def _generalised(problem: SlipProblem, shapes: list[SlipFit]) -> list[SlipFit]:
    """The shapes, made to fit slips from everywhere, each with its own level; the best first."""
    fits, some = [], problem.spread()
    for shape in sorted(shapes, key=lambda fit: fit.cost):
        level = usual_level(shape)
        parameters = np.concatenate([shape.parameters[:PARAMETERS], some.term_means])
        parameters[STRIBECK] = math.log(level)
        try:
            fits.append(_free_fit(some, parameters, level))
        except LinAlgError:
            continue
        if len(fits) == _GENERALISED:
            break
    return sorted(fits, key=lambda fit: fit.cost)


@dataclass(frozen=True, kw_only=True)
class _ShapeGuess:
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


def _shape_guesses(problem: SlipProblem, slip: int) -> list[_ShapeGuess]:
    """Guesses from one slip, the best first; empty if the equations have no solution that can be."""
    data = problem.data
    duration, distance = float(data.durations[slip]), float(data.distances[slip])
    mine = data.slip_of == slip
    detected = float(data.breakaways[slip])
    latest = min(float(data.times[data.observed[mine]][0]), detected + _AROUND * duration)
    lags = duration * _LAGS
    guesses = []
    for breakaway in np.linspace(detected - _AROUND * duration, latest, _BREAKAWAYS):
        times, way, speed, misfit = _smooth(data, slip, float(breakaway))
        lagged = np.stack([np.interp(times - lag, times, speed, left=0.0) for lag in lags])
        units = speed.max() * _STRIBECK_VELOCITIES
        falling = np.asarray(fallen_share(problem.model.law, lagged / units[:, None, None]))
        columns = np.empty((len(units), len(lags), 3, _POINTS))
        columns[:, :, 0] = _known_force(data, slip, times, way)
        columns[:, :, 1] = -_integral(times, way)
        columns[:, :, 2] = _integral(times, _integral(times, falling))
        solutions, rests = _least_squares(columns / distance, way / distance)
        for place in zip(*np.nonzero(np.isfinite(rests)), strict=True):
            mobility, decay, level = solutions[place].tolist()
            # One of known stiffness has its inertia from the mobility; else that is ω² itself.
            inertia = mobility if data.normalised else 1.0 / mobility
            unit = 1.0 if data.normalised else inertia
            guesses.append(
                _ShapeGuess(
                    misfit=math.hypot(float(rests[place]) / math.sqrt(_POINTS), misfit),
                    inertia=inertia,
                    viscous=decay * unit,
                    level=level * unit,
                    stribeck_velocity=float(units[place[0]]),
                    lag=float(lags[place[1]]),
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


def _smooth(data: SlipData, slip: int, breakaway: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Time, way and speed since breakaway as a polynomial that begins and ends at rest, and its misfit."""
    mine = data.slip_of == slip
    duration = float(data.arrests[slip]) - breakaway
    distance, direction = float(data.distances[slip]), float(data.directions[slip])
    gaps = np.nan_to_num(data.gaps[mine])
    at_edge = np.isfinite(data.gaps[mine])
    resolution = data.windows[slip].resolution
    times = data.times[data.observed[mine]] - 0.5 * gaps - breakaway
    ways = (data.values[mine] - data.rests[slip]) * direction - np.where(at_edge, 0.5 * resolution, 0.0)
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


def _known_force(data: SlipData, slip: int, times: FloatArray, way: FloatArray) -> FloatArray:
    """The force that is known, less that at breakaway, integrated twice, in the slip's direction."""
    if data.normalised:
        ahead = abs(float(data.speeds[data.groups[slip]])) * times
        return _integral(times, _integral(times, ahead - way))
    window, direction = data.windows[slip], float(data.directions[slip])
    assert window.gains is not None
    # Times here count from the breakaway; the windows begin before it.
    nodes = slice(data.edges[slip], data.edges[slip + 1])
    absolute = times + (float(data.arrests[slip]) - times[-1])
    ahead = np.interp(absolute, data.times[nodes], data.references[nodes]) * direction
    ahead = ahead - ahead[0]
    force = np.interp(absolute, data.times[nodes], data.forces[nodes]) * direction
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
