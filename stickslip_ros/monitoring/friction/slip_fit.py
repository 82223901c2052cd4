# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Least squares on a :class:`SlipProblem`: Levenberg-Marquardt with each slip's own unknowns eliminated."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.model._friction_law import risen_level, rising_rate
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import BREAKAWAY, LEVEL, POSITION, RISE_TIME, STRIBECK
from stickslip_ros.monitoring.friction.slip_equations import WEAK, NormalEquations, Point, robust
from stickslip_ros.monitoring.friction.slip_problem import PARAMETERS, SHAPE, UNKNOWNS, SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

_STEP = 1e-4  # of a logarithm, for differences
_LONGEST_STEP = 0.7  # of a logarithm
_ATTEMPTS = 8
_ENOUGH_OF_OWN = 0.02  # relative gain of an iteration on the slips' own unknowns alone
_LEAST = 1e-12  # of the trace of normal equations, added to their diagonal
_FIXED = 1e-5  # a prior this narrow holds a parameter
_NOTHING_LEFT = 1e-12  # of the level
_LEAST_DWELL = 1e-3  # of the detected one


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
    information : of the data on parameters and kinetic together, shape (p + k, p + k).
    scores : each slip's share of the gradient, shape (slips, p + k); their scatter shows what the errors assumed hide.
    pulls : gradient that a discrepancy of a slip's distance in each part of the slips would make, (parts, p + k).
    residuals : of the observations in standard deviations, shape (m,). misfits : of the balance [N·m], shape (slips,).
    link_misfits : of the logarithm of the level about Eq. (6), shape (slips,).
    cost : sum of squares, robust. velocities : at the nodes. found : of each slip, columns of the kernel.
    """

    parameters: FloatArray
    unknowns: FloatArray
    kinetic: FloatArray
    information: FloatArray
    scores: FloatArray
    pulls: FloatArray
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
        self.balance_weight = problem.usable / tolerances.balance
        self.free = [k for k in range(len(prior.mean)) if prior.information[k, k] < _FIXED**-2]
        self.columns = len(prior.mean) + problem.balance.shape[1]
        # Where nothing is known of the slip before, its remains are anything from none to all.
        share = risen_level(0.0, 1.0, problem.dwells, math.exp(prior.mean[RISE_TIME]))
        unknown = np.hypot(0.5 * np.log(share), min(tolerances.level, 1.0))
        self.linked = problem.linked.copy()
        self.linked[0] = problem.before is not None
        self.level_errors = np.where(self.linked, tolerances.level, unknown)

    def evaluate(self, parameters: FloatArray, unknowns: FloatArray, kinetic: FloatArray) -> Point:
        problem = self.problem
        positions, velocities, found = problem.simulate(parameters, unknowns)
        self._complete(found)
        observed = (problem.targets - positions[problem.observed]) / problem.errors * problem.weights
        misfit = found[:, kernel.HELD] - np.exp(unknowns[:, LEVEL]) - problem.balance @ kinetic
        balance = misfit * self.balance_weight
        links = (unknowns[:, LEVEL] - self._levels(parameters, unknowns, found)[0]) / self.level_errors
        rest = (unknowns[:, POSITION] - problem.rests) / problem.rest_errors
        drift = (unknowns[:, BREAKAWAY] - problem.breakaways) / problem.durations
        off = parameters - self.prior.mean
        cost = robust(observed) + robust(balance) + robust(links)
        cost += float(rest @ rest) + WEAK * float(drift @ drift) + float(off @ self.prior.information @ off)
        return Point(
            parameters, unknowns, kinetic, observed, balance, links, found, velocities,
            cost if math.isfinite(cost) else math.inf,
        )  # fmt: skip

    def _complete(self, found: FloatArray) -> None:
        """Take the window's end for that of slips which do not end in it."""
        arrests = found[..., kernel.ARREST]
        np.copyto(arrests, self.problem.last_times, where=~np.isfinite(arrests))

    def _levels(self, parameters: FloatArray, unknowns: FloatArray, found: FloatArray) -> tuple[FloatArray, ...]:
        """Logarithm of the level that Eq. (6) gives at each breakaway, and its slopes.

        By: the logarithms of F_s∞ and γ, the dwell, the logarithm of what remained of the level before.
        """
        problem = self.problem
        stribeck, rise_time = np.exp(parameters[STRIBECK]), float(np.exp(parameters[RISE_TIME]))
        arrest, remains = problem.before or (0.0, 0.0)
        began = np.where(self.linked, np.append(arrest, found[:-1, kernel.ARREST]), problem.rests_begin)
        dwell = np.maximum(unknowns[:, BREAKAWAY] - began, _LEAST_DWELL * problem.dwells)
        share = risen_level(0.0, 1.0, dwell, rise_time)
        steepness = rising_rate(dwell, rise_time)
        before = np.append(remains * stribeck, np.exp(unknowns[:-1, LEVEL]) * found[:-1, kernel.REMAINS])
        level = before + (stribeck - before) * share
        linked = self.linked
        by_stribeck = np.where(linked, stribeck * share / level, 1.0)
        by_stribeck[0] = 1.0  # what is left before the first slip is known as a share
        return (
            np.where(linked, np.log(level), np.log(stribeck) + 0.5 * np.log(share)),
            by_stribeck,
            np.where(linked, -(stribeck - before) / level * dwell * steepness, -0.5 * (1.0 - share)),
            np.where(linked, (stribeck - before) / level * steepness, 0.5 * steepness / share),
            np.where(linked, before * (1.0 - share) / level, 0.0),
        )

    def levels(self, point: Point) -> FloatArray:
        """Logarithm of the level that Eq. (6) gives at each breakaway."""
        return self._levels(point.parameters, point.unknowns, point.found)[0]

    def best_kinetic(self, unknowns: FloatArray, found: FloatArray) -> FloatArray:
        """Kinetic friction that balances most breakaways: least absolute deviations, by reweighting."""
        problem = self.problem
        target = found[:, kernel.HELD] - np.exp(unknowns[:, LEVEL])
        weights = problem.usable.astype(float)
        kinetic = np.zeros(problem.balance.shape[1])
        for _ in range(10):
            weighted = problem.balance * weights[:, None]
            products = weighted.T @ problem.balance
            # Of a speed at which no slip is usable nothing is known.
            products += _LEAST * np.trace(products) * np.eye(len(products))
            kinetic = np.linalg.solve(products, weighted.T @ target)
            misfit = np.abs(target - problem.balance @ kinetic)
            weights = problem.usable / np.maximum(misfit, 1e-3 * np.median(misfit) + 1e-300)
            weights /= weights.max()
        return kinetic

    def slopes(self, point: Point, active: Collection[int]) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Slopes of observations, balance and links: by the active parameters, and by each slip's unknowns.

        By other parameters they are zero. Of the latter the last are those of the link that follows the slip.
        """
        problem, count = self.problem, self.problem.count
        _, by_stribeck, by_rise_time, by_dwell, by_remains = self._levels(point.parameters, point.unknowns, point.found)
        moving = [k for k in active if not SHAPE <= k < PARAMETERS]
        steps = np.stack([np.full(count, _STEP)] * len(moving) + [1e-4 * problem.durations, np.full(count, 1e-3)])
        parameters = np.repeat(point.parameters[None], len(steps), axis=0)
        unknowns = np.repeat(point.unknowns[None], len(steps), axis=0)
        parameters[np.arange(len(moving)), moving] += _STEP
        for row, k in ((-2, BREAKAWAY), (-1, LEVEL)):
            unknowns[row, :, k] += steps[row]
        positions, _, found = problem.simulate_variants(parameters, unknowns)
        self._complete(found)
        scale = problem.weights / problem.errors
        moved = (problem.targets - positions[:, problem.observed]) * scale - point.observed
        moved /= steps[:, problem.slip_of]
        forces = (found[:, :, kernel.HELD] - point.found[:, kernel.HELD]) * self.balance_weight / steps
        arrests = (found[:, :, kernel.ARREST] - point.found[:, kernel.ARREST]) / steps
        # Where the joint stops without a trace of Stribeck friction nothing is left to the next slip.
        left = np.maximum([point.found[None, :, kernel.REMAINS], *found[:, None, :, kernel.REMAINS]], _NOTHING_LEFT)
        remains = np.log(left[1:, 0] / left[0]) / steps
        ends = np.zeros((len(steps), count))  # slopes of the links by what moved the ends of the slips before them
        ends[:, 1:] = (by_dwell / self.level_errors)[1:] * arrests[:, :-1]
        ends[:, 1:] -= (by_remains / self.level_errors)[1:] * remains[:, :-1]
        ends *= problem.linked

        observed = np.zeros((len(point.observed), self.columns))
        balance, links = np.zeros((count, self.columns)), np.zeros((count, self.columns))
        observed[:, moving], balance[:, moving], links[:, moving] = moved[:-2].T, forces[:-2].T, ends[:-2].T
        if STRIBECK in active:
            links[:, STRIBECK] = -by_stribeck / self.level_errors
        if RISE_TIME in active:
            links[:, RISE_TIME] = -by_rise_time / self.level_errors
        balance[:, len(point.parameters) :] = -problem.balance * self.balance_weight[:, None]

        own = np.zeros((len(point.observed), UNKNOWNS))
        own_balance, own_link, next_link = (np.zeros((count, UNKNOWNS)) for _ in range(3))
        # A slip that begins elsewhere is the same slip there.
        own[:, POSITION] = -scale
        own_balance[:, POSITION] = -problem.directions * problem.stiffness(point.parameters) * self.balance_weight
        for row, k in ((-2, BREAKAWAY), (-1, LEVEL)):
            own[:, k], own_balance[:, k], next_link[:-1, k] = moved[row], forces[row], ends[row, 1:]
        own_balance[:, LEVEL] -= np.exp(point.unknowns[:, LEVEL]) * self.balance_weight
        own_link[:, BREAKAWAY] = -by_dwell / self.level_errors
        own_link[:, LEVEL] = 1.0 / self.level_errors
        next_link[:-1, LEVEL] -= (by_remains / self.level_errors)[1:]
        return (observed, balance, links), (own, own_balance, own_link, next_link)


def fit_slips(
    problem: SlipProblem,
    prior: Prior,
    tolerances: Tolerances,
    *,
    parameters: FloatArray,
    unknowns: FloatArray,
    iterations: int = 25,
    enough: float = 1e-3,
) -> SlipFit:
    """Fit from a start; the start itself comes back if nothing near it is better.

    Parameters
    ----------
    parameters : logarithms, shape (p,). unknowns : of the slips, shape (slips, 3).
    iterations : at most. enough : gain of an iteration below which it stops.

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
    slopes = fit.slopes(point, fit.free)
    equations = NormalEquations.assemble(problem, point, *slopes)
    for _ in range(iterations):
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
            step *= min(1.0, _LONGEST_STEP / max(float(np.max(np.abs(step[:size]))), 1e-300))
            own = (by_slope - by_parameters @ step).reshape(-1, UNKNOWNS)
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
        slopes = fit.slopes(point, fit.free)
        equations = NormalEquations.assemble(problem, point, *slopes)
        if before.cost - point.cost < enough * max(1.0, 1e-3 * point.cost):
            break
    information, _, by_parameters, _ = equations.eliminate(0.0)
    scores, pulls = NormalEquations.shares(problem, point, *slopes, by_parameters)
    return SlipFit(
        parameters=point.parameters,
        unknowns=point.unknowns,
        kinetic=point.kinetic,
        information=information,
        scores=scores,
        pulls=pulls,
        residuals=point.observed,
        misfits=_misfits(problem, point),
        link_misfits=point.unknowns[:, LEVEL] - fit.levels(point),
        cost=point.cost,
        velocities=point.velocities,
        found=point.found,
    )


