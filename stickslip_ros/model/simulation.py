# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stick-slip cycles in dimensionless form, Eqs (14), (5) and (6): one joint or thousands of points in a call.

Steady commanded motion in one direction, begun by a joint that breaks away. Sampled motion of one joint in SI
units, with any reference, is :mod:`stickslip_ros.model.joint_simulation`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model import _cycle_kernel as kernel
from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.friction import Real

TOLERANCE = 1e-8  # tolerance of a slip's integration, of the level
_PLOT_REFINEMENT = 8.0  # steps of a slip that is plotted, of those of one that is not
_ROWS_A_CYCLE = 4096  # rows of the record for each cycle, 1: at most
_NO_RECORD = (np.empty((0, 4)), np.empty(0, dtype=np.int64))  # record of no rows, where none is wanted


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """Successive cycles, dimensionless; arrays of the points' shape + (cycles,), NaN once the cycle has died out.

    Attributes
    ----------
    slip_duration : ω t₁. slip_distance : (ω/x˙_s) times the distance slipped.
    dwell : ω t₂ of the sticking that follows the slip.
    breakaway_level, arrest_level : F*_s,b of the slip and F*_s,a at its end.
    """

    slip_duration: NDArray[np.float64]
    slip_distance: NDArray[np.float64]
    dwell: NDArray[np.float64]
    breakaway_level: NDArray[np.float64]
    arrest_level: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CycleTrajectory:
    """Motion through successive cycles of one joint, dimensionless; arrays of one length.

    Attributes
    ----------
    time : T = ωt since the first breakaway.
    position : ξ, relative to steady motion without Stribeck friction; velocity : x˙/x˙_s of the joint.
    shape : Ψ of Eq. (5); 1 while stuck.
    cycles : their summaries; the last slip may go on without an arrest.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    shape: NDArray[np.float64]
    cycles: Cycles


def simulate_cycles(
    groups: DimensionlessGroups,
    count: int,
    *,
    level: Real | None = None,
    tolerance: float = TOLERANCE,
    step_refinement: float = 1.0,
) -> Cycles:
    """Follow ``count`` cycles of every parameter point.

    Parameters
    ----------
    groups : scalars or arrays that broadcast; the natural frequency is not used. Velocity > 0.
    count : cycles to follow.
    level : F*_s,b at the first breakaway; default F*_s∞, full static friction.
    tolerance : steps are shortened until the friction's polynomial leaves over less than this share of it;
        infinite to take the steps as they are.
    step_refinement : by how much the longest steps are divided beforehand.

    Raises
    ------
    InvalidParameterError
        If a group or the level is not finite (the rise time may be infinite) or has the wrong sign.
    """
    shape, points = point_arrays(groups)
    if level is not None:
        require_not_negative("level", level)
    start = points[1] if level is None else np.broadcast_to(np.asarray(level, dtype=float), shape).ravel().copy()
    summaries = np.empty((points[0].size, count, kernel.CYCLE_COLUMNS))
    law = LAWS[groups.law]
    kernel.cycles(*points, law, start, float(step_refinement), float(tolerance), summaries, *_NO_RECORD)
    return _cycles(summaries.reshape(*shape, count, kernel.CYCLE_COLUMNS))


def simulate_trajectory(groups: DimensionlessGroups, count: int, *, level: float | None = None) -> CycleTrajectory:
    """Follow up to ``count`` cycles of one joint and return the motion; see :func:`simulate_cycles`."""
    shape, points = point_arrays(groups)
    if shape != ():
        raise InvalidParameterError("groups", "scalars", shape)
    start = points[1] if level is None else np.array([float(level)])
    found = np.empty((1, count, kernel.CYCLE_COLUMNS))
    record = np.empty((count * _ROWS_A_CYCLE, 4))
    rows = np.zeros(count, dtype=np.int64)
    slips = kernel.cycles(*points, LAWS[groups.law], start, _PLOT_REFINEMENT, TOLERANCE, found, record, rows)
    summaries = found[0]
    damping_ratio, velocity = float(points[0][0]), float(points[2][0])
    pieces: list[NDArray[np.float64]] = []
    clock, begin = 0.0, 0
    for slip in range(slips):
        breakaway = np.array(
            [[0.0, 2.0 * damping_ratio * velocity - summaries[slip, kernel.BREAKAWAY_LEVEL], -velocity, 1.0]]
        )
        piece = np.concatenate([breakaway, record[begin : rows[slip]]])
        begin = rows[slip]
        piece[:, 0] += clock
        pieces.append(piece)
        clock = float(piece[-1, 0]) + float(summaries[slip, kernel.DWELL])
    motion = np.concatenate(pieces)
    return CycleTrajectory(
        time=motion[:, 0],
        position=motion[:, 1],
        velocity=motion[:, 2] + velocity,
        shape=motion[:, 3],
        cycles=_cycles(summaries[:slips]),
    )


def point_arrays(groups: DimensionlessGroups) -> tuple[tuple[int, ...], list[NDArray[np.float64]]]:
    """Common shape of the groups, and ρ, F*_s∞, ξ˙_d, τ*, γ* as flat arrays of one length; checked.

    Raises
    ------
    InvalidParameterError
        As :func:`simulate_cycles`.
    """
    named = {name: np.asarray(getattr(groups, name), dtype=float) for name in _POINT}
    for name, array in named.items():
        allowed = array >= 0
        if name != "rise_time":
            allowed &= np.isfinite(array)
        if not allowed.all():
            raise InvalidParameterError(name, "finite and >= 0", getattr(groups, name))
    require_positive("velocity", named["velocity"])
    arrays = np.broadcast_arrays(*named.values())
    return arrays[0].shape, [array.ravel().astype(float) for array in arrays]


_POINT = ("damping_ratio", "stribeck", "velocity", "lag", "rise_time")


def _cycles(summaries: NDArray[np.float64]) -> Cycles:
    return Cycles(**{entry.name: summaries[..., column] for column, entry in enumerate(fields(Cycles))})
