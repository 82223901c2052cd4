# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A trajectory of the user's own: a table of time and position, as `reversal` and `recommend` take it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.bags.table import Table, Use, load_table
from stickslip_ros.bags.table_columns import POSITION, TIME, UNITS, USUAL_UNIT
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.errors import StickSlipError

FloatArray = NDArray[np.float64]
_LEAST_POINTS = 3
_SINCE_1970 = 1e8  # [s]: so late a stamp is a date, and its unit is told by its size


@dataclass(frozen=True, kw_only=True)
class GivenTrajectory:
    """Points that a joint is to pass.

    Attributes
    ----------
    name : of the joint, "joint1" where the table names none. time, position, velocity : of each point, shape (n,);
        the velocity is None where the table has none.
    """

    name: str
    time: FloatArray = field(metadata={"unit": "s"})
    position: FloatArray = field(metadata={"unit": "rad"})
    velocity: FloatArray | None = field(metadata={"unit": "rad/s"})


def read_trajectory(path: Path, name: str | None = None) -> GivenTrajectory:
    """The points of a table of one joint; which units were taken where no column says them is told on stderr.

    Parameters
    ----------
    name : of the joint; None: as the table has it.

    Raises
    ------
    StickSlipError
        If the table cannot be read, has several joints or less than three points, times that do not grow, or a time
        whose unit can only be guessed.
    """
    table = load_table(path)
    if len(table.batches) != 1:
        raise StickSlipError(f"trajectory {path}: has the joints {', '.join(table.batches)}; leave the columns of one")
    ((own, batch),) = table.batches.items()
    usable = np.isfinite(batch.time) & np.isfinite(batch.position)
    times, positions = batch.time[usable], batch.position[usable]
    _refuse_guessed_time(path, table.time, times)
    if len(times) < _LEAST_POINTS or not (np.diff(times) > 0).all():
        raise StickSlipError(f"trajectory {path}: needs three times or more, each later than the one before")
    velocity = batch.velocity if "velocity" in table.joints[own] else None
    _tell_units(path, table, own)
    return GivenTrajectory(
        name=name or own,
        time=times,
        position=positions,
        velocity=None if velocity is None else np.asarray(velocity, dtype=float)[usable],
    )


def _refuse_guessed_time(path: Path, uses: tuple[Use, ...], times: FloatArray) -> None:
    """Whole seconds look like milliseconds: what steps by one or more may be either."""
    for use in uses:
        if use.assumed and use.unit != "s" and not (times > _SINCE_1970).all():
            others = ", ".join(f"{use.column}_{unit}" for unit in UNITS[TIME])
            raise StickSlipError(
                f"trajectory {path}: the unit of its column {use.column!r} is not known; name it in the heading, "
                f"as one of {others}"
            )


def _tell_units(path: Path, table: Table, name: str) -> None:
    uses = [*table.time, table.joints[name][POSITION]]
    taken = [f"{use.column!r} in {use.unit or USUAL_UNIT[POSITION]}" for use in uses if use.assumed]
    if taken:
        Terminal(stderr=True, highlight=False, soft_wrap=True).print(
            f"{path}: took {' and '.join(taken)}; a heading such as time_ms or position_deg says another unit.",
            markup=False,
        )
