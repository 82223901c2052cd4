# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A trajectory of the user's own: a table of time and position, as `reversal` and `recommend` take it; and the same
with the feed-forward in the effort of its points, as joint_trajectory_controller takes it.

The controller goes straight between points that have no velocity, along a cubic between points that have one, and
straight in the effort. Friction jumps where the motion turns round; so points are put in between where the effort would
be wrong otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml

from stickslip_ros.bags.table import Table, load_table
from stickslip_ros.bags.table_columns import POSITION, TIME, UNITS, USUAL_UNIT, Column
from stickslip_ros.cli.terminal import console_of_text
from stickslip_ros.errors import StickSlipError
from stickslip_ros.files import write_whole
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.friction import Friction
from stickslip_ros.monitoring.samples import FloatArray

_LEAST_POINTS = 3
_SINCE_1970 = 1e8  # [s]: so late a stamp is a date, and its unit is told by its size
_QUICKEST = 1e-3  # [s] in which the effort goes from one side to the other
_CLOSE = 0.01  # of the largest effort: what is not worth a point
_NANO = 1_000_000_000
Efforts = Callable[[FloatArray], FloatArray]


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


def _refuse_guessed_time(path: Path, uses: tuple[Column, ...], times: FloatArray) -> None:
    """Whole seconds look like milliseconds: what steps by one or more may be either."""
    for use in uses:
        if use.assumed and use.unit != "s" and not (times > _SINCE_1970).all():
            others = ", ".join(f"{use.name}_{unit}" for unit in UNITS[TIME])
            raise StickSlipError(
                f"trajectory {path}: the unit of its column {use.name!r} is not known; name it in the heading, "
                f"as one of {others}"
            )


def _tell_units(path: Path, table: Table, name: str) -> None:
    uses = [*table.time, table.joints[name][POSITION]]
    taken = [f"{use.name!r} in {use.unit or USUAL_UNIT[POSITION]}" for use in uses if use.assumed]
    if taken:
        console_of_text(stderr=True).print(
            f"{path}: took {' and '.join(taken)}; a heading such as time_ms or position_deg says another unit.",
            markup=False,
        )


def _with_effort(
    given: GivenTrajectory, friction: Friction, share: float
) -> tuple[FloatArray, FloatArray, FloatArray | None, FloatArray]:
    """Time from the start [s], position [rad], velocity [rad/s] (None where none was given) and effort [N·m] of points.

    Parameters
    ----------
    share : of the friction that is fed forward [1].
    """
    compensation = Compensation(friction=friction, feedforward=share)

    def efforts(velocity: FloatArray) -> FloatArray:
        return np.asarray(compensation.feedforward_torque(velocity), dtype=float)

    times = given.time - given.time[0]
    velocity = None
    if given.velocity is None:
        time, position, effort = _along_lines(times, given.position, efforts)
    else:
        time, position, velocity, effort = _along_cubics(times, given.position, given.velocity, efforts)
    if effort[-1] != 0.0:
        # The controller holds the last point, and would go on pushing.
        before = max(time[-1] - _QUICKEST, 0.5 * (time[-2] + time[-1]))
        place = len(time) - 1
        effort = np.append(effort, 0.0)
        position = np.insert(position, place, np.interp(before, time, position))
        velocity = None if velocity is None else np.insert(velocity, place, np.interp(before, time, velocity))
        time = np.insert(time, place, before)
    return time, position, velocity, effort


def write_trajectory(path: Path, given: GivenTrajectory, friction: Friction, share: float) -> int:
    """Write a trajectory_msgs/JointTrajectory as YAML; returns the number of points.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    time, position, velocity, effort = _with_effort(given, friction, share)
    points = []
    for index, instant in enumerate(np.rint(time * _NANO).astype(np.int64).tolist()):
        point: dict[str, object] = {"positions": [_rounded(position[index])]}
        if velocity is not None:
            point["velocities"] = [_rounded(velocity[index])]
        point["effort"] = [_rounded(effort[index])]
        point["time_from_start"] = {"sec": instant // _NANO, "nanosec": instant % _NANO}
        points.append(point)
    content = {"joint_names": [given.name], "points": points}
    text = yaml.safe_dump(content, default_flow_style=None, sort_keys=False, width=120)
    write_whole(path, "# trajectory_msgs/msg/JointTrajectory; rad, rad/s, N*m\n" + text)
    return len(points)


def _along_lines(
    times: FloatArray, positions: FloatArray, efforts: Efforts
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Between two points the effort is that of their speed; at each point it goes over to the next one."""
    gaps = np.diff(times)
    speeds = np.diff(positions) / gaps
    of_pieces = efforts(speeds)
    largest = float(np.abs(of_pieces).max())
    found = [(times[0], positions[0], of_pieces[0])]
    for index in range(1, len(times)):
        found.append((times[index], positions[index], of_pieces[index - 1]))
        if index < len(gaps) and abs(of_pieces[index] - of_pieces[index - 1]) > _CLOSE * largest:
            later = min(_QUICKEST, 0.5 * gaps[index])
            found.append((times[index] + later, positions[index] + later * speeds[index], of_pieces[index]))
    time, position, effort = np.array(found).T
    return time, position, effort


def _along_cubics(
    times: FloatArray, positions: FloatArray, velocities: FloatArray, efforts: Efforts
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Pieces are halved until the effort in their middle is that between their ends."""
    largest = max(float(np.abs(efforts(velocities)).max()), float(np.abs(efforts(np.gradient(positions, times))).max()))
    from scipy.interpolate import CubicHermiteSpline

    cubic = CubicHermiteSpline(times, positions, velocities)
    speed = cubic.derivative()
    found = []

    def at(time: float) -> tuple[float, float, float, float]:
        """Time, position, velocity and effort."""
        velocity = float(speed(time))
        return time, float(cubic(time)), velocity, float(efforts(np.array([velocity]))[0])

    for begin, end in pairwise(times.tolist()):
        pieces = [(at(begin), at(end))]
        while pieces:
            first, last = pieces.pop()
            middle = at(0.5 * (first[0] + last[0]))
            wrong = abs(middle[3] - 0.5 * (first[3] + last[3])) > _CLOSE * largest
            if wrong and last[0] - first[0] > _QUICKEST:
                pieces += [(middle, last), (first, middle)]
            else:
                found.append(first)
    found.append(at(float(times[-1])))
    time, position, velocity, effort = np.array(found).T
    return time, position, velocity, effort


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")
