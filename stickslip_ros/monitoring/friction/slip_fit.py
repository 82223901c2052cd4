# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Least squares on a :class:`SlipProblem`: Levenberg-Marquardt with each slip's own unknowns eliminated.

The unknowns of the slips form a band in the matrix of the Gauss-Newton equations.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import risen_level
from stickslip_ros.monitoring.friction import _equations_kernel as kernel
from stickslip_ros.monitoring.friction._equations_kernel import HUBER, LARGEST_RESIDUAL, UNKNOWNS
from stickslip_ros.monitoring.friction._window_kernel import (
    BREAKAWAY,
    HOLDING_FORCE,
    LEVEL,
    POSITION,
    RISE_TIME,
    SHAPE,
    WENT_ON,
)
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

_STEP = 1e-4  # difference of a logarithm for a slope, 1
_LONGEST_STEP = 0.7  # change of a logarithm by an iteration, 1: at most
_ATTEMPTS = 8  # dampings tried in an iteration, 1
_ENOUGH_OF_OWN = 0.02  # gain of an iteration on the slips' own unknowns alone, of the cost
_FIXED = 1e-5  # prior standard deviation of a logarithm, 1: a narrower prior holds a parameter


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Normal prior, with bounds.

    Attributes
    ----------
    mean, lower, upper : of the parameters' logarithms, shape (p,).
    information : inverse of the covariance, shape (p, p).
    """

    mean: FloatArray
    information: FloatArray
    lower: FloatArray
    upper: FloatArray

    @staticmethod
    def of(mean: FloatArray, deviation: FloatArray, lower: FloatArray, upper: FloatArray) -> Prior:
        """Independent parameters of given standard deviations, shape (p,)."""
        return Prior(mean=mean, information=np.diag(1.0 / deviation**2), lower=lower, upper=upper)


@dataclass(frozen=True, kw_only=True)
class Tolerances:
    """How far the ties between the slips may stretch.

    Attributes
    ----------
    balance : standard deviation of the kinetic friction from slip to slip [N·m]; infinite: it is free.
    level : of the logarithm of the level at breakaway about Eq. (6); infinite: it is free.
    """

    balance: float = math.inf
    level: float = math.inf


@dataclass(frozen=True, kw_only=True)
class ScoredFit:
    """What a fit leaves over, and what it rests on, the slips' own unknowns eliminated; of whatever model.

    Attributes
    ----------
    residuals : of the observations in standard deviations, shape (m,).
    information, gradient : of the data on parameters and kinetic together, shapes (p + k, p + k) and (p + k,).
    scores : each slip's share of the gradient, shape (slips, p + k); their scatter shows what the errors assumed hide.
    bias_sensitivity : gradient by a systematic discrepancy of one slip distance in each part of the slips, shape
        (parts, p + k). Information, gradient, scores and this are empty unless the fit is scored.
    """

    residuals: FloatArray
    information: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    gradient: FloatArray = field(default_factory=lambda: np.empty(0))
    scores: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    bias_sensitivity: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


@dataclass(frozen=True, kw_only=True)
class SlipFit(ScoredFit):
    """A point of a fit, at the end the one where it ended.

    Attributes
    ----------
    parameters : logarithms, shape (p,). unknowns : of each slip, shape (slips, 3).
    kinetic : Coulomb friction, and load where both directions occur; offsets by speed where forces are unknown.
    misfits : of the balance [N·m], shape (slips,).
    link_misfits : of the logarithm of the level about Eq. (6), shape (slips,).
    balance, links : these two in their tolerances. ties : columns of the equations' kernel.
    cost : sum of squares, robust. velocities : at the nodes. found : of each slip, columns of the windows' kernel.
    """

    parameters: FloatArray
    unknowns: FloatArray
    kinetic: FloatArray
    misfits: FloatArray
    link_misfits: FloatArray
    balance: FloatArray
    links: FloatArray
    ties: FloatArray
    cost: float
    velocities: FloatArray
    found: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Equations:
    """Equations for the steps of parameters (with kinetic friction) and of the slips' unknowns, at a point.

    Attributes
    ----------
    moving : parameters by which the slopes of the observations are not zero.
    slopes, by_shared, by_own : slopes of the residuals, as :func:`._equations_kernel.fill_slopes` has them.
    matrix, gradient : of parameters and kinetic friction, shapes (p + k, p + k) and (p + k,).
    mixed, band, step : of the slips' unknowns, 3 each, with these; band of their matrix; and their gradient.
    """

    moving: NDArray[np.int64]
    slopes: FloatArray
    by_shared: FloatArray
    by_own: FloatArray
    matrix: FloatArray
    gradient: FloatArray
    mixed: FloatArray
    band: FloatArray
    step: FloatArray

    def eliminate(self, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Schur complement and gradient of the parameters; solutions for the unknowns of ``mixed`` and ``step``.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the unknowns' part of the matrix is not positive definite.
        """
        definite, matrix, gradient, solved = kernel.eliminate(
            self.matrix, self.gradient, self.mixed, self.band, self.step, damping
        )
        if not definite:
            raise LinAlgError("the equations of the slips are not positive definite")
        return matrix, gradient, solved[:, :-1], solved[:, -1]


