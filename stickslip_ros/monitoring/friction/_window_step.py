# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The points of a step of the fit, at both its ends and between, and polynomials through them.

The step itself is :mod:`stickslip_ros.model._linear_step`'s. Time is counted in steps.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.model._linear_step import lobatto_points

POINTS = 6  # points of a step, 1
NODES, LAGRANGE = lobatto_points(POINTS)
LATER = NODES[1:].copy()  # all but the step's beginning
IN_FACTORIALS = LAGRANGE * np.array([[1.0 * math.factorial(k)] for k in range(POINTS)])  # the same, of s^k/k!

# Rows of a step's matrix: velocity at the points after the first, position at the end.
# Columns: position and velocity at the start, then the force at the points.
ROWS, COLUMNS = POINTS, POINTS + 2
END_POSITION = POINTS - 1


@helper()
def fill_weights(share, weights, row):
    """Weights of the values at a step's points in the polynomial through them, at a share of the step."""
    points = weights.shape[1]
    for j in range(points):
        total = 0.0
        for k in range(points - 1, -1, -1):
            total = total * share + LAGRANGE[k, j]
        weights[row, j] = total


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
