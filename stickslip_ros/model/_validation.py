# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Range checks shared by the parameter classes; scalars and arrays alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stickslip_ros.errors import InvalidParameterError


def require_positive(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite and > 0."""
    array = np.asarray(value, dtype=float)
    _require(name, "finite and > 0", value, np.isfinite(array) & (array > 0))


def require_positive_or_infinite(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is > 0; infinity is."""
    _require(name, "> 0, or infinite", value, np.asarray(value, dtype=float) > 0)


def require_not_negative(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite and >= 0."""
    array = np.asarray(value, dtype=float)
    _require(name, "finite and >= 0", value, np.isfinite(array) & (array >= 0))


def require_finite(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite."""
    _require(name, "finite", value, np.isfinite(np.asarray(value, dtype=float)))


def _require(name: str, requirement: str, value: ArrayLike, fulfilled: NDArray[np.bool_]) -> None:
    """Raise InvalidParameterError with the value, of an array with the first that is not right."""
    if not np.all(fulfilled):
        wrong = np.asarray(value, dtype=float)[~np.asarray(fulfilled)]
        raise InvalidParameterError(name, requirement, value if np.ndim(value) == 0 else float(wrong[0]))
