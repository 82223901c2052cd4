# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction behind many slips, from a guess of their shape: all parameters together.

Every slip's own breakaway and level with that shape; then all parameters, while the ties between the slips (Eq. (6)
and the balance of forces) are drawn tight. Tight from the beginning, the least squares have many wrong valleys.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import risen_level
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
from stickslip_ros.monitoring.friction.slip_fit import Prior, SlipFit, Tolerances, fit_slips
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

FITS = 1.2  # mean square of residuals, 1: that of a model that explains slips; noise makes 1, jitter a little more
GOOD = 1.3  # mean square of residuals, 1: with less the search ends
_NEARLY_GOOD = 2.0  # mean square of residuals, 1: with less a fit may come to be good
# Mean square of a slip's residuals, 1, and its ratio to the median of the slips, 1: a slip with more is set aside.
OUTLIER, _OUTLIER_SHARE = 9.0, 25.0
USUAL_RISE_TIME = 0.3  # rise time, s: the prior mean of a joint that nothing is known of
# Tolerance of positions (of the slip distance), of balance (of the level), of levels: ever tighter.
_TIGHTENING = ((0.01, 0.2, 0.2), (0.003, 0.05, 0.05), (0.003, 0.01, 0.003), (0.0, 0.002, 3e-4))
TIGHT_LEVEL = 1e-4  # scatter of levels' logarithms about Eq. (6) in a tight fit, 1: at least
_MOST_USABLE = 0.8  # slips, of all: a fit that explains so many is accepted without a search
_LEAST_BALANCE = 1e-4  # error of the balance of forces, of the level: what rounding makes
_FINAL = 3  # fits after the tightening, 1
_LOOSE_ROUNDS = 5  # rounds of a loose fit, 1
LEAST_LINK, _LARGEST_LINK = 1e-3, 0.3  # scatter of levels' logarithms about Eq. (6), 1: no model is better
_ITERATIONS = 20  # iterations of a stage, 1
_ROUND = 40  # iterations of a stage of a fit that may come to be good, 1
LAST_ITERATIONS = 100  # iterations of the last fit, 1: where all ties are tight, valleys are long, flat and bent
ROUGHLY, NEARLY = 0.1, 0.003  # gain of an iteration, 1: with less a stage ends; the last ones
FIXED_STD = 1e-6  # prior standard deviation of a logarithm that a fit must not change, 1
_RISE_TIME_SPREAD = 2.0  # prior standard deviation of the rise time's logarithm, 1
_LEAST_VISCOUS = 0.02  # viscous friction, of the inertia over a slip's duration: a damping ratio of 0.2 %
_LEAST_STRIBECK_VELOCITY = 2e-3  # Stribeck velocity, of the usual speed of a slip: at least
_LEAST_LAG = 1e-4  # lag, of a slip's duration: at least
_LEAST_SHARE = 1e-9  # level at a breakaway, of F_s∞: at least, as a fit may leave a slip no rest before it
WIDE = 3.0  # prior standard deviation of a logarithm that nothing is known of, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """A fit of all slips.

    Attributes
    ----------
    problem : of the slips, with the noise of the fit. fit, prior : with its prior.
    balance_error : scatter of the kinetic friction from slip to slip that was found [N·m].
    link_error : of the logarithm of the level at breakaway about Eq. (6).
    """

    problem: SlipProblem
    fit: SlipFit
    prior: Prior
    balance_error: float
    link_error: float

    @property
    def mean_square(self) -> float:
        """Of the residuals; about 1 if the errors are what they are taken for."""
        return _mean_square(self.fit)

    @property
    def friction_scatter(self) -> float:
        """Scatter of the kinetic friction from slip to slip that jitter of the time stamps does not make [N·m]."""
        return math.sqrt(max(self.balance_error**2 - _by_jitter(self.problem, self.fit) ** 2, 0.0))

    @property
    def left_over(self) -> float:
        """The tolerance as a share of a slip."""
        return self.tolerance / self.problem.data.usual_distance

    @property
    def tolerance(self) -> float:
        """Standard deviation of what the model cannot explain of the positions [rad]; 0 if it explains all."""
        return self.problem.noise.tolerance


def _mean_square(fit: SlipFit) -> float:
    return float(np.mean(fit.residuals[fit.residuals != 0.0] ** 2))


def fit_near(problem: SlipProblem, start: FloatArray, shape: SlipFit) -> Solution | None:
    """The fit next to a start, loosened if it is not as good as it should be; None if nothing can be simulated there.

    Parameters
    ----------
    start : logarithms, of shape (p,). shape : fit of the same slips, perhaps under another law, which has their levels.
    """
    solution = _fit_from(problem, start)
    if solution is not None and solution.mean_square >= GOOD:
        solution = fit_loosely(problem, solution.prior, replace(shape, parameters=start)) or solution
    return solution


def truncated_fit(problem: SlipProblem, start: FloatArray) -> Solution | None:
    """Fit of a few slips in few iterations; None if nothing near the start can be simulated."""
    return _fit_from(problem, start, patience=_ROUND)


def fit_again(problem: SlipProblem, start: FloatArray) -> Solution | None:
    """The fit next to one of other slips of the joint; None if it is not as good as a fit should be."""
    solution = _fit_from(problem, start)
    if solution is None or not solution.mean_square < GOOD:
        return None
    return solution if solution.problem.noise.usable.mean() > _MOST_USABLE else None


def _fit_from(problem: SlipProblem, start: FloatArray, patience: int = LAST_ITERATIONS) -> Solution | None:
    """The fit next to a start, as logarithms, where the shape is known; as of :func:`fit_all`."""
    try:
        return fit_all(problem, start, math.exp(start[STRIBECK]), _TIGHTENING[1:], patience)
    except LinAlgError:
        return None


def fit_all(
    problem: SlipProblem,
    shape: FloatArray,
    level: float,
    tightening: tuple[tuple[float, float, float], ...] = _TIGHTENING,
    patience: int = LAST_ITERATIONS,
) -> Solution:
    """Fit everything, from the logarithms of a shape and the level [N·m] that goes with it.

    Parameters
    ----------
    patience : iterations of each of the last stages, where the fit is nearly good.
    """
    distance = problem.data.usual_distance
    lower, upper = bounds(problem, math.exp(shape[INERTIA]))
    problem, fit, parameters = _breakaways(problem, shape, level)
    mean = parameters.copy()
    deviation = np.concatenate([np.full(PARAMETERS, WIDE), problem.term_stds])
    usual = {RISE_TIME: (math.log(USUAL_RISE_TIME), _RISE_TIME_SPREAD)}
    for index, (center, spread) in {**usual, **problem.model.known}.items():
        mean[index], deviation[index] = center, spread
    prior = Prior.of(mean, deviation, lower, upper)
    parameters = np.clip(parameters, lower, upper)
    level = math.exp(parameters[STRIBECK])
    for position, balance, link in tightening:
        problem = problem.weighed(fit.velocities, tolerance=position * distance)
        tolerances = Tolerances(balance=balance * level, level=link)
        fit = fit_slips(
            problem, prior, tolerances,
            parameters=parameters, unknowns=fit.unknowns, iterations=_ITERATIONS, enough=ROUGHLY,
        )  # fmt: skip
        parameters = fit.parameters
        problem = _without_outliers(problem, fit)
    for final in range(1, _FINAL + 1):
        jitter = problem.data.jitter(problem.noise, fit.residuals)
        problem = problem.weighed(fit.velocities, jitter=jitter)
        balance = balance_error(problem, fit)
        link = link_error(problem, fit, balance)
        tolerances = Tolerances(balance=balance, level=link)
        fit = fit_slips(
            problem,
            prior,
            tolerances,
            parameters=fit.parameters,
            unknowns=fit.unknowns,
            iterations=min(patience, _patience(fit)),
            enough=NEARLY if _mean_square(fit) < FITS else ROUGHLY,
            scored=final == _FINAL,
        )
        problem = _without_outliers(problem, fit)
    problem = problem.weighed(fit.velocities)
    return Solution(problem=problem, fit=fit, prior=prior, balance_error=balance, link_error=link)


def _patience(fit: SlipFit) -> int:
    """Iterations that the next of the last stages is worth."""
    if _mean_square(fit) < FITS:
        return LAST_ITERATIONS
    return _ROUND if _mean_square(fit) < _NEARLY_GOOD else _ITERATIONS


def _breakaways(problem: SlipProblem, shape: FloatArray, level: float) -> tuple[SlipProblem, SlipFit, FloatArray]:
    """Every slip's own breakaway and level for the shape as it is, and parameters that go with them.

    Earlier fits are undone: all slips that hold one slip count, and time stamps are exact.
    """
    tolerance = 0.005 * problem.data.usual_distance
    problem = problem.weighed(tolerance=tolerance, jitter=0.0, usable=problem.data.single)
    parameters = np.concatenate([shape[:PARAMETERS], problem.term_means])
    held = Prior.of(parameters, np.full(len(parameters), FIXED_STD), parameters - 1.0, parameters + 1.0)
    unknowns = problem.data.detected(level)
    fit = fit_slips(
        problem, held, Tolerances(), parameters=parameters, unknowns=unknowns, iterations=12, enough=ROUGHLY
    )
    parameters[STRIBECK], parameters[RISE_TIME] = np.log(_scan_rise_time(problem, fit))
    return problem, fit, parameters


def fit_loosely(problem: SlipProblem, prior: Prior, shape: SlipFit) -> Solution | None:
    """Fit slips that the model explains only in part: what is left over is measured and taken as error."""
    distance = problem.data.usual_distance
    try:
        problem, fit, parameters = _breakaways(problem, shape.parameters, usual_level(shape))
        parameters = np.clip(parameters, prior.lower, prior.upper)
        level = math.exp(parameters[STRIBECK])
        tolerance, balance, link = 0.01 * distance, 0.2 * level, 0.2
        for number in range(1, _LOOSE_ROUNDS + 1):
            problem = problem.weighed(fit.velocities, tolerance=tolerance)
            fit = fit_slips(
                problem, prior, Tolerances(balance=balance, level=link),
                parameters=parameters, unknowns=fit.unknowns, iterations=_ITERATIONS, scored=number == _LOOSE_ROUNDS,
            )  # fmt: skip
            parameters = fit.parameters
            problem = _without_outliers(problem, fit)
            used = problem.noise.counted
            tolerance = float(np.sqrt(np.mean((fit.residuals * problem.noise.errors)[used] ** 2)))
            balance = min(balance_error(problem, fit), level)
            link = float(np.clip(scatter_of(fit.link_misfits[problem.noise.linked]), LEAST_LINK, _LARGEST_LINK))
    except LinAlgError:
        return None
    problem = problem.weighed(fit.velocities, tolerance=tolerance)
    return Solution(problem=problem, fit=fit, prior=prior, balance_error=balance, link_error=link)


def bounds(problem: SlipProblem, inertia: float) -> tuple[FloatArray, FloatArray]:
    """Lower and upper bounds of the parameters' logarithms, wide enough for whatever slips as these do."""
    data = problem.data
    duration, dwell = data.usual_duration, data.usual_dwell
    lower = np.array([-math.inf] * PARAMETERS + [term.lower for term in problem.term_parameters.values()])
    upper = np.array([math.inf] * PARAMETERS + [term.upper for term in problem.term_parameters.values()])
    mass = 1.0 if data.normalised else inertia
    # Not so little that it makes no difference any more: what makes none has no error that could be told.
    lower[VISCOUS], upper[VISCOUS] = math.log(_LEAST_VISCOUS * mass / duration), math.log(1e3 * mass / duration)
    lower[STRIBECK_VELOCITY] = math.log(_LEAST_STRIBECK_VELOCITY * data.usual_speed)
    upper[STRIBECK_VELOCITY] = math.log(30.0 * data.usual_speed)
    lower[LAG], upper[LAG] = math.log(_LEAST_LAG * duration), math.log(duration)
    lower[RISE_TIME], upper[RISE_TIME] = math.log(1e-3 * dwell), math.log(300.0 * dwell)
    return lower, upper


