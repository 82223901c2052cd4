# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One step of y¨ + δ y˙ + κ y = u, compiled and exact, with the force u a polynomial through Lobatto points.

Unlike :mod:`stickslip_ros.model._linear_step` it has no spring of its own to count time in, since a joint whose
effort is known has none, and its points include both ends. Time is counted in steps.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined

POINTS = 6  # Lobatto points of a step, 1: both ends included
_SERIES_TERMS = 16  # terms of the power series of an impulse response, 1

_legendre = np.polynomial.legendre.Legendre.basis(POINTS - 1)
NODES = 0.5 * (1.0 + np.concatenate([[-1.0], _legendre.deriv().roots().real, [1.0]]))
# Coefficients of the Lagrange polynomials: L_j(s) = Σ_k LAGRANGE[k, j] s^k.
LAGRANGE = np.linalg.inv(np.vander(NODES, POINTS, increasing=True))

# Rows of a step's matrix: velocity at the points after the first, position at the end.
# Columns: position and velocity at the start, then the force at the points.
ROWS, COLUMNS = POINTS, POINTS + 2
END_POSITION = POINTS - 1


@inlined()
def fill_step(stiffness, damping, matrix):
    """The matrix of one step, for κ and δ of at most about one."""
    # Loops go by shapes: by numbers known ahead they would be unrolled, which takes seconds to compile.
    # G_m(s) = Σ_n a_n s^(n+m)/(n+m)!, with a_n the Taylor coefficients of the velocity after an impulse: G_1 and G_0
    # are position and velocity after an impulse, G_(k+2) and G_(k+1) those under the force s^k/k!.
    points = matrix.shape[0]
    responses = np.empty(points + 2)
    top = points + 1
    for i in range(1, points):
        time = NODES[i]
        term = 1.0
        for m in range(1, top):
            term *= time / m
        power, before, coefficient = term, 0.0, 1.0
        lower, upper = term, 0.0
        for n in range(_SERIES_TERMS):
            term *= time / (top + n)
            upper += coefficient * term
            before, coefficient = coefficient, -damping * coefficient - stiffness * before
            lower += coefficient * term
        responses[top], responses[top - 1] = upper, lower
        for m in range(top - 2, -1, -1):
            power *= (m + 1) / time
            responses[m] = power - damping * responses[m + 1] - stiffness * responses[m + 2]
        matrix[i - 1, 0] = -stiffness * responses[1]
        matrix[i - 1, 1] = responses[0]
        _force_columns(responses, 1, matrix, i - 1)
    # The last point is the end.
    matrix[END_POSITION, 0] = responses[0] + damping * responses[1]
    matrix[END_POSITION, 1] = responses[1]
    _force_columns(responses, 2, matrix, END_POSITION)


@helper()
def _force_columns(responses, order, matrix, row):
    """Columns of a row for the force at the points: velocity by order 1, position by order 2."""
    points = matrix.shape[0]
    for j in range(points):
        factorial, total = 1.0, 0.0
        for k in range(points):
            total += factorial * LAGRANGE[k, j] * responses[k + order]
            factorial *= k + 1
        matrix[row, 2 + j] = total


@helper()
def fill_weights(share, weights, row):
    """Weights of the values at a step's points in the polynomial through them, at a share of the step."""
    points = weights.shape[1]
    for j in range(points):
        total = 0.0
        for k in range(points - 1, -1, -1):
            total = total * share + LAGRANGE[k, j]
        weights[row, j] = total


@helper()
def fill_polynomial(values, coefficients):
    """Coefficients of the polynomial through the values at a step's points."""
    points = values.shape[0]
    for k in range(points):
        total = 0.0
        for j in range(points):
            total += LAGRANGE[k, j] * values[j]
        coefficients[k] = total


@inlined()
def first_not_positive(values, coefficients, point):
    """Share of a step at which the polynomial through the points falls to zero, seen first not to be above it at one.

    ``values`` are those at the points.
    """
    points = values.shape[0]
    low, high = NODES[point - 1], NODES[point]
    if values[point - 1] <= 0.0:
        return low
    share = 0.5 * (low + high)
    for _ in range(60):
        value, slope = 0.0, 0.0
        for k in range(points - 1, -1, -1):
            slope = slope * share + value
            value = value * share + coefficients[k]
        if value > 0.0:
            low = share
        else:
            high = share
        following = share - value / slope if slope < 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - share)
        share = following
        if moved < 1e-13:
            break
    return share
