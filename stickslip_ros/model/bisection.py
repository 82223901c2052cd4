# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bisection of a boundary that a scan has found. Compiled kernels have their own: they can be handed no function."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Arguments = TypeVar("Arguments", float, NDArray[np.float64])
Apart = Callable[[float, float], bool]


def bisected(
    holds: Callable[[Arguments], Any], inside: Arguments, outside: Arguments, steps: int
) -> tuple[Arguments, Arguments]:
    """Arguments on both sides of a boundary, each halfway nearer ``steps`` times.

    Parameters
    ----------
    holds : whether something is so at an argument, or at each of an array. inside : where it is. outside : where not.
    """
    for _ in range(steps):
        middle = 0.5 * (inside + outside)
        if isinstance(middle, float):
            inside, outside = (middle, outside) if holds(middle) else (inside, middle)
        else:
            so = holds(middle)
            inside, outside = np.where(so, middle, inside), np.where(so, outside, middle)
    return inside, outside


def bisected_until(
    holds: Callable[[float], bool], inside: float, outside: float, apart: Apart, *, geometric: bool = False
) -> tuple[float, float]:
    """The same as long as both sides are too far ``apart``; ``geometric`` : by ratios, after a logarithmic scan."""
    while apart(inside, outside):
        middle = math.sqrt(inside * outside) if geometric else 0.5 * (inside + outside)
        inside, outside = (middle, outside) if holds(middle) else (inside, middle)
    return inside, outside


def first_reached(
    holds: Callable[[float], bool | None], tried: Iterable[float], apart: Apart, *, geometric: bool = False
) -> tuple[float | None, float | None]:
    """First of several arguments at which something is so, and the last one before it at which it is not, bisected.

    Parameters
    ----------
    holds : whether it is so; None where that is not known. tried : in the order in which they are tried.
    apart, geometric : of :func:`bisected_until`.

    Returns
    -------
    None for an argument that there is not among those that are tried.
    """
    before = None
    for argument in tried:
        found = holds(argument)
        if found and before is not None:
            return bisected_until(lambda middle: holds(middle) is True, argument, before, apart, geometric=geometric)
        if found:
            return argument, None
        before = before if found is None else argument
    return None, before


def nearest_to_zero(
    holds: Callable[[NDArray[np.float64]], NDArray[np.bool_]], grid: NDArray[np.float64], steps: int
) -> float | None:
    """The argument nearest to zero at which something is so, bisected ``steps`` times; None if it is at none of a grid.

    Parameters
    ----------
    holds : whether it is so at each of an array. grid : ascending, shape (n,).
    """
    good = np.flatnonzero(holds(grid))
    if len(good) == 0:
        return None
    nearest = int(good[np.argmin(np.abs(grid[good]))])
    inside = float(grid[nearest])
    outside = float(grid[min(max(nearest - int(np.sign(inside)), 0), len(grid) - 1)])
    return bisected(lambda middle: holds(np.array([middle]))[0], inside, outside, steps)[0]