@dataclass(frozen=True, kw_only=True)
class SlipEvidence:
    """What one problem's slips say about given parameters, their own unknowns fitted and eliminated.

    Attributes
    ----------
    information, gradient : on parameters and kinetic friction, shapes (p + k, p + k) and (p + k,).
    unknowns, residuals, misfits, found : as of :class:`SlipFit`.
    """

    information: FloatArray
    gradient: FloatArray
    unknowns: FloatArray
    residuals: FloatArray
    misfits: FloatArray
    found: FloatArray


def evidence(
    problem: SlipProblem,
    tolerances: Tolerances,
    *,
    parameters: FloatArray,
    kinetic: FloatArray,
    unknowns: FloatArray,
    iterations: int = 8,
) -> SlipEvidence:
    """Fit the slips' own unknowns to the parameters as they are, and see which way the slips would move these.

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
        equations = NormalEquations.assemble(problem, point, *fit.slopes(point, active=()))
        before = point.cost
        while damping < 1.0:
            own = equations.eliminate(damping)[3].reshape(-1, UNKNOWNS)
            candidate = fit.evaluate(parameters, _moved(problem, point.unknowns, own), kinetic)
            if candidate.cost < point.cost:
                point = candidate
                break
            damping *= 10.0
        damping = max(damping / 10.0, 1e-9)
        if before - point.cost < _ENOUGH_OF_OWN * max(1.0, point.cost):
            break
    equations = NormalEquations.assemble(problem, point, *fit.slopes(point, fit.free))
    information, gradient, _, _ = equations.eliminate(0.0)
    return SlipEvidence(
        information=information,
        gradient=gradient,
        unknowns=point.unknowns,
        residuals=point.observed,
        misfits=_misfits(problem, point),
        found=point.found,
    )


def _misfits(problem: SlipProblem, point: Point) -> FloatArray:
    """Kinetic friction at each breakaway beside what the fit has [N·m]."""
    held = point.found[:, kernel.HELD] - np.exp(point.unknowns[:, LEVEL])
    return np.asarray(held - problem.balance @ point.kinetic)


def _moved(problem: SlipProblem, unknowns: FloatArray, step: FloatArray) -> FloatArray:
    """The unknowns after a step, each no further than where the equations hold."""
    limits = np.stack([4.0 * problem.rest_errors, 0.1 * problem.durations, np.full(problem.count, 0.7)], axis=1)
    moved = unknowns + np.clip(step, -limits, limits)
    latest = problem.last_times - 0.2 * problem.durations
    moved[:, BREAKAWAY] = np.clip(moved[:, BREAKAWAY], problem.first_times, latest)
    return moved
