# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Standard errors of a fit that hold where the model does not: what the residuals show beside the sensor's noise.

Six things widen the errors of least squares. That a controller acts on samples, in steps, as much as its samples are
apart, and late. Gains and effort that differ in their stiffness. Static friction that may have risen by then, or not.
Slips that nothing explains, and residuals larger than they should be.
The scatter of what each slip says about the parameters, which shows errors that differ from slip to slip. And a
residual that repeats from slip to slip: more slips then say the same wrong thing, and no scatter shows it. Such a
pattern is taken for what is seen of a discrepancy between model and machine, as large in what the fit could absorb as
in what it left over, and larger where it is more than chance makes (after Kennedy and O'Hagan, "Bayesian calibration of
computer models", Journal of the Royal Statistical Society B 63, 2001).
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction._window_kernel import INERTIA, LEVEL, RISE_TIME, STRIBECK, VISCOUS
from stickslip_ros.monitoring.friction.late_controller import LATE, Delay
from stickslip_ros.monitoring.friction.slip_data import NoiseModel, SlipData
from stickslip_ros.monitoring.friction.slip_fit import Prior, ScoredFit, SlipFit
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import OUTLIER
from stickslip_ros.monitoring.friction.slip_windows import stiffness_difference
from stickslip_ros.monitoring.friction.trend import Trend
from stickslip_ros.monitoring.samples import FloatArray

_FEW = 8  # slips beyond the number of parameters, 1: with fewer their scatter says nothing
_TOLERATED, _PER_MISFIT = 1.05, 20.0  # mean square of residuals up to which errors stay, 1; factor on what is beyond, 1
_RISEN, _LONGER = 0.1, 2.0  # rise time that has long passed, of the usual rest; a longer rest, of the usual one
_MORE = 0.1  # difference of a level's logarithm, 1: with more F_s∞ is too small for the level
_ANY = 1.5  # standard error of a logarithm, 1: with more its value is open
_CONFIGURED = 0.5  # information of a prior, 1: with more the rise time is configured
OF_HOLDING = 1.0 / 24.0  # gain that an oscillation loses by a force that is held for Δt, of (ω Δt)²
_HALF_A_STEP = 0.5  # error of the force, of what a sample interval adds to the force
# Excess of a mean square, standard deviations: the right law comes to 4, with hundreds of residuals in each part.
_SURE = 6.0
# What a law that is not the joint's leaves over is smaller than what its parameters take up, for that is smooth: in the
# median so many times, on machines with drag, with two masses, and with Stribeck curves of exponents from ½ to 4.
_WRONG_LAW = 10.0  # factor on the errors of a law that does not fit, 1
_ABSORBED = 8  # parts of a slip that a fit absorbs, 1: as many freedoms it has in each


class Observed(Protocol):
    """Slips, and what each observation of them says; of whatever model."""

    data: SlipData
    noise: NoiseModel


def covariance_of(information: FloatArray, prior: Prior) -> FloatArray:
    """Covariance of parameters and kinetic friction, from the data's information and the prior's."""
    total = information.copy()
    size = len(prior.mean)
    total[:size, :size] += prior.information
    # Scaled, because forces and logarithms differ by orders of magnitude.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), TINY))
    scales = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(total * scales, rcond=1e-13, hermitian=True) * scales)


def robust_covariance(problem: SlipProblem, fit: SlipFit, prior: Prior, late: float | None) -> FloatArray:
    """Robust covariance: that of least squares, inflated by misfit, scatter and discrepancy; shape (p + k, p + k).

    Parameters
    ----------
    late : root mean square of a controller's delay that is not fitted [sample intervals]; by its prior if None.
    """
    narrow = covariance_of(fit.information, prior)
    return np.asarray(
        covariance_by_residuals(problem, fit, prior)
        + _by_sampling(problem, fit, LATE if late is None else late)
        + _by_steps(problem, fit, narrow)
        + _by_trend(problem, fit)
        + _by_effort(problem, fit)
        + _by_unidentified_rise(problem, fit, prior)
    )