class _Fit:
    """The problem with its prior and tolerances: residuals and their slopes."""

    def __init__(self, problem: SlipProblem, prior: Prior, tolerances: Tolerances) -> None:
        self.problem, self.prior, data = problem, prior, problem.data
        self.free = [k for k in range(len(prior.mean)) if prior.information[k, k] < _FIXED**-2]
        self.columns = len(prior.mean) + problem.balance.shape[1]
        # Where the slip before is unknown, the Stribeck fraction left by it is anything from 0 to 1.
        share = risen_level(0.0, 1.0, data.dwells, math.exp(prior.mean[RISE_TIME]))
        unknown = np.hypot(0.5 * np.log(share), min(tolerances.level, 1.0))
        linked = problem.noise.linked.copy()
        linked[0] = problem.before is not None
        # The kernel's columns.
        self.slips = np.stack(
            [
                data.rests, data.rest_errors, data.rests_begin, data.breakaways, data.durations,
                data.dwells, data.last_times, data.directions, problem.noise.usable / tolerances.balance,
                np.where(linked, tolerances.level, unknown), linked,
            ],
            axis=1,
        )  # fmt: skip
        self._before = np.array(problem.before or (0.0, 0.0))
        self._scale = problem.noise.counted / problem.noise.errors
        # How far the equations hold, and when a slip has begun at the latest.
        self._farthest = np.stack([4.0 * data.rest_errors, 0.1 * data.durations, np.full(data.count, 0.7)], axis=1)
        self._latest = data.last_times - 0.2 * data.durations

    def moved(self, unknowns: FloatArray, step: FloatArray) -> FloatArray:
        """The unknowns after a step, each no further than where the equations hold."""
        moved = unknowns + np.clip(step, -self._farthest, self._farthest)
        moved[:, BREAKAWAY] = np.clip(moved[:, BREAKAWAY], self.problem.data.first_times, self._latest)
        return moved

    def evaluate(self, parameters: FloatArray, unknowns: FloatArray, kinetic: FloatArray) -> SlipFit:
        problem, data = self.problem, self.problem.data
        positions, velocities, found = problem.simulate(parameters, unknowns)
        observed, balance, links = np.empty(len(data.observed)), np.empty(data.count), np.empty(data.count)
        ties = np.empty((data.count, kernel.TIES))
        off = parameters - self.prior.mean
        cost = float(off @ self.prior.information @ off) + kernel.measure(
            parameters, unknowns, kinetic, positions, found, self._before, self.slips, problem.balance,
            problem.noise.targets, self._scale, data.observed, observed, balance, links, ties,
        )  # fmt: skip
        return SlipFit(
            parameters=parameters,
            unknowns=unknowns,
            kinetic=kinetic,
            residuals=np.clip(observed, -LARGEST_RESIDUAL, LARGEST_RESIDUAL),
            misfits=found[:, HOLDING_FORCE] - np.exp(unknowns[:, LEVEL]) - problem.balance @ kinetic,
            link_misfits=unknowns[:, LEVEL] - ties[:, kernel.EXPECTED],
            balance=balance,
            links=links,
            ties=ties,
            cost=cost if math.isfinite(cost) else math.inf,
            velocities=velocities,
            found=found,
        )

    def best_kinetic(self, unknowns: FloatArray, found: FloatArray) -> FloatArray:
        """Kinetic friction that balances most breakaways: least absolute deviations, by reweighting."""
        problem = self.problem
        target = found[:, HOLDING_FORCE] - np.exp(unknowns[:, LEVEL])
        kinetic = np.zeros(problem.balance.shape[1])
        if not kernel.fill_kinetic(problem.balance, problem.noise.usable, target, kinetic):
            raise LinAlgError("no slip shows the kinetic friction")
        return kinetic

    def equations(self, point: SlipFit, active: Collection[int]) -> _Equations:
        """Equations by the active parameters, and by each slip's unknowns; slopes by other parameters are zero."""
        problem, data, count = self.problem, self.problem.data, self.problem.data.count
        # How static friction rises shows in a slip only where that stops and goes on.
        went_on = bool(point.found[:, WENT_ON].any())
        moving = np.array([k for k in active if went_on or not len(SHAPE) <= k < PARAMETERS], dtype=np.int64)
        steps = np.empty((len(moving) + 2, count))
        steps[:-2], steps[-2], steps[-1] = _STEP, 1e-4 * data.durations, 1e-3
        parameters = np.repeat(point.parameters[None], len(steps), axis=0)
        unknowns = np.repeat(point.unknowns[None], len(steps), axis=0)
        parameters[np.arange(len(moving)), moving] += _STEP
        for row, k in ((-2, BREAKAWAY), (-1, LEVEL)):
            unknowns[row, :, k] += steps[row]
        positions, _, found = problem.simulate_variants(parameters, unknowns)
        # Where a slip goes on that did not, or no longer does, it changes at once: its slope is that of the other side.
        crossed = found[:, :, WENT_ON] != point.found[:, WENT_ON]
        rows = np.flatnonzero(crossed.any(axis=1))
        if len(rows):
            back, _, found_back = problem.simulate_variants(
                2.0 * point.parameters - parameters[rows], 2.0 * point.unknowns - unknowns[rows]
            )
            positions[rows] = np.where(crossed[rows][:, data.slip_of_node], back, positions[rows])
            found[rows] = np.where(crossed[rows][:, :, None], found_back, found[rows])
            steps[crossed] *= -1.0
        is_active = np.zeros(len(point.parameters), dtype=bool)
        is_active[list(active)] = True
        new = _Equations(
            moving=moving,
            slopes=np.empty((len(steps) + 2, len(data.observed))),
            by_shared=np.zeros((2, count, self.columns)),
            by_own=np.zeros((3, count, UNKNOWNS)),
            matrix=np.zeros((self.columns, self.columns)),
            gradient=np.zeros(self.columns),
            mixed=np.zeros((count * UNKNOWNS, self.columns)),
            band=np.zeros((2 * UNKNOWNS, count * UNKNOWNS)),
            step=np.zeros(count * UNKNOWNS),
        )
        kernel.fill_slopes(
            positions, found, steps, moving, is_active, point.unknowns, problem.stiffness(point.parameters), self.slips,
            problem.balance, problem.noise.targets, self._scale, data.observed, data.observation_edges,
            point.residuals, point.found, point.ties, new.slopes, new.by_shared, new.by_own,
        )  # fmt: skip
        kernel.collect(
            new.slopes, data.observation_edges, moving, new.by_shared, new.by_own, point.balance, point.links,
            point.unknowns, self.slips, new.matrix, new.gradient, new.mixed, new.band, new.step,
        )  # fmt: skip
        return new

    def scored(self, point: SlipFit) -> SlipFit:
        """The point with information, gradient, scores and bias sensitivity, the slips' own unknowns eliminated."""
        problem, data, equations = self.problem, self.problem.data, self.equations(point, self.free)
        information, gradient, by_parameters, _ = equations.eliminate(0.0)
        balance, links = equations.by_shared
        own_balance, own_link, next_link = equations.by_own
        shared = len(equations.moving)
        follow = by_parameters.reshape(data.count, UNKNOWNS, -1)
        projected = -np.einsum("am,mac->mc", equations.slopes[shared:-1], follow[data.slip_of])
        projected[:, equations.moving] += equations.slopes[:shared].T
        projected *= weights(point.residuals)[:, None]
        way = (data.directions * data.distances)[data.slip_of] / problem.noise.errors
        bias_sensitivity = np.zeros((data.parts_of_slips.max() + 1, projected.shape[1]))
        np.add.at(bias_sensitivity, data.parts_of_slips, projected * way[:, None])
        scores = np.add.reduceat(projected * point.residuals[:, None], data.observation_edges[:-1], axis=0)
        projected = balance - np.einsum("na,nac->nc", own_balance, follow)
        scores += projected * (weights(point.balance) * point.balance)[:, None]
        projected = links - np.einsum("na,nac->nc", own_link, follow)
        projected[1:] -= np.einsum("na,nac->nc", next_link[:-1], follow[:-1])
        scores += projected * (weights(point.links) * point.links)[:, None]
        rest = (point.unknowns[:, POSITION] - data.rests) / data.rest_errors**2
        scores -= rest[:, None] * follow[:, POSITION]
        return replace(
            point, information=information, gradient=gradient, scores=-scores, bias_sensitivity=bias_sensitivity
        )


