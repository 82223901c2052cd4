# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Linear least squares whose errors hold where the scatter is uneven, or neighbours repeat each other.

The covariance is that of MacKinnon and White, "Some heteroskedasticity-consistent covariance matrix estimators with
improved finite sample properties", Journal of Econometrics 29, 1985 (their third, HC3). Where a residual is like the
one before it, fewer count as observations of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.monitoring.samples import FloatArray

_MOST_ALIKE = 0.9  # correlation of neighbours, beyond which nothing is left to count
_LEAST_FREE = 0.05  # of an observation: what its own residual shows where the fit goes through it
_SINGULAR = 1e-10


@dataclass(frozen=True, kw_only=True)
class Regression:
    """A least-squares fit y = X b + e.

    Attributes
    ----------
    coefficients : b, shape (p,). covariance : of these, shape (p, p). residuals : e, shape (n,).
    scatter : standard deviation of the residuals, at least the error that was given.
    observations : how many of them count, neighbours that repeat each other being fewer.
    """

    coefficients: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    scatter: float
    observations: float

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals, at least one."""
        return max(int(self.observations) - len(self.coefficients), 1)

    def std(self, index: int) -> float:
        """Standard error of a coefficient."""
        return math.sqrt(max(float(self.covariance[index, index]), 0.0))

    def significance(self, index: int) -> float:
        """Probability that a coefficient which is zero is found as large as this, either way; Student's t."""
        std = self.std(index)
        return student_tail(abs(float(self.coefficients[index])) / std, self.freedom) if std > 0 else 1.0


def regression(columns: FloatArray, values: FloatArray, standard_error: float = 0.0) -> Regression:
    """Fit values in order of time.

    Parameters
    ----------
    columns : X, shape (n, p) with n > p. values : y, shape (n,).
    standard_error : that each value has at least, in units of y.
    """
    count, size = columns.shape
    left, sizes, right = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > _SINGULAR * sizes[0]
    inverse = (right[kept].T / sizes[kept]) @ left[:, kept].T
    coefficients = inverse @ values
    residuals = values - columns @ coefficients
    leverage = np.minimum((left[:, kept] ** 2).sum(axis=1), 1.0 - _LEAST_FREE)
    covariance = (inverse * (residuals / (1.0 - leverage)) ** 2) @ inverse.T
    variance = float(residuals @ residuals) / max(count - size, 1)
    if variance < standard_error**2:
        covariance, variance = standard_error**2 * inverse @ inverse.T, standard_error**2
    share = _own_share(residuals)
    return Regression(
        coefficients=coefficients,
        covariance=np.asarray(covariance / share),
        residuals=residuals,
        scatter=math.sqrt(variance),
        observations=count * share,
    )


def _own_share(residuals: FloatArray) -> float:
    """Share of the residuals that count for the mean, by how alike neighbours are: (1 − r)/(1 + r)."""
    total = float(residuals @ residuals)
    if len(residuals) < 3 or total <= 0:
        return 1.0
    alike = min(max(float(residuals[1:] @ residuals[:-1]) / total, 0.0), _MOST_ALIKE)
    return (1.0 - alike) / (1.0 + alike)


def student_tail(ratio: float, freedom: int) -> float:
    """Probability that Student's t of so many degrees of freedom is further from zero than a ratio.

    The finite series of Abramowitz and Stegun, Eqs 26.7.3 and 26.7.4.
    """
    angle = math.atan(ratio / math.sqrt(freedom))
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2
    term = total = cosine if odd else 1.0
    for number in range(2 + odd, freedom - 1, 2):
        term *= cosine**2 * (number - 1) / number
        total += term
    if freedom == 1:
        total = 0.0
    inside = (angle + sine * total) * 2.0 / math.pi if odd else sine * total
    return min(max(1.0 - inside, 0.0), 1.0)
