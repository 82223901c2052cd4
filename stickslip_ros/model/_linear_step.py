# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One step of y¨ + δ y˙ + κ y = u, compiled and exact, with the force u a polynomial through Lobatto points.

The first and the last of them are the step's beginning and end. The cycle map (``_slip_kernel``) has the spring to
count time in, κ = 1 and δ = 2ρ; it uses what is below :data:`POINTS`. The fit (``monitoring.friction._window_kernel``)
counts time in steps, since a joint whose effort is known has no spring.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model.bounds import TINY


def lobatto_points(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points as shares of a step, and the coefficients of their Lagrange polynomials, L_j(s) = Σ_k c[k, j] s^k."""
    inner = np.polynomial.legendre.Legendre.basis(count - 1).deriv().roots().real
    points = 0.5 * (1.0 + np.concatenate([[-1.0], inner, [1.0]]))
    return points, np.asarray(np.linalg.inv(np.vander(points, count, increasing=True)), dtype=float)


_SERIES_TERMS = 16  # terms of the power series of an impulse response, 1: to rounding for κ and δ of a step up to 1


@helper()
def _fill_responses(time, stiffness, damping, out):
    """G_m(t) = Σ_n a_n t^(n+m)/(n+m)!, m = 0, 1, …, with a_n the Taylor coefficients of the velocity after an impulse.

    G_1 and G_0 are position and velocity after an impulse, G_{k+2} and G_{k+1} those under the force t^k/k!.
    """
    top = out.shape[0] - 1
    power = 1.0
    for m in range(1, top):
        power *= time / m
    # power = t^(top-1)/(top-1)!
    before, coefficient = 0.0, 1.0
    lower = power
    upper = 0.0
    term = power
    for n in range(_SERIES_TERMS):
        term *= time / (top + n)
        upper += coefficient * term
        before, coefficient = coefficient, -damping * coefficient - stiffness * before
        lower += coefficient * term
    out[top] = upper
    out[top - 1] = lower
    for m in range(top - 2, -1, -1):
        power *= (m + 1) / time if time > TINY else 0.0
        if m == 0:
            power = 1.0
        out[m] = power - damping * out[m + 1] - stiffness * out[m + 2]


@helper()
def _fill_force_columns(responses, order, scales, lagrange, row):
    """Columns of a row for the force at the points: velocity by order 1, position by order 2."""
    # Loops go by shapes: by numbers known ahead they would be unrolled, which takes seconds to compile.
    points = lagrange.shape[0]
    for j in range(points):
        row[2 + j] = 0.0
    for k in range(points):
        value = scales[k] * responses[k + order]
        for j in range(points):
            row[2 + j] += value * lagrange[k, j]


@helper()
def _fill_velocity_row(time, stiffness, damping, scales, lagrange, responses, row):
    """Row of a matrix that gives the velocity ``time`` after a step's start; fills ``responses`` on the way."""
    _fill_responses(time, stiffness, damping, responses)
    row[0] = -stiffness * responses[1]
    row[1] = responses[0]
    _fill_force_columns(responses, 1, scales, lagrange, row)


@helper()
def fill_step(step, stiffness, damping, shares, scales, lagrange, matrix):
    """The matrix of one step: rows that give the velocity at shares of it, the last of which is 1, and the position
    at its end; columns for position and velocity at the start, then for the force at the points.

    Σ_j scales[k] lagrange[k, j] force[j] are the coefficients of the force's polynomial in t^k/k!.
    """
    responses = np.empty(lagrange.shape[0] + 2)
    for i in range(shares.shape[0]):
        _fill_velocity_row(shares[i] * step, stiffness, damping, scales, lagrange, responses, matrix[i])
    end = matrix[shares.shape[0]]
    end[0] = responses[0] + damping * responses[1]
    end[1] = responses[1]
    _fill_force_columns(responses, 2, scales, lagrange, end)


@helper()
def fill_polynomial(values, lagrange, coefficients):
    """Coefficients of the polynomial through the values at the points, in the share of the step."""
    for k in range(lagrange.shape[0]):
        total = 0.0
        for j in range(lagrange.shape[0]):
            total += lagrange[k, j] * values[j]
        coefficients[k] = total


POINTS = 8  # points of a step, 1
NODES, _LAGRANGE = lobatto_points(POINTS)
# Weights of the values at the points in the highest Legendre coefficient of the polynomial through them.
_HIGHEST = np.linalg.inv(np.polynomial.legendre.legvander(2.0 * NODES - 1.0, POINTS - 1))[-1].copy()
# Rows of a step's matrix: velocity at the points, position at the end.
END_VELOCITY, END_POSITION, ROWS, COLUMNS = POINTS - 1, POINTS, POINTS + 1, POINTS + 2


@helper()
def _scales(step):
    """k!/step^k."""
    scales = np.ones(POINTS)
    for k in range(1, POINTS):
        scales[k] = scales[k - 1] * (k / step)
    return scales


@helper()
def fill_matrix(step, damping_ratio, matrices, which):
    """The matrix of one step, one of several."""
    fill_step(step, 1.0, 2.0 * damping_ratio, NODES, _scales(step), _LAGRANGE, matrices[which])


@helper()
def fill_lagged(step, lag, damping_ratio, lagged, which):
    """Rows that give the velocity one lag before each point, where that is inside the step."""
    responses, scales = np.empty(POINTS + 2), _scales(step)
    for i in range(POINTS):
        time = NODES[i] * step - lag
        if time >= 0.0:
            _fill_velocity_row(time, 1.0, 2.0 * damping_ratio, scales, _LAGRANGE, responses, lagged[which, i])


@helper()
def fit_force(vector, step, coefficients):
    """Coefficients of the force's interpolating polynomial in t^k/k!."""
    fill_polynomial(vector[2:], _LAGRANGE, coefficients)
    scale = 1.0
    for k in range(POINTS):
        coefficients[k] *= scale
        scale *= (k + 1) / step


@helper()
def inside(time, damping_ratio, position, velocity, coefficients, responses):
    """Position, velocity, acceleration and force ``time`` after the start of a step."""
    twice = 2.0 * damping_ratio
    _fill_responses(time, 1.0, twice, responses)
    new_position = position * (responses[0] + twice * responses[1]) + velocity * responses[1]
    new_velocity = velocity * responses[0] - position * responses[1]
    force = 0.0
    power = 1.0
    for k in range(POINTS):
        new_position += coefficients[k] * responses[k + 2]
        new_velocity += coefficients[k] * responses[k + 1]
        force += coefficients[k] * power
        power *= time / (k + 1)
    return new_position, new_velocity, -new_position - twice * new_velocity + force, force


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
    """Highest Legendre coefficient of the force's polynomial: what a step that is too long leaves over."""
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