def usual_level(shape: SlipFit) -> float:
    """Median of the slips' levels [N·m]."""
    return math.exp(float(np.median(shape.unknowns[:, LEVEL])))


def scatter_of(values: FloatArray) -> float:
    """Standard deviation, robust; 0 of nothing."""
    return 1.48 * float(np.median(np.abs(values))) if len(values) else 0.0


def balance_error(problem: SlipProblem, fit: SlipFit) -> float:
    """Scatter of the kinetic friction from slip to slip [N·m], at least what rounding makes."""
    used = fit.misfits[problem.noise.usable]
    freedom = len(used) - problem.balance.shape[1] - 1
    least = math.hypot(_LEAST_BALANCE * math.exp(fit.parameters[STRIBECK]), _by_jitter(problem, fit))
    if freedom < 1:
        return 100.0 * least
    return max(scatter_of(used) * math.sqrt(len(used) / freedom), least)


def _by_jitter(problem: SlipProblem, fit: SlipFit) -> float:
    """Error of the force at a breakaway that jitter of the time stamps makes [N·m]."""
    return problem.noise.jitter * problem.loading_rate(fit.parameters)


def link_error(problem: SlipProblem, fit: SlipFit, balance: float) -> float:
    """Scatter of the levels' logarithms about Eq. (6), at least that of the kinetic friction [N·m].

    Friction that varies from slip to slip does so at rest as well; static friction may vary alone.
    """
    least = max(balance / math.exp(fit.parameters[STRIBECK]), TIGHT_LEVEL)
    return min(max(scatter_of(fit.link_misfits[problem.noise.linked & problem.noise.usable]), least), _LARGEST_LINK)


