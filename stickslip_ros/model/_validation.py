# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Range checks shared by the parameter classes; scalars and arrays alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.errors import InvalidParameterError


def require_positive(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite and > 0."""
    array = np.asarray(value, dtype=float)
    if not np.all(np.isfinite(array) & (array > 0)):
        raise InvalidParameterError(name, "finite and > 0", value)


def require_positive_or_infinite(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is > 0; infinity is."""
    if not np.all(np.asarray(value, dtype=float) > 0):
        raise InvalidParameterError(name, "> 0, or infinite", value)


def require_not_negative(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite and >= 0."""
    array = np.asarray(value, dtype=float)
    if not np.all(np.isfinite(array) & (array >= 0)):
        raise InvalidParameterError(name, "finite and >= 0", value)


def require_finite(name: str, value: ArrayLike) -> None:
    """Raise InvalidParameterError unless every element is finite."""
    if not np.all(np.isfinite(np.asarray(value, dtype=float))):
        raise InvalidParameterError(name, "finite", value)
