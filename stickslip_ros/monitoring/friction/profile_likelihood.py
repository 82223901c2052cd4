# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Profile likelihood of the least certain parameter: a deeper valley beside a fit, and errors where valleys are bent.

Least squares take their errors from the slopes at the fit. A parameter that is known to a fifth is uncertain over a
range in which these slopes change. The cost is therefore minimised once more on either side, with that parameter held
two standard errors off: a parabola would rise by four. Where the cost falls, the fit ended in a wrong valley (Bates and
Watts, Nonlinear Regression Analysis and Its Applications, 1988, chapter 6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.fit_errors import covariance_of
from stickslip_ros.monitoring.friction.slip_fit import Prior, SlipFit, Tolerances, fit_slips
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS
from stickslip_ros.monitoring.friction.slip_solution import FIXED_STD, GOOD, LAST_ITERATIONS, NEARLY, Solution
from stickslip_ros.monitoring.samples import FloatArray

_STRAIGHT = 0.1  # standard error of a logarithm, 1: with less the slopes hold
_STEP, _FARTHEST = 2.0, 1.5  # distance at which a parameter is held, standard errors; of its logarithm, 1: at most
_DEEPER = 0.5  # cost, 1: valleys that differ by less are one
_FLAT = 0.25  # cost, 1: a profile that rises by less counts as one that does
_ITERATIONS = 40  # iterations of a fit beside the solution, 1: at most
_VALLEYS = 4  # valleys that a fit is led through, 1: at most


@dataclass(frozen=True, kw_only=True)
class _Side:
    """Least cost with the least certain parameter held off the fit.

    Attributes
    ----------
    fit : of the others. rise : of the cost above the solution's. move : of parameters and kinetic friction, (p + k,).
    """

    fit: SlipFit
    rise: float
    move: FloatArray


def in_the_deepest_valley(solution: Solution) -> Solution:
    """The solution, or one of less cost that its profile leads to."""
    for _ in range(_VALLEYS):
        deepest = min(_sides(solution), key=lambda side: side.rise, default=None)
        if deepest is None or deepest.rise > -_DEEPER:
            break
        fit = _fitted(solution, solution.prior, deepest.fit.parameters, deepest.fit, scored=True)
        if fit is None:
            break
        solution = replace(solution, fit=fit)
    return solution


def covariance_by_profile(solution: Solution) -> FloatArray:
    """Covariance that the profile of the least certain parameter adds to that of least squares, (p + k, p + k)."""
    index, straight = _move_by_an_error(covariance_of(solution.fit.information, solution.prior))
    sides = _sides(solution)
    if not sides:
        return np.zeros((len(straight), len(straight)))
    # A steeper profile may be a fit that has not ended.
    of_parabola = _reach(straight[index]) ** 2
    moves = [side.move / math.sqrt(min(max(side.rise, _FLAT), of_parabola)) for side in sides]
    scatter = np.mean([np.outer(move, move) for move in moves], axis=0)
    return np.asarray(scatter - np.outer(straight, straight))


def _move_by_an_error(covariance: FloatArray) -> tuple[int, FloatArray]:
    """Index of the least certain parameter; how all move with it by its standard error, shape (p + k,)."""
    index = int(np.argmax(np.diag(covariance)[:PARAMETERS]))
    return index, covariance[:, index] / math.sqrt(max(float(covariance[index, index]), TINY))


def _reach(error: float) -> float:
    """Distance at which a parameter of a standard error is held, in standard errors."""
    return min(_STEP, _FARTHEST / error)


@lru_cache(maxsize=4)
def _sides(solution: Solution) -> tuple[_Side, ...]:
    """Both sides of the least certain parameter, as far as they are in bounds; none where the slopes hold or no law
    fits.
    """
    index, move = _move_by_an_error(covariance_of(solution.fit.information, solution.prior))
    if solution.tolerance > 0.0 or not solution.mean_square < GOOD or not move[index] > _STRAIGHT:
        return ()
    middle = _fitted(solution, solution.prior, solution.fit.parameters, solution.fit)
    if middle is None:
        return ()
    farthest = _reach(move[index]) * move[: len(middle.parameters)]
    sides = (_side(solution, middle, index, step) for step in (-farthest, farthest))
    return tuple(side for side in sides if side is not None)


def _side(solution: Solution, middle: SlipFit, index: int, step: FloatArray) -> _Side | None:
    """Least cost with a parameter held at a step of all from the middle; None if it is out of bounds."""
    prior = solution.prior
    start = np.clip(middle.parameters + step, prior.lower, prior.upper)
    if abs(start[index] - middle.parameters[index]) < 0.5 * abs(step[index]):
        return None
    deviation, mean = 1.0 / np.sqrt(np.diag(prior.information)), prior.mean.copy()
    deviation[index], mean[index] = FIXED_STD, start[index]
    fit = _fitted(solution, Prior.of(mean, deviation, prior.lower, prior.upper), start, middle)
    if fit is None:
        return None
    cost = fit.cost + (start[index] - prior.mean[index]) ** 2 * prior.information[index, index]
    move = np.concatenate([fit.parameters - middle.parameters, fit.kinetic - middle.kinetic])
    return _Side(fit=fit, rise=cost - middle.cost, move=move)


def _fitted(
    solution: Solution, prior: Prior, start: FloatArray, shape: SlipFit, *, scored: bool = False
) -> SlipFit | None:
    """Fit with the noise of a solution; None where nothing can be simulated at the start."""
    tolerances = Tolerances(balance=solution.balance_error, level=solution.link_error)
    try:
        return fit_slips(
            solution.problem, prior, tolerances, parameters=start, unknowns=shape.unknowns,
            iterations=LAST_ITERATIONS if scored else _ITERATIONS, enough=NEARLY, scored=scored,
        )  # fmt: skip
    except LinAlgError:
        return None
