# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction behind many slips, from no guess at all.

First the shape of a few similar slips, then of slips from everywhere; each shape is the start of a fit of all slips.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction._window_kernel import (
    INERTIA,
    LAG,
    RISE_TIME,
    STRIBECK,
    STRIBECK_VELOCITY,
    VISCOUS,
)
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
from stickslip_ros.monitoring.friction.slip_start import ShapeGuess, shape_guesses
from stickslip_ros.monitoring.samples import FloatArray

_SIMILAR = 4  # similar slips that a first shape is fitted to, 1
_OBSERVATIONS_OF_A_SHAPE = 60  # observations of each slip while only a rough shape is searched, 1
_STARTS = 6  # guesses that are fitted, 1: at most
_GENERALISED = 4  # shapes tried on slips from everywhere, 1
_APART = 0.8  # difference of a logarithm, 1: closer guesses are one
_SHAPE_TOLERANCES = (0.01, 0.002)  # tolerances of a shape's fit, of the slip distance: ever tighter
_SHAPES_TRIED = 2  # shapes tried on all slips, 1
_LOOSE_TRIED = 3  # shapes fitted loosely, 1


def search(
    problem: SlipProblem,
    start: FloatArray | None = None,
) -> Solution | None:
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
    return best.reweighed() if best is not None else None


def _search_anew(problem: SlipProblem) -> Solution | None:
    similar = _most_similar(problem)
    rough = problem.thinned(_OBSERVATIONS_OF_A_SHAPE)
    some = rough.only(similar)
    shapes = []
    for guess in _distinct([guess for slip in (0, min(1, len(similar) - 1)) for guess in shape_guesses(some, slip)]):
        try:
            shapes.append(_fit_shape(rough.only(similar), guess))
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
    number = min(_SIMILAR, problem.count)
    best, least = 0, math.inf
    for first in range(problem.count - number + 1):
        part = slice(first, first + number)
        distances, durations = problem.distances[part], problem.durations[part]
        spread = float(np.std(distances) / np.mean(distances) + np.std(durations) / np.mean(durations))
        spread += 5.0 * len(np.unique(problem.groups[part])) + 5.0 * float((~problem.noise.usable[part]).sum())
        spread += float((~problem.follows[first + 1 : first + number]).sum())
        spread += 5.0 * len({problem.windows[slip].gains for slip in range(first, first + number)})
        spread += 5.0 * float(np.ptp(problem.directions[part]))
        # Of longer slips there are more counts.
        spread += 0.05 * float(problem.distances.max() / np.mean(distances))
        if spread < least:
            best, least = first, spread
    return list(range(best, best + number))


def _distinct(guesses: list[ShapeGuess]) -> list[ShapeGuess]:
    """The best guesses that are not nearly the same."""
    kept: list[tuple[FloatArray, ShapeGuess]] = []
    for guess in sorted(guesses, key=lambda guess: guess.misfit):
        place = np.log([guess.inertia, guess.level, guess.stribeck_velocity, guess.lag])
        if all(float(np.max(np.abs(place - other))) > _APART for other, _ in kept):
            kept.append((place, guess))
        if len(kept) == _STARTS:
            break
    return [guess for _, guess in kept]


def _fit_shape(problem: SlipProblem, guess: ShapeGuess) -> SlipFit:
    """Fit similar slips, each with its own level."""
    duration = float(np.median(problem.durations))
    parameters = np.concatenate([np.zeros(PARAMETERS), problem.term_means])
    parameters[INERTIA] = math.log(guess.inertia)
    mass = 1.0 if problem.normalised else guess.inertia
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
    unknowns = problem.detected(level)
    distance = float(np.median(problem.distances))
    speeds: FloatArray | None = None
    for tolerance in _SHAPE_TOLERANCES:
        problem = problem.weighed(speeds, tolerance=tolerance * distance)
        fit = fit_slips(problem, prior, Tolerances(), parameters=parameters, unknowns=unknowns, enough=ROUGHLY)
        parameters, unknowns, speeds = fit.parameters, fit.unknowns, fit.velocities
    return fit


def _generalised(problem: SlipProblem, shapes: list[SlipFit]) -> list[SlipFit]:
    """The shapes, made to fit slips from everywhere, each with its own level; the best first."""
    fits = []
    for shape in sorted(shapes, key=lambda fit: fit.cost):
        some = problem.spread()
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