def covariance_by_residuals(problem: Observed, fit: ScoredFit, prior: Prior) -> FloatArray:
    """Covariance of least squares, inflated by misfit, scatter from slip to slip and what repeats."""
    narrow = covariance_of(fit.information, prior)
    mean_square = float(np.mean(fit.residuals[problem.noise.counted] ** 2)) if problem.noise.usable.any() else 1.0
    aside = 1.0 - float(problem.noise.usable.mean())
    covariance = narrow * (1.0 + _PER_MISFIT * max(mean_square - _TOLERATED, 0.0)) * (1.0 + OUTLIER * aside)
    used = fit.scores[problem.noise.usable]
    freedom = len(used) - covariance.shape[1]
    if freedom >= _FEW:
        seen = covariance @ (used.T @ used * (len(used) / freedom)) @ covariance
        factors = np.sqrt(np.maximum(1.0, np.diag(seen) / np.maximum(np.diag(covariance), TINY)))
        covariance = covariance * np.outer(factors, factors)
    return np.asarray(covariance + _by_discrepancy(problem, fit, narrow))


def _by_sampling(problem: SlipProblem, fit: SlipFit, late: float) -> FloatArray:
    """Covariance that a controller causes which acts on samples, holds its force, and acts late.

    The force at breakaway is known to half of what a sample interval Δt adds; an effort may come late. A delay τ is
    taken off to the first order at most, which leaves (ω τ)²/2, and a force that is held (ω Δt)²/24. A delay that is
    not fitted is inertia of −k_v τ; its part of viscous friction is reported with that, see :mod:`.late_controller`,
    and that of a late effort with :class:`~stickslip_ros.monitoring.drive.DriveGains`.
    """
    size, columns = len(fit.parameters), fit.information.shape[0]
    variances = np.zeros(columns)
    if not problem.data.normalised:
        angle = problem.natural_frequency(fit.parameters) * problem.data.sample_interval
        variances[:PARAMETERS] = ((0.5 * late**2 + OF_HOLDING) * angle**2) ** 2
        intervals = _HALF_A_STEP if problem.may_be_late else late
        variances[size] = (intervals * problem.loading_rate(fit.parameters) * problem.data.sample_interval) ** 2
    if problem.may_be_late and problem.model.term(Delay) is None:
        lighter = late * problem.data.sample_interval * problem.latest_gains[1]
        variances[INERTIA] += (lighter / math.exp(float(fit.parameters[INERTIA]))) ** 2
    return np.diag(variances)


def _by_steps(problem: SlipProblem, fit: SlipFit, covariance: FloatArray) -> FloatArray:
    """Covariance of what a force that grows in steps makes of the parameters: it may begin a slip with some surplus.

    A slip that begins so is quicker than one that begins with the forces in balance, by as much in every slip; what
    that does to the parameters is what it does to the residuals in each part of the slips. A controller that is seen to
    act late is known to act in steps; of another it is not known.
    """
    data = problem.data
    size = fit.information.shape[0]
    if problem.model.term(Delay) is None or not problem.noise.usable.any():
        return np.zeros((size, size))
    surplus = _HALF_A_STEP * data.sample_interval * problem.loading_rates(fit.parameters)
    balanced, quicker = (problem.simulate(fit.parameters, fit.unknowns, one)[0] for one in (None, surplus))
    ways = (quicker - balanced)[data.observed] / (data.directions * data.distances)[data.slip_of]
    used = problem.noise.counted & np.isfinite(ways)
    parts, count = data.parts_of_slips[used], len(fit.bias_sensitivity)
    mean = np.bincount(parts, ways[used], count) / np.maximum(np.bincount(parts, minlength=count), 1)
    moved = covariance @ fit.bias_sensitivity.T @ mean
    return np.asarray(np.outer(moved, moved))


def _by_trend(problem: SlipProblem, fit: SlipFit) -> FloatArray:
    """Covariance of what a trend of viscous friction unlike that of the Stribeck friction makes of the former."""
    variances = np.zeros(fit.information.shape[0])
    if problem.model.term(Trend) is not None:
        variances[VISCOUS] = float(fit.parameters[problem.column["trend"]] ** 2 * np.mean(problem.data.since**2))
    return np.diag(variances)


