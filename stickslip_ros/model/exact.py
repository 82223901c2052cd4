# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact boundary: integrate Eqs (4)-(6) from a stuck joint and see whether the cycle persists.

Eq. (43) is an approximation, mostly a conservative one; this is what it approximates. "Persists" is decided on the
map from one breakaway level to the next, which converges geometrically; see ``_cycle_kernel``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import _outcome_kernel as kernel
from stickslip_ros.model._cycle_kernel import LARGEST_DAMPING_RATIO as _LARGEST
from stickslip_ros.model._cycle_kernel import NO_ANSWER, PERSISTS
from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.model.bisection import first_reached
from stickslip_ros.model.dimensionless import (
    STIFFNESS_DECADES,
    VELOCITY_DECADES,
    DimensionlessGroups,
    dimensionless_groups,
    stiffness_of_lag,
    stiffness_scale,
    unwrapped,
)
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.simulation import point_arrays

LARGEST_DAMPING_RATIO: float = _LARGEST
_TOLERANCE = 1e-3  # error of a boundary, of the boundary
_CHUNK = 64  # points that a thread computes at once, 1: a thread costs more than a joint's verdict
_LARGEST_STRIBECK = 30.0  # F*_s∞, 1: the search for a stiffness begins there
_SCAN_STEPS_A_DECADE = 12  # steps of a scan for each decade, 1

Progress = Callable[[int, int], None]


def cycle_persists(groups: DimensionlessGroups, *, full_accuracy: bool = True) -> Real:
    """Whether stick-slip, begun from a stuck joint with full static friction, goes on for ever.

    With a long lag the cycle may take thousands of natural periods to die out. Without ``full_accuracy`` a cycle that
    goes on for hundreds of periods counts as one that goes on for ever.

    Returns
    -------
    1.0 if it does, 0.0 if it dies out, NaN where the integration is refused (a damping ratio beyond 20, or
    friction or speed too sharp); of the groups' common shape.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.simulation.simulate_cycles`.
    """
    verdicts = evaluate(kernel.PERSISTENCE if full_accuracy else kernel.COARSE_PERSISTENCE, groups)[..., 0]
    return unwrapped(np.where(verdicts == NO_ANSWER, np.nan, verdicts == PERSISTS))


def exact_critical_damping_ratio(
    groups: DimensionlessGroups,
    *,
    tolerance: float = _TOLERANCE,
    workers: int = 1,
    progress: Progress | None = None,
) -> Real:
    """Damping ratio at which the cycle just dies out, the other groups as they are.

    Parameters
    ----------
    groups : scalars or arrays that broadcast; the damping ratio is not used.
    tolerance : relative, of the bisection.
    workers : threads that share the points.
    progress : called with the numbers of points done and of all.

    Returns
    -------
    0 where the cycle dies undamped, NaN where even a damping ratio of 20 does not end it or the integration is
    refused; of the groups' common shape.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.simulation.simulate_cycles`.
    """
    undamped = groups.undamped
    paper = np.asarray(critical_damping_ratio(undamped), dtype=float)
    guesses = np.where((paper > 0) & np.isfinite(paper), paper, 0.3)
    return unwrapped(evaluate(kernel.CRITICAL_RATIO, undamped, guesses, tolerance, workers, progress)[..., 0])


def evaluate(
    question: int,
    groups: DimensionlessGroups,
    guesses: Real = math.nan,
    tolerance: float = _TOLERANCE,
    workers: int = 1,
    progress: Progress | None = None,
) -> NDArray[np.float64]:
    """The kernel's answers to one of its questions, of the groups' common shape + (starts,).

    Parameters
    ----------
    guesses : that the question goes by, of a shape that broadcasts. workers : threads that share the points.
    progress : called with the numbers of points done and of all.
    """
    shape, points = point_arrays(groups)
    begin_at = np.broadcast_to(np.asarray(guesses, dtype=float), shape).ravel().copy()
    count = points[0].size
    found = np.empty((count, kernel.STARTS))
    parts = [slice(begin, min(begin + _CHUNK, count)) for begin in range(0, count, _CHUNK)]

    def work(part: slice) -> int:
        few = [values[part] for values in points]
        kernel.answer(question, *few, LAWS[groups.law], begin_at[part], LARGEST_DAMPING_RATIO, tolerance, found[part])
        return len(few[0])

    done = 0
    with ThreadPoolExecutor(max_workers=workers) as pool:
        # A thread costs more than a joint's verdict.
        sizes = map(work, parts) if workers == 1 or len(parts) == 1 else pool.map(work, parts)
        try:
            for size in sizes:
                done += size
                if progress is not None:
                    progress(done, count)
        finally:
            # After an exception the parts that nobody has begun are left out.
            pool.shutdown(wait=False, cancel_futures=True)
    return found.reshape(*shape, kernel.STARTS)


def exact_lowest_smooth_velocity(joint: Joint, gains: Gains) -> float:
    """Speed [rad/s] from which on the cycle dies out at this and every higher speed; scalars only.

    Scanned on a logarithmic grid from 1000 x˙_s down to a thousandth of it, then bisected. 0 if every speed is
    smooth, infinite if the highest is not, NaN where there is no answer.
    """
    own = float(joint.friction.stribeck_velocity)
    low, high = (own * 10.0**decade for decade in VELOCITY_DECADES)
    return _boundary(lambda velocity: dimensionless_groups(joint, gains, velocity), _grid(high, low), 1.0)


def exact_least_smooth_stiffness(joint: Joint, velocity: float, *, damping: float = 0.0) -> float:
    """Least stiffness k_p [N·m/rad] at which the cycle dies out, at a fixed damping k_v; scalars only.

    Scanned upwards from the stiffness at which F*_s∞ = 30 to where τ* = 2π, without lag eight decades above that
    at which F*_s∞ = 1. 0 if the cycle dies already at the lower end, infinite if it persists throughout, NaN where
    there is no answer. Much stiffer joints may stick again: with a lag near a natural period the falling part of
    the Stribeck curve feeds an oscillation.
    """
    own = float(stiffness_scale(joint))
    low, high = own / _LARGEST_STRIBECK**2, min(own * 10.0**STIFFNESS_DECADES, float(stiffness_of_lag(joint)))
    return _boundary(
        lambda stiffness: dimensionless_groups(joint, Gains(stiffness=stiffness, damping=damping), velocity),
        _grid(min(low, 0.1 * high), high),
        0.0,
    )


def _grid(start: float, end: float) -> list[float]:
    count = math.ceil(_SCAN_STEPS_A_DECADE * abs(math.log10(end / start)))
    return [float(value) for value in np.geomspace(start, end, count + 1)]


def _boundary(groups_at: Callable[[float], DimensionlessGroups], grid: list[float], wanted: float) -> float:
    """Argument at which :func:`cycle_persists` first becomes ``wanted`` along the grid.

    Where that is at its beginning, or nowhere: the smooth side's 0, the other's infinity.
    """

    def reached(argument: float) -> bool | None:
        with np.errstate(all="ignore"):
            groups = groups_at(argument)
        values = [float(value) for value in groups.numbers]
        if not all(math.isfinite(value) and value >= 0 for value in values) or groups.velocity == 0:
            return None
        persists = float(cycle_persists(groups))
        return None if math.isnan(persists) else persists == wanted

    argument, before = first_reached(
        reached, grid, lambda inside, outside: abs(outside - inside) > _TOLERANCE * inside, geometric=True
    )
    if argument is None and before is None:
        return math.nan
    if argument is None or before is None:
        return 0.0 if (argument is None) == (wanted == 1.0) else math.inf
    return argument if wanted == 0.0 else before
