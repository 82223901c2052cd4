# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Each joint of a fleet over its recordings: how it is now, how it changes, which alarms ring."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from stickslip_ros.analysis.alarm import Alarm
from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.fleet_table import (
    Row,
    by_joint,
    dry_friction_name,
    rows_of,
    stick_slip_share,
    stuck_in,
    worst_status,
)
from stickslip_ros.analysis.judgement import JUDGED, SEVERITY
from stickslip_ros.analysis.trend import YEAR_2001, Measured, Trend, trend
from stickslip_ros.monitoring.detection.status import Status

# What is shorter says too little of a joint to be a point of its history: a few cycles of a slow one.
LEAST_MOVING = 5.0  # [s]


@dataclass(frozen=True, kw_only=True)
class Point:
    """A quantity in one recording, which is told by its number among the joint's."""

    recording: int
    measured: Measured


@dataclass(frozen=True, kw_only=True)
class History:
    """A quantity over the recordings that tell it, with its trend where their dates allow one."""

    points: tuple[Point, ...]
    trend: Trend | None

    @property
    def latest(self) -> float:
        """Value of the last recording that tells it; NaN if none does."""
        return self.points[-1].measured.value if self.points else math.nan


@dataclass(frozen=True, kw_only=True)
class FleetJoint:
    """One joint.

    Attributes
    ----------
    rows : its recordings, oldest first. dated : whether these have dates.
    status : in the last recording in which its motion could be judged, else in the last one. reason : for it.
    worst : that occurred in any. stuck_in : recordings in which stick-slip occurred.
    histories : by the names of :data:`stickslip_ros.analysis.alarm.QUANTITIES`. alarms : what rings, in words.
    """

    robot: str
    name: str
    rows: tuple[Row, ...]
    dated: bool
    status: Status
    reason: str
    worst: Status
    stuck_in: int
    stick_slip_share: float
    histories: dict[str, History]
    alarms: tuple[str, ...]

    @property
    def latest(self) -> Row:
        """Its last recording."""
        return self.rows[-1]


def fleet_joints(answers: Sequence[Answer], alarms: Sequence[Alarm] = ()) -> list[FleetJoint]:
    """All joints of all bags, the worst first: those with alarms, then by their share of stick-slip."""
    joints = [_joint(key, rows, alarms) for key, rows in by_joint(rows_of(answers)).items()]
    return sorted(joints, key=_badness)


def _badness(joint: FleetJoint) -> tuple[object, ...]:
    share = joint.stick_slip_share
    return (
        not joint.alarms,
        -share if math.isfinite(share) else 0.0,
        SEVERITY.index(joint.worst),
        joint.robot,
        joint.name,
    )


def _joint(key: tuple[str, str], rows: Sequence[Row], alarms: Sequence[Alarm]) -> FleetJoint:
    dated = all(row["recorded"] is not None and row["recorded"] > YEAR_2001 for row in rows)
    judged = [row for row in rows if Status(row["status"]) in JUDGED] or rows
    histories = {name: _history(rows, name, dated=dated) for name in ("stick_slip", "reserve")}
    histories |= {name: _history(rows, name, dated=dated) for name in ("coulomb", "stribeck", "viscous")}
    ringing = []
    for alarm in alarms:
        points = histories[alarm.quantity].points
        if points:
            ringing.append(alarm.rings(points[0].measured, points[-1].measured))
    return FleetJoint(
        robot=key[0],
        name=key[1],
        rows=tuple(rows),
        dated=dated,
        status=Status(judged[-1]["status"]),
        reason=judged[-1]["reason"] or "",
        worst=Status(worst_status(rows)),
        stuck_in=stuck_in(rows),
        stick_slip_share=stick_slip_share(rows),
        histories=histories,
        alarms=tuple(text for text in ringing if text),
    )


def _history(rows: Sequence[Row], name: str, *, dated: bool) -> History:
    points = []
    for number, row in enumerate(rows):
        if (row["moving_time"] or 0.0) >= LEAST_MOVING:
            found = _measured(row, name)
            if math.isfinite(found.value):
                points.append(Point(recording=number, measured=found))
    times = [rows[point.recording]["recorded"] for point in points]
    measured = [point.measured for point in points]
    line = trend(times, [one.value for one in measured], [one.error for one in measured]) if dated else None
    return History(points=tuple(points), trend=line)


def _measured(row: Row, name: str) -> Measured:
    """A quantity of one recording; NaN where it is not known, or is known per inertia only."""
    if name == "stick_slip":
        return Measured(value=_number(row["stick_slip_share"]))
    if name == "reserve":
        return Measured(value=_number(row["reserve"]))
    column = dry_friction_name(row) if name == "coulomb" else name
    if not column or not row[f"{column}_identified"] or row["per_inertia"]:
        return Measured()
    return Measured(value=_number(row[column]), error=_number(row[f"{column}_std"]))


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
