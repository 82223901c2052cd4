# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Least squares on a :class:`SlipProblem`: Levenberg-Marquardt with each slip's own unknowns eliminated."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import risen_level
from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction import _equations_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import BREAKAWAY, HOLDING_FORCE, LEVEL, RISE_TIME, SHAPE
from stickslip_ros.monitoring.friction.slip_equations import NormalEquations, Point, Slopes
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

_STEP = 1e-4  # difference of a logarithm for a slope, 1
_LONGEST_STEP = 0.7  # change of a logarithm by an iteration, 1: at most
_ATTEMPTS = 8  # dampings tried in an iteration, 1
_ENOUGH_OF_OWN = 0.02  # gain of an iteration on the slips' own unknowns alone, of the cost
_LEAST = 1e-12  # addition to the diagonal of normal equations, of their trace
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
class SlipFit:
    """Where a fit ended.

    Attributes
    ----------
    parameters : logarithms, shape (p,). unknowns : of each slip, shape (slips, 3).
    kinetic : Coulomb friction, and load where both directions occur; offsets by speed where forces are unknown.
    information, gradient : of the data on parameters and kinetic together, shapes (p + k, p + k) and (p + k,).
    scores : each slip's share of the gradient, shape (slips, p + k); their scatter shows what the errors assumed hide.
    bias_sensitivity : gradient by a systematic discrepancy of one slip distance in each part of the slips, shape
        (parts, p + k). Information, gradient, scores and this are empty unless `scored`.
    residuals : of the observations in standard deviations, shape (m,). misfits : of the balance [N·m], shape (slips,).
    link_misfits : of the logarithm of the level about Eq. (6), shape (slips,).
    cost : sum of squares, robust. velocities : at the nodes. found : of each slip, columns of the windows' kernel.
    """

    parameters: FloatArray
    unknowns: FloatArray
    kinetic: FloatArray
    information: FloatArray
    gradient: FloatArray
    scores: FloatArray
    bias_sensitivity: FloatArray
    residuals: FloatArray
    misfits: FloatArray
    link_misfits: FloatArray
    cost: float
    velocities: FloatArray
    found: FloatArray


