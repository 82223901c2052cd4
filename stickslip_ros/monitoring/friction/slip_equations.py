# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The Gauss-Newton equations of a :class:`SlipProblem`, with each slip's own unknowns in a band matrix."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from numpy.typing import NDArray

from stickslip_ros.monitoring.friction import _equations_kernel as kernel
from stickslip_ros.monitoring.friction._equations_kernel import HUBER, LARGEST_RESIDUAL, UNKNOWNS
from stickslip_ros.monitoring.friction._window_kernel import POSITION
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.samples import FloatArray


@dataclass
class Point:
    """The residuals at one point, and what they come from; ``ties`` has the columns of the equations' kernel."""

    parameters: FloatArray
    unknowns: FloatArray
    kinetic: FloatArray
    observed: FloatArray
    balance: FloatArray
    links: FloatArray
    ties: FloatArray
    found: FloatArray
    velocities: FloatArray
    cost: float = math.inf


@dataclass
class Slopes:
    """Slopes of the residuals at a point, as :func:`._equations_kernel.fill_slopes` has them.

    ``moving`` are the parameters by which those of the observations are not zero.
    """

    moving: NDArray[np.int64]
    terms: FloatArray
    by_shared: FloatArray
    by_own: FloatArray


@dataclass
class NormalEquations:
    """Equations for the steps of parameters (with kinetic friction) and of the slips' unknowns."""

    matrix: FloatArray
    gradient: FloatArray
    mixed: FloatArray
    band: FloatArray
    slope: FloatArray

    @staticmethod
    def assemble(problem: SlipProblem, slips: FloatArray, point: Point, slopes: Slopes) -> NormalEquations:
        """Collect the equations from the slopes; ``slips`` has the columns of the kernel."""
        _, count, columns = slopes.by_shared.shape
        equations = NormalEquations(
            matrix=np.zeros((columns, columns)),
            gradient=np.zeros(columns),
            mixed=np.zeros((count * UNKNOWNS, columns)),
            band=np.zeros((2 * UNKNOWNS, count * UNKNOWNS)),
            slope=np.zeros(count * UNKNOWNS),
        )
        kernel.collect(
            slopes.terms, problem.observation_edges, slopes.moving, slopes.by_shared, slopes.by_own, point.balance,
            point.links, point.unknowns, slips, equations.matrix, equations.gradient, equations.mixed, equations.band,
            equations.slope,
        )  # fmt: skip
        return equations

    @staticmethod
    def shares(
        problem: SlipProblem, point: Point, slopes: Slopes, by_parameters: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Parts of the gradient by the parameters, the slips' own unknowns eliminated.

        Each slip's share of it, shape (slips, columns); and what a discrepancy of a whole slip's distance in each part
        of all slips would make, shape (parts, columns).
        """
        balance, links = slopes.by_shared
        own_balance, own_link, next_link = slopes.by_own
        shared = len(slopes.moving)
        follow = by_parameters.reshape(problem.count, UNKNOWNS, -1)
        projected = -np.einsum("am,mac->mc", slopes.terms[shared:-1], follow[problem.slip_of])
        projected[:, slopes.moving] += slopes.terms[:shared].T
        projected *= weights_of(point.observed)[:, None]
        way = (problem.directions * problem.distances)[problem.slip_of] / problem.noise.errors
        bias_sensitivity = np.zeros((problem.parts_of_slips.max() + 1, projected.shape[1]))
        np.add.at(bias_sensitivity, problem.parts_of_slips, projected * way[:, None])
        scores = np.add.reduceat(projected * point.observed[:, None], problem.observation_edges[:-1], axis=0)
        projected = balance - np.einsum("na,nac->nc", own_balance, follow)
        scores += projected * (weights_of(point.balance) * point.balance)[:, None]
        projected = links - np.einsum("na,nac->nc", own_link, follow)
        projected[1:] -= np.einsum("na,nac->nc", next_link[:-1], follow[:-1])
        scores += projected * (weights_of(point.links) * point.links)[:, None]
        rest = (point.unknowns[:, POSITION] - problem.rests) / problem.rest_errors**2
        scores -= rest[:, None] * follow[:, POSITION]
        return -scores, bias_sensitivity

    def eliminate(self, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Schur complement and gradient of the parameters; solutions for the unknowns of mixed and slope.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the unknowns' part of the matrix is not positive definite.
        """
        band = self.band.copy()
        band[0] *= 1.0 + damping
        solved = np.column_stack([self.mixed, self.slope])
        if not kernel.solve_band(band, solved):
            raise LinAlgError("the equations of the slips are not positive definite")
        by_parameters, by_slope = solved[:, :-1], solved[:, -1]
        return (
            self.matrix - self.mixed.T @ by_parameters,
            self.gradient - self.mixed.T @ by_slope,
            by_parameters,
            by_slope,
        )


def robust(residuals: FloatArray) -> float:
    """Sum of squares, linear beyond the Huber limit."""
    size = np.minimum(np.abs(residuals), LARGEST_RESIDUAL)
    return float(np.where(size < HUBER, size * size, 2.0 * HUBER * size - HUBER**2).sum())


def weights_of(residuals: FloatArray) -> FloatArray:
    """Weights that make squares of them :func:`robust`."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(residuals), 1e-12))
