# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The Gauss-Newton equations of a :class:`SlipProblem`, with each slip's own unknowns in a band matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction import _equations_kernel as kernel
from stickslip_ros.monitoring.friction._window_kernel import BREAKAWAY, POSITION
from stickslip_ros.monitoring.friction.slip_problem import UNKNOWNS, SlipProblem
from stickslip_ros.monitoring.samples import FloatArray

HUBER = 3.0  # standard deviations, beyond which a residual counts linearly
_ABSURD = 1e150  # a residual so large is as bad as any, and its square is a number
WEAK = 1e-4  # weight of the detected breakaway beside the data's


@dataclass
class Point:
    """The residuals at one point, and what they come from."""

    parameters: FloatArray
    unknowns: FloatArray
    kinetic: FloatArray
    observed: FloatArray
    balance: FloatArray
    links: FloatArray
    found: FloatArray
    velocities: FloatArray
    cost: float = math.inf


@dataclass
class NormalEquations:
    """Equations for the steps of parameters (with kinetic friction) and of the slips' unknowns."""

    matrix: FloatArray
    gradient: FloatArray
    mixed: FloatArray
    band: FloatArray
    slope: FloatArray

    @staticmethod
    def assemble(
        problem: SlipProblem, point: Point, shared: tuple[FloatArray, ...], own: tuple[FloatArray, ...]
    ) -> NormalEquations:
        """Collect the equations from the slopes by the parameters and by each slip's own unknowns."""
        observed, balance, links = shared
        own_observed, own_balance, own_link, next_link = own
        count, columns = balance.shape
        weights = weights_of(point.observed)
        balance_weights, link_weights = weights_of(point.balance), weights_of(point.links)
        rows = np.concatenate([observed, balance, links])
        row_weights = np.concatenate([weights, balance_weights, link_weights])
        residuals = np.concatenate([point.observed, point.balance, point.links])

        def next_one(values: FloatArray) -> FloatArray:
            return np.concatenate([values[1:], np.zeros_like(values[:1])])

        mixed, diagonal = np.zeros((count, UNKNOWNS, columns)), np.zeros((count, UNKNOWNS, UNKNOWNS))
        slope = np.zeros((count, UNKNOWNS))
        kernel.collect_own(problem.slip_of, weights, point.observed, own_observed, observed, mixed, diagonal, slope)
        for mine, weight, columns_of, residual in (
            (own_balance, balance_weights, balance, point.balance),
            (own_link, link_weights, links, point.links),
            (next_link, next_one(link_weights), next_one(links), next_one(point.links)),
        ):
            scaled = mine * weight[:, None]
            mixed += scaled[:, :, None] * columns_of[:, None, :]
            diagonal += scaled[:, :, None] * mine[:, None, :]
            slope -= scaled * residual[:, None]
        diagonal[:, POSITION, POSITION] += 1.0 / problem.rest_errors**2
        slope[:, POSITION] -= (point.unknowns[:, POSITION] - problem.rests) / problem.rest_errors**2
        diagonal[:, BREAKAWAY, BREAKAWAY] += WEAK / problem.durations**2
        slope[:, BREAKAWAY] -= WEAK * (point.unknowns[:, BREAKAWAY] - problem.breakaways) / problem.durations**2
        # Rows of the slip after, columns of the slip: its link joins them.
        coupling = (link_weights[1:, None] * own_link[1:])[:, :, None] * next_link[:-1, None, :]
        band = np.zeros((2 * UNKNOWNS, UNKNOWNS * count))
        for a in range(UNKNOWNS):
            for b in range(UNKNOWNS):
                if a >= b:
                    band[a - b, b::UNKNOWNS] = diagonal[:, a, b]
                band[UNKNOWNS + a - b, b:-UNKNOWNS:UNKNOWNS] = coupling[:, a, b] if count > 1 else 0.0
        return NormalEquations(
            matrix=rows.T @ (rows * row_weights[:, None]),
            gradient=-rows.T @ (row_weights * residuals),
            mixed=mixed.reshape(count * UNKNOWNS, columns),
            band=band,
            slope=slope.ravel(),
        )

    @staticmethod
    def shares(
        problem: SlipProblem,
        point: Point,
        shared: tuple[FloatArray, ...],
        own: tuple[FloatArray, ...],
        by_parameters: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Parts of the gradient by the parameters, the slips' own unknowns eliminated.

        Each slip's share of it, shape (slips, columns); and what a discrepancy of a whole slip's distance in each part
        of all slips would make, shape (parts, columns).
        """
        observed, balance, links = shared
        own_observed, own_balance, own_link, next_link = own
        count = problem.count
        follow = by_parameters.reshape(count, UNKNOWNS, -1)
        begins = np.searchsorted(problem.slip_of, np.arange(count))
        projected = observed - np.einsum("ma,mac->mc", own_observed, follow[problem.slip_of])
        projected *= weights_of(point.observed)[:, None]
        way = (problem.directions * problem.distances)[problem.slip_of] / problem.errors
        pulls = np.zeros((problem.parts_of_slips.max() + 1, projected.shape[1]))
        np.add.at(pulls, problem.parts_of_slips, projected * way[:, None])
        scores = np.add.reduceat(projected * point.observed[:, None], begins, axis=0)
        projected = balance - np.einsum("na,nac->nc", own_balance, follow)
        scores += projected * (weights_of(point.balance) * point.balance)[:, None]
        projected = links - np.einsum("na,nac->nc", own_link, follow)
        projected[1:] -= np.einsum("na,nac->nc", next_link[:-1], follow[:-1])
        scores += projected * (weights_of(point.links) * point.links)[:, None]
        rest = (point.unknowns[:, POSITION] - problem.rests) / problem.rest_errors**2
        scores -= rest[:, None] * follow[:, POSITION]
        return -scores, pulls

    def eliminate(self, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Schur complement and gradient of the parameters; solutions for the unknowns of mixed and slope."""
        band = self.band.copy()
        band[0] *= 1.0 + damping
        solved = _solve_band(band, np.column_stack([self.mixed, self.slope]))
        by_parameters, by_slope = solved[:, :-1], solved[:, -1]
        return (
            self.matrix - self.mixed.T @ by_parameters,
            self.gradient - self.mixed.T @ by_slope,
            by_parameters,
            by_slope,
        )


def _solve_band(band: FloatArray, right: FloatArray) -> FloatArray:
    """Solution, in place of both, of positive definite equations, of whose matrix the lower diagonals are given.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is not positive definite.
    """
    if not kernel.solve_band(band, right):
        raise LinAlgError("the equations of the slips are not positive definite")
    return right


def robust(residuals: FloatArray) -> float:
    """Sum of squares, linear beyond the Huber limit."""
    size = np.minimum(np.abs(residuals), _ABSURD)
    return float(np.where(size < HUBER, size * size, 2.0 * HUBER * size - HUBER**2).sum())


def weights_of(residuals: FloatArray) -> FloatArray:
    """Weights that make squares of them :func:`robust`."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(residuals), 1e-12))
