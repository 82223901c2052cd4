# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One step of ξ¨ + 2ρ ξ˙ + ξ = −f, compiled and exact, with the friction f a polynomial through Gauss points."""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model.bounds import TINY

POINTS = 8  # Gauss points of a step, 1
_SERIES_TERMS = 18  # terms of the power series of an impulse response, 1

NODES = 0.5 * (np.polynomial.legendre.leggauss(POINTS)[0] + 1.0)
# Coefficients of the Lagrange polynomials: L_j(θ) = Σ_k _LAGRANGE[k, j] θ^k.
_LAGRANGE = np.linalg.inv(np.vander(NODES, POINTS, increasing=True))
AT_END = _LAGRANGE.sum(axis=0)  # weights of the values at the points in the value at the step's end, 1
_HIGHEST = (
    (2 * POINTS - 1)
    / 2
    * np.polynomial.legendre.leggauss(POINTS)[1]
    * np.polynomial.legendre.legval(2.0 * NODES - 1.0, np.eye(POINTS)[-1])
)

# Rows of a step's matrix: velocity at the Gauss points, then position and velocity at the end.
# Columns: position and velocity at the start, then friction at the Gauss points.
END_POSITION, END_VELOCITY, ROWS, COLUMNS = POINTS, POINTS + 1, POINTS + 2, POINTS + 2


@helper()
def _responses(time, damping_ratio, out):
    """G_m(t) = Σ_n a_n t^(n+m)/(n+m)!, m = 0 … POINTS + 1, with a_n the impulse response's Taylor coefficients.

    G_1 and G_0 are position and velocity after an impulse, G_{k+2} and G_{k+1} those under the force t^k/k!.
    """
    top = POINTS + 1
    power = 1.0
    for m in range(1, top):
        power *= time / m
    # power = t^(top-1)/(top-1)!
    twice = 2.0 * damping_ratio
    before, coefficient = 0.0, 1.0
    lower = power
    upper = 0.0
    term = power
    for n in range(_SERIES_TERMS):
        term *= time / (top + n)
        upper += coefficient * term
        before, coefficient = coefficient, -twice * coefficient - before
        lower += coefficient * term
    out[top] = upper
    out[top - 1] = lower
    for m in range(top - 2, -1, -1):
        power *= (m + 1) / time if time > TINY else 0.0
        if m == 0:
            power = 1.0
        out[m] = power - twice * out[m + 1] - out[m + 2]


@inlined()
def _force_columns(step, responses, order, matrices, which, row):
    """Columns of a row for the friction at the Gauss points: velocity by order 1, position by order 2."""
    for j in range(POINTS):
        matrices[which, row, 2 + j] = 0.0
    scale = 1.0
    for k in range(POINTS):
        value = scale * responses[k + order]
        for j in range(POINTS):
            matrices[which, row, 2 + j] -= value * _LAGRANGE[k, j]
        scale *= (k + 1) / step


@helper()
def _velocity_row(time, step, damping_ratio, responses, matrices, which, row):
    """Row of a matrix that gives the velocity ``time`` after a step's start; fills ``responses`` on the way."""
    _responses(time, damping_ratio, responses)
    matrices[which, row, 0] = -responses[1]
    matrices[which, row, 1] = responses[0]
    _force_columns(step, responses, 1, matrices, which, row)


@helper()
def fill_matrix(step, damping_ratio, matrices, which):
    """The matrix of one step, one of several."""
    responses = np.empty(POINTS + 2)
    for i in range(POINTS + 1):
        if i < POINTS:
            _velocity_row(NODES[i] * step, step, damping_ratio, responses, matrices, which, i)
        else:
            _velocity_row(step, step, damping_ratio, responses, matrices, which, i + 1)
    matrices[which, END_POSITION, 0] = responses[0] + 2.0 * damping_ratio * responses[1]
    matrices[which, END_POSITION, 1] = responses[1]
    _force_columns(step, responses, 2, matrices, which, END_POSITION)


@helper()
def fill_lagged(step, lag, damping_ratio, lagged, which):
    """Rows that give the velocity one lag before each Gauss point, where that is inside the step."""
    responses = np.empty(POINTS + 2)
    for i in range(POINTS):
        time = NODES[i] * step - lag
        if time >= 0.0:
            _velocity_row(time, step, damping_ratio, responses, lagged, which, i)


@helper()
def fit_friction(vector, step, coefficients):
    """Coefficients of the friction's interpolating polynomial in t^k/k!."""
    scale = 1.0
    for k in range(POINTS):
        total = 0.0
        for j in range(POINTS):
            total += _LAGRANGE[k, j] * vector[2 + j]
        coefficients[k] = scale * total
        scale *= (k + 1) / step


@helper()
def inside(time, damping_ratio, position, velocity, coefficients, responses):
    """Position, velocity, acceleration and friction ``time`` after the start of a step."""
    _responses(time, damping_ratio, responses)
    twice = 2.0 * damping_ratio
    new_position = position * (responses[0] + twice * responses[1]) + velocity * responses[1]
    new_velocity = velocity * responses[0] - position * responses[1]
    friction = 0.0
    power = 1.0
    for k in range(POINTS):
        new_position -= coefficients[k] * responses[k + 2]
        new_velocity -= coefficients[k] * responses[k + 1]
        friction += coefficients[k] * power
        power *= time / (k + 1)
    return new_position, new_velocity, -new_position - twice * new_velocity - friction, friction


@helper()
def crossing(low, high, damping_ratio, position, velocity, coefficients, target, responses):
    """Time inside a step at which the velocity falls through a target."""
    width = high - low
    time = 0.5 * (low + high)
    for _ in range(60):
        _, speed, acceleration, _ = inside(time, damping_ratio, position, velocity, coefficients, responses)
        if speed > target:
            low = time
        else:
            high = time
        following = time - (speed - target) / acceleration if acceleration < 0.0 else low - width
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - time)
        time = following
        if moved <= 1e-9 * width:
            # Newton's method has converged quadratically.
            break
    return time


@inlined()
def find_dip(high, damping_ratio, position, velocity, coefficients, responses):
    """Time inside a step at which the acceleration rises through zero."""
    low = 0.0
    while high - low > 1e-14 * (high + low):
        time = 0.5 * (low + high)
        if inside(time, damping_ratio, position, velocity, coefficients, responses)[2] < 0.0:
            low = time
        else:
            high = time
    return high


@helper()
def roughness(vector):
    """Highest Legendre coefficient of the friction's polynomial: what a step that is too long leaves over."""
    total = 0.0
    for j in range(POINTS):
        total += _HIGHEST[j] * vector[2 + j]
    return abs(total)


@helper(fastmath=True)
def multiply(matrices, which, vector, result):
    """Product of one of several matrices and a vector, into ``result``."""
    for i in range(ROWS):
        total = 0.0
        for j in range(COLUMNS):
            total += matrices[which, i, j] * vector[j]
        result[i] = total