def _by_effort(problem: SlipProblem, fit: SlipFit) -> FloatArray:
    """Covariance of a scale of all forces that is as uncertain as gains and effort differ in their stiffness.

    Slips show friction and inertia in proportion to the gains: M, F_s and the kinetic friction to k_p, F_v + k_v too.
    """
    ratio, error = stiffness_difference(problem.data.windows)
    moves = np.concatenate([np.zeros(len(fit.parameters)), fit.kinetic])
    moves[[INERTIA, STRIBECK]] = 1.0
    moves[VISCOUS] = 1.0 + problem.latest_gains[1] / math.exp(float(fit.parameters[VISCOUS]))
    return np.asarray(max(ratio**2 - error**2, 0.0) * np.outer(moves, moves))


def _by_unidentified_rise(problem: SlipProblem, fit: SlipFit, prior: Prior) -> FloatArray:
    """Covariance of F_s∞ where static friction seems to have risen before every slip, but for slips after long rests.

    Slips after rests of one length are explained by friction that has risen long before, or that rises for long from
    an arrest that leaves little of it. Slips after longer rests tell; where these do not fit, or more than F_s∞ held
    them, the explanation is the wrong one, F_s∞ can be any more than what is seen, and least squares about the one know
    nothing of the other.
    """
    variances = np.zeros(len(fit.information))
    usual = float(np.median(problem.data.dwells[problem.noise.usable])) if problem.noise.usable.any() else math.inf
    risen = fit.parameters[RISE_TIME] < math.log(_RISEN * usual)
    contradicted = np.any(problem.data.dwells[~problem.noise.usable] > _LONGER * usual)
    # What is left by a slip that was not seen is not known, and Eq. (6) ties the next one's level but loosely.
    contradicted |= np.any(fit.unknowns[problem.noise.usable, LEVEL] > fit.parameters[STRIBECK] + _MORE)
    if risen and contradicted and prior.information[RISE_TIME, RISE_TIME] < _CONFIGURED:
        variances[[STRIBECK, RISE_TIME]] = _ANY**2
    return np.diag(variances)


def _by_discrepancy(problem: Observed, fit: ScoredFit, covariance: FloatArray) -> FloatArray:
    """Covariance of what a discrepancy that repeats from slip to slip makes of the parameters."""
    count = len(fit.bias_sensitivity)
    repeats, surely = _repeating_residual(problem, fit)
    size = repeats**2 * count / max(count - _ABSORBED, 1)
    if surely:
        size *= _WRONG_LAW**2
    moved = covariance @ fit.bias_sensitivity.T
    return np.asarray(size * moved @ moved.T)


def _repeating_residual(problem: Observed, fit: ScoredFit) -> tuple[float, bool]:
    """Systematic residual, common to all slips, as a standard deviation in slip distances; whether it is no chance.

    It is the mean residual of each part of a slip that is counted, in the direction of the slip, less what the scatter
    within the part explains. Chance is what makes the means of independent residuals.
    """
    data = problem.data
    parts = data.parts_of_slips
    used = problem.noise.counted
    shares = (fit.residuals * problem.noise.errors * data.directions[data.slip_of])[used]
    shares = shares / data.distances[data.slip_of[used]]
    counts = np.bincount(parts[used])
    means = np.bincount(parts[used], shares) / np.maximum(counts, 1)
    scatter = np.bincount(parts[used], (shares - means[parts[used]]) ** 2) / np.maximum(counts - 1, 1)
    seen = counts > 1
    excess = means**2 - scatter / np.maximum(counts, 1)
    repeats = math.sqrt(max(float(excess[seen].mean()), 0.0)) if seen.any() else 0.0
    seen = (counts > 2) & (scatter > 0.0)
    freedom = int(np.count_nonzero(seen))
    squares = float((means[seen] ** 2 * counts[seen] / scatter[seen]).sum())
    return repeats, squares > freedom + _SURE * math.sqrt(2.0 * freedom)
