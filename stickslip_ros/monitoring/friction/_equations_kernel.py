# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled parts of the Gauss-Newton equations; :mod:`.slip_equations` is their face."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import kernel


@kernel(nogil=True)
def collect_own(slip_of, weights, residuals, own, shared, mixed, diagonal, slope):
    """Add every observation to the equations of its slip's own unknowns.

    Slopes ``own`` by these, of shape (m, u), and ``shared`` by the parameters, (m, c), weighted, go to ``diagonal`` of
    shape (slips, u, u), ``mixed`` of (slips, u, c), and with the residuals to ``slope`` of (slips, u).
    """
    for m in range(slip_of.shape[0]):
        n = slip_of[m]
        for a in range(own.shape[1]):
            weighted = weights[m] * own[m, a]
            slope[n, a] -= weighted * residuals[m]
            for b in range(own.shape[1]):
                diagonal[n, a, b] += weighted * own[m, b]
            for c in range(shared.shape[1]):
                mixed[n, a, c] += weighted * shared[m, c]


@kernel(nogil=True)
def solve_band(band, right):
    """Solve, in place, equations of whose positive definite matrix ``band`` has the lower diagonals, (width, n).

    ``right`` of shape (n, k) becomes the solutions, ``band`` the root. False if the matrix is not positive definite.
    """
    width, size = band.shape
    for i in range(size):
        for back in range(min(i, width - 1), -1, -1):
            j = i - back
            total = band[back, j]
            for k in range(max(0, i - width + 1), j):
                total -= band[i - k, k] * band[j - k, k]
            if back > 0:
                band[back, j] = total / band[0, j]
            elif total > 0.0 and total < np.inf:
                band[0, i] = math.sqrt(total)
            else:
                return False
    for i in range(size):
        for back in range(1, min(i, width - 1) + 1):
            for c in range(right.shape[1]):
                right[i, c] -= band[back, i - back] * right[i - back, c]
        for c in range(right.shape[1]):
            right[i, c] /= band[0, i]
    for i in range(size - 1, -1, -1):
        for ahead in range(1, min(size - 1 - i, width - 1) + 1):
            for c in range(right.shape[1]):
                right[i, c] -= band[ahead, i] * right[i + ahead, c]
        for c in range(right.shape[1]):
            right[i, c] /= band[0, i]
    return True