def fit_slips(
    problem: SlipProblem,
    prior: Prior,
    tolerances: Tolerances,
    *,
    parameters: FloatArray,
    unknowns: FloatArray,
    iterations: int = 25,
    enough: float = 1e-3,
    scored: bool = False,
) -> SlipFit:
    """Fit from a start; the start itself comes back if nothing near it is better.

    Parameters
    ----------
    parameters : logarithms, shape (p,). unknowns : of the slips, shape (slips, 3).
    iterations : at most. enough : gain of an iteration below which it stops.
    scored : whether information, scores and bias sensitivity are wanted, which take as long as an iteration.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the start cannot be simulated.
    """
    fit = _Fit(problem, prior, tolerances)
    kinetic = fit.best_kinetic(unknowns, problem.simulate(parameters, unknowns)[2])
    point = fit.evaluate(parameters, unknowns, kinetic)
    if not math.isfinite(point.cost):
        raise LinAlgError("the start of the fit cannot be simulated")
    size = len(parameters)
    damping = 1e-3
    for _ in range(iterations):
        if problem.budget.spent:
            break
        equations = fit.equations(point, fit.free)
        pull = prior.information @ (prior.mean - point.parameters)
        before = point
        for _ in range(_ATTEMPTS):
            definite, step, own = kernel.damped_step(
                equations.matrix, equations.gradient, equations.mixed, equations.band, equations.step, damping,
                prior.information, pull, point.parameters, prior.lower, prior.upper, _LONGEST_STEP,
            )  # fmt: skip
            if not definite:
                damping = max(damping, 1e-6) * 10.0
                continue
            candidate = fit.evaluate(
                np.clip(point.parameters + step[:size], prior.lower, prior.upper),
                fit.moved(point.unknowns, own),
                point.kinetic + step[size:],
            )
            if candidate.cost < point.cost:
                point = candidate
                break
            damping = max(damping, 1e-6) * 6.0
        if point is before:
            break
        damping = max(damping / 8.0, 1e-9)
        gain = before.cost - point.cost
        if gain < enough * max(1.0, 1e-3 * point.cost):
            break
    return fit.scored(point) if scored else point