class _Fit:
    """The problem with its prior and tolerances: residuals and their slopes."""

    def __init__(self, problem: SlipProblem, prior: Prior, tolerances: Tolerances) -> None:
        self.problem, self.prior = problem, prior
        self.free = [k for k in range(len(prior.mean)) if prior.information[k, k] < _FIXED**-2]
        self.columns = len(prior.mean) + problem.balance.shape[1]
        # Where the slip before is unknown, the Stribeck fraction left by it is anything from 0 to 1.
        share = risen_level(0.0, 1.0, problem.dwells, math.exp(prior.mean[RISE_TIME]))
        unknown = np.hypot(0.5 * np.log(share), min(tolerances.level, 1.0))
        linked = problem.noise.linked.copy()
        linked[0] = problem.before is not None
        # The kernel's columns.
        self.slips = np.stack(
            [
                problem.rests, problem.rest_errors, problem.rests_begin, problem.breakaways, problem.durations,
                problem.dwells, problem.last_times, problem.directions, problem.noise.usable / tolerances.balance,
                np.where(linked, tolerances.level, unknown), linked,
            ],
            axis=1,
        )  # fmt: skip
        self._before = np.array(problem.before or (0.0, 0.0))
        self._scale = problem.noise.counted / problem.noise.errors

    def evaluate(self, parameters: FloatArray, unknowns: FloatArray, kinetic: FloatArray) -> Point:
        problem = self.problem
        positions, velocities, found = problem.simulate(parameters, unknowns)
        observed, balance, links = np.empty(len(problem.observed)), np.empty(problem.count), np.empty(problem.count)
        ties = np.empty((problem.count, kernel.TIES))
        off = parameters - self.prior.mean
        cost = float(off @ self.prior.information @ off) + kernel.measure(
            parameters, unknowns, kinetic, positions, found, self._before, self.slips, problem.balance,
            problem.noise.targets, self._scale, problem.observed, observed, balance, links, ties,
        )  # fmt: skip
        return Point(
            parameters, unknowns, kinetic, observed, balance, links, ties, found, velocities,
            cost if math.isfinite(cost) else math.inf,
        )  # fmt: skip

    def best_kinetic(self, unknowns: FloatArray, found: FloatArray) -> FloatArray:
        """Kinetic friction that balances most breakaways: least absolute deviations, by reweighting."""
        problem = self.problem
        target = found[:, HOLDING_FORCE] - np.exp(unknowns[:, LEVEL])
        weights = problem.noise.usable.astype(float)
        kinetic = np.zeros(problem.balance.shape[1])
        for _ in range(10):
            weighted = problem.balance * weights[:, None]
            products = weighted.T @ problem.balance
            # Of a speed at which no slip is usable nothing is known.
            products += _LEAST * np.trace(products) * np.eye(len(products))
            kinetic = np.linalg.solve(products, weighted.T @ target)
            misfit = np.abs(target - problem.balance @ kinetic)
            weights = problem.noise.usable / np.maximum(misfit, 1e-3 * np.median(misfit) + TINY)
            weights /= weights.max()
        return kinetic

    def slopes(self, point: Point, active: Collection[int]) -> Slopes:
        """Slopes of the residuals by the active parameters, and by each slip's unknowns; by others they are zero."""
        problem, count = self.problem, self.problem.count
        moving = np.array([k for k in active if not len(SHAPE) <= k < PARAMETERS], dtype=np.int64)
        steps = np.empty((len(moving) + 2, count))
        steps[:-2], steps[-2], steps[-1] = _STEP, 1e-4 * problem.durations, 1e-3
        parameters = np.repeat(point.parameters[None], len(steps), axis=0)
        unknowns = np.repeat(point.unknowns[None], len(steps), axis=0)
        parameters[np.arange(len(moving)), moving] += _STEP
        for row, k in ((-2, BREAKAWAY), (-1, LEVEL)):
            unknowns[row, :, k] += steps[row]
        positions, _, found = problem.simulate_variants(parameters, unknowns)
        is_active = np.zeros(len(point.parameters), dtype=bool)
        is_active[list(active)] = True
        slopes = Slopes(
            moving=moving,
            terms=np.empty((len(steps) + 2, len(problem.observed))),
            by_shared=np.zeros((2, count, self.columns)),
            by_own=np.zeros((3, count, kernel.UNKNOWNS)),
        )
        kernel.fill_slopes(
            positions, found, steps, moving, is_active, point.unknowns, problem.stiffness(point.parameters), self.slips,
            problem.balance, problem.noise.targets, self._scale, problem.observed, problem.observation_edges,
            point.observed, point.found, point.ties, slopes.terms, slopes.by_shared, slopes.by_own,
        )  # fmt: skip
        return slopes

    def equations(self, point: Point, slopes: Slopes) -> NormalEquations:
        return NormalEquations.assemble(self.problem, self.slips, point, slopes)

    def result(self, point: Point, *, scored: bool) -> SlipFit:
        information = gradient = scores = bias_sensitivity = np.empty((0, self.columns))
        if scored:
            slopes = self.slopes(point, self.free)
            information, gradient, by_parameters, _ = self.equations(point, slopes).eliminate(0.0)
            scores, bias_sensitivity = NormalEquations.shares(self.problem, point, slopes, by_parameters)
        held = point.found[:, HOLDING_FORCE] - np.exp(point.unknowns[:, LEVEL])
        return SlipFit(
            parameters=point.parameters,
            unknowns=point.unknowns,
            kinetic=point.kinetic,
            information=information,
            gradient=gradient,
            scores=scores,
            bias_sensitivity=bias_sensitivity,
            residuals=point.observed,
            misfits=np.asarray(held - self.problem.balance @ point.kinetic),
            link_misfits=point.unknowns[:, LEVEL] - point.ties[:, kernel.EXPECTED],
            cost=point.cost,
            velocities=point.velocities,
            found=point.found,
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
    weight = np.zeros((fit.columns, fit.columns))
    weight[:size, :size] = prior.information
    damping = 1e-3
    for _ in range(iterations):
        if problem.budget.spent:
            break
        equations = fit.equations(point, fit.slopes(point, fit.free))
        pull = np.zeros(fit.columns)
        pull[:size] = prior.information @ (prior.mean - point.parameters)
        before = point
        for _ in range(_ATTEMPTS):
            try:
                reduced, gradient, by_parameters, by_slope = equations.eliminate(damping)
                full = reduced + weight
                full += damping * np.diag(np.diag(full)) + 1e-14 * np.trace(full) * np.eye(fit.columns)
                step = np.linalg.solve(full, gradient + pull)
            except LinAlgError:
                damping = max(damping, 1e-6) * 10.0
                continue
            step *= min(1.0, _LONGEST_STEP / max(float(np.max(np.abs(step[:size]))), TINY))
            own = (by_slope - by_parameters @ step).reshape(-1, kernel.UNKNOWNS)
            candidate = fit.evaluate(
                np.clip(point.parameters + step[:size], prior.lower, prior.upper),
                _moved(problem, point.unknowns, own),
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
    return fit.result(point, scored=scored)


def fit_at_fixed_parameters(
    problem: SlipProblem,
    tolerances: Tolerances,
    *,
    parameters: FloatArray,
    kinetic: FloatArray,
    unknowns: FloatArray,
    iterations: int = 8,
) -> SlipFit:
    """Fit the slips' own unknowns at fixed parameters; the result has the gradient by the parameters.

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
        equations = fit.equations(point, fit.slopes(point, active=()))
        before = point.cost
        while damping < 1.0:
            own = equations.eliminate(damping)[3].reshape(-1, kernel.UNKNOWNS)
            candidate = fit.evaluate(parameters, _moved(problem, point.unknowns, own), kinetic)
            if candidate.cost < point.cost:
                point = candidate
                break
            damping *= 10.0
        damping = max(damping / 10.0, 1e-9)
        if before - point.cost < _ENOUGH_OF_OWN * max(1.0, point.cost):
            break
    return fit.result(point, scored=True)


def _moved(problem: SlipProblem, unknowns: FloatArray, step: FloatArray) -> FloatArray:
    """The unknowns after a step, each no further than where the equations hold."""
    limits = np.stack([4.0 * problem.rest_errors, 0.1 * problem.durations, np.full(problem.count, 0.7)], axis=1)
    moved = unknowns + np.clip(step, -limits, limits)
    latest = problem.last_times - 0.2 * problem.durations
    moved[:, BREAKAWAY] = np.clip(moved[:, BREAKAWAY], problem.first_times, latest)
    return moved
