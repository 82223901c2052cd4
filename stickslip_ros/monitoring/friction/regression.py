# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Linear least squares whose errors hold where the scatter is uneven, or neighbours repeat each other.

The covariance is that of MacKinnon and White, "Some heteroskedasticity-consistent covariance matrix estimators with
improved finite sample properties", Journal of Econometrics 29, 1985 (their third, HC3). Where a residual is like the
one before it, only what is new in each counts (Prais and Winsten 1954).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.monitoring.samples import FloatArray

SIGNIFICANT_ERRORS = 4.0  # difference, standard errors: a larger one is no accident
_LARGEST_AUTOCORRELATION = 0.9  # correlation of neighbours, 1: beyond it nothing is left to count
_LEAST_FREE = 0.05  # own residual, of an observation: at least, where the fit goes through it
_SINGULAR = 1e-10  # singular value, of the largest: a smaller one is none


@dataclass(frozen=True, kw_only=True)
class Regression:
    """A least-squares fit y = X b + e.

    Attributes
    ----------
    coefficients : b, shape (p,). covariance : of these, shape (p, p). residuals : e, shape (n,).
    scatter : standard deviation of the residuals, at least the error that was given.
    autocorrelation : correlation of each residual with the one before it, from 0 to 0.9.
    """

    coefficients: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    scatter: float
    autocorrelation: float

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals, at least one."""
        return max(len(self.residuals) - len(self.coefficients), 1)

    def std(self, index: int) -> float:
        """Standard error of a coefficient."""
        return math.sqrt(max(float(self.covariance[index, index]), 0.0))

    def significance(self, index: int) -> float:
        """Probability that a coefficient which is zero is found as large as this, either way; Student's t."""
        # scipy loads slowly, and most uses of this package have no use for it.
        from scipy.special import stdtr

        std = self.std(index)
        return 2.0 * float(stdtr(self.freedom, -abs(float(self.coefficients[index])) / std)) if std > 0 else 1.0


def regression(columns: FloatArray, values: FloatArray, standard_error: float = 0.0) -> Regression:
    """Fit values in order of time.

    Parameters
    ----------
    columns : X, shape (n, p) with n > p. values : y, shape (n,).
    standard_error : that each value has at least, in units of y.
    """
    autocorrelation = _autocorrelation(values - columns @ (_solved(columns)[0] @ values))
    new, new_values = prewhitened(columns, autocorrelation), prewhitened(values, autocorrelation)
    inverse, leverage = _solved(new)
    coefficients = inverse @ new_values
    left = new_values - new @ coefficients
    residuals = values - columns @ coefficients
    free = max(len(values) - columns.shape[1], 1)
    covariance = (inverse * (left / (1.0 - np.minimum(leverage, 1.0 - _LEAST_FREE))) ** 2) @ inverse.T
    if float(left @ left) < free * standard_error**2:
        covariance = standard_error**2 * inverse @ inverse.T
    return Regression(
        coefficients=coefficients,
        covariance=np.asarray(covariance),
        residuals=residuals,
        scatter=max(math.sqrt(float(residuals @ residuals) / free), standard_error),
        autocorrelation=autocorrelation,
    )


def prewhitened(values: FloatArray, autocorrelation: float) -> FloatArray:
    """Rows prewhitened by the lag-1 autocorrelation; of the same shape."""
    first = math.sqrt(1.0 - autocorrelation**2) * values[:1]
    return np.concatenate([first, values[1:] - autocorrelation * values[:-1]])


def _solved(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Generalised inverse, shape (p, n), and the leverage of each row, shape (n,)."""
    left, sizes, right = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > _SINGULAR * sizes[0]
    return np.asarray((right[kept].T / sizes[kept]) @ left[:, kept].T), np.asarray((left[:, kept] ** 2).sum(axis=1))


def _autocorrelation(residuals: FloatArray) -> float:
    """Lag-1 autocorrelation r of residuals; that of few is (1 + 3 r)/n too small (Kendall 1954)."""
    total = float(residuals @ residuals)
    seen = float(residuals[1:] @ residuals[:-1]) / total if total > 0 else 0.0
    return min(seen + (1.0 + 3.0 * seen) / len(residuals), _LARGEST_AUTOCORRELATION) if seen > 0 else 0.0