def _without_outliers(problem: SlipProblem, fit: SlipFit) -> SlipProblem:
    """The problem without slips that nothing explains, as those with an unseen rest: they would bend the others."""
    data = problem.data
    squares = np.bincount(data.slip_of, fit.residuals**2, data.count) / np.bincount(data.slip_of)
    usual = float(np.median(squares[problem.noise.usable]))
    outliers = squares > max(OUTLIER, _OUTLIER_SHARE * usual)
    if outliers.any() and problem.noise.usable.sum() - outliers.sum() >= 2:
        return problem.without(outliers)
    return problem


def _scan_rise_time(problem: SlipProblem, fit: SlipFit) -> tuple[float, float]:
    """Stribeck friction and rise time that best explain the levels of the slips and the forces at breakaway."""
    data = problem.data
    levels = np.exp(fit.unknowns[:, LEVEL])
    dwell = data.usual_dwell
    usable = problem.noise.usable
    scale = float(np.median(levels))
    best, least = (scale, dwell), math.inf
    for rise_time in dwell * np.geomspace(0.02, 50.0, 24):
        shares = np.empty(data.count)
        stribeck_fraction = 1.0
        for slip in range(data.count):
            began = fit.found[slip - 1, kernel.ARREST] if problem.noise.linked[slip] else data.rests_begin[slip]
            stribeck_fraction = stribeck_fraction if problem.noise.linked[slip] else 1.0
            rest = max(float(fit.unknowns[slip, 1]) - float(began), 0.0)
            shares[slip] = max(risen_level(stribeck_fraction, 1.0, rest, rise_time), _LEAST_SHARE)
            stribeck_fraction = shares[slip] * float(fit.found[slip, kernel.STRIBECK_FRACTION])
        stribeck = float(np.median((levels / shares)[usable]))
        kinetic = fit.found[:, kernel.HOLDING_FORCE] - stribeck * shares
        offsets = np.linalg.lstsq(problem.balance[usable], kinetic[usable], rcond=None)[0]
        misfit = np.minimum(np.abs(kinetic - problem.balance @ offsets)[usable] / scale, 0.5).mean()
        misfit += np.minimum(np.abs(np.log(levels / (stribeck * shares)))[usable], 0.5).mean()
        misfit += 1e-3 * abs(math.log(rise_time / USUAL_RISE_TIME))
        if misfit < least:
            best, least = (stribeck, float(rise_time)), float(misfit)
    return best