def fit_at_fixed_parameters(
    problem: SlipProblem,
    tolerances: Tolerances,
    *,
    parameters: FloatArray,
    kinetic: FloatArray,
    unknowns: FloatArray,
    iterations: int = 8,
    scored: bool = False,
) -> SlipFit:
    """Fit the slips' own unknowns at fixed parameters.

    Parameters
    ----------
    scored : whether the result is to have information, gradient and scores by the parameters.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the slips cannot be simulated.
    """
    size = len(parameters)
    held = Prior(mean=parameters, information=np.eye(size), lower=parameters, upper=parameters)
    fit = _Fit(problem, held, tolerances)
    point = fit.evaluate(parameters, unknowns, kinetic)
    if not math.isfinite(point.cost):
        raise LinAlgError("the slips cannot be simulated")
    damping = 1e-4
    for _ in range(iterations):
        equations = fit.equations(point, active=())
        before = point.cost
        while damping < 1.0:
            own = equations.eliminate(damping)[3].reshape(-1, UNKNOWNS)
            candidate = fit.evaluate(parameters, fit.moved(point.unknowns, own), kinetic)
            if candidate.cost < point.cost:
                point = candidate
                break
            damping *= 10.0
        damping = max(damping / 10.0, 1e-9)
        if before - point.cost < _ENOUGH_OF_OWN * max(1.0, point.cost):
            break
    return fit.scored(point) if scored else point


def robust(residuals: FloatArray) -> float:
    """Sum of squares, linear beyond the Huber limit."""
    size = np.minimum(np.abs(residuals), LARGEST_RESIDUAL)
    return float(np.where(size < HUBER, size * size, 2.0 * HUBER * size - HUBER**2).sum())


def weights(residuals: FloatArray) -> FloatArray:
    """Weights that make squares of them :func:`robust`."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(residuals), 1e-12))
