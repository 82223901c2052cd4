# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's page: which joints of which robots stick, and how their friction changes over the weeks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.analysis.data_problems import NOT_JUDGED
from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.fleet_table import (
    Row,
    by_joint,
    rows_of,
    stick_slip_share,
    stuck_in,
    usual_status,
    worst_status,
)
from stickslip_ros.analysis.judgement import SEVERITY
from stickslip_ros.analysis.report.page import YEAR_2001, Plot, write_page
from stickslip_ros.analysis.words import percent
from stickslip_ros.monitoring.detection.status import Status

_TRENDS = {
    "coulomb": "Coulomb friction [N·m]",
    "coulomb_and_load": "Coulomb friction and load [N·m]",
    "stribeck": "Stribeck friction [N·m]",
    "viscous": "Viscous friction [N·m·s/rad]",
}
_MOST_TRENDS = 40  # joints
_LEAST_POINTS = 2
_LEAST_SPAN = 0.2  # of the largest value, that an axis covers

Group = tuple[tuple[str, str], list[Row]]


@dataclass(frozen=True, kw_only=True)
class _Cell:
    """A joint's status, its share of stick slip, its worst status, and in how many of its recordings it stuck."""

    status: str
    share: float
    worst: str
    sticking: int
    recordings: int


@dataclass(frozen=True, kw_only=True)
class _Trend:
    """A joint over its recordings."""

    robot: str
    joint: str
    rows: list[Row]
    plots: list[Plot]


def write_fleet_page(path: Path, answers: Sequence[Answer]) -> None:
    """Write the page.

    Raises
    ------
    StickSlipError
        If the package bokeh is missing.
    OSError
        If it cannot be written.
    """
    rows = rows_of(answers)
    groups = by_joint(rows)
    ordered = sorted(groups.items(), key=_badness)
    trends = [_trend(key, some) for key, some in ordered[:_MOST_TRENDS]]
    matrix = {key: _cell(some) for key, some in groups.items()}
    write_page(
        path,
        "fleet.html",
        [plot for trend in trends for plot in trend.plots],
        title=f"Stick slip in {len(answers)} recordings",
        count=len(groups),
        robots=sorted({robot for robot, _ in groups}),
        joints=sorted({joint for _, joint in groups}),
        sticking=sum(cell.sticking > 0 for cell in matrix.values()),
        unjudged=sum(Status(cell.worst) in NOT_JUDGED for cell in matrix.values()),
        matrix=matrix,
        failed=sum("error" in found for found in answers),
        errors=[row["error"] for row in rows if row["error"]],
        trends=trends,
    )


def _badness(group: Group) -> tuple[Any, ...]:
    (robot, joint), rows = group
    share = stick_slip_share(rows)
    severity = [status.value for status in SEVERITY]
    return (-share if math.isfinite(share) else 0.0, severity.index(worst_status(rows)), robot, joint)


def _cell(rows: Sequence[Row]) -> _Cell:
    return _Cell(
        status=usual_status(rows),
        share=stick_slip_share(rows),
        worst=worst_status(rows),
        sticking=stuck_in(rows),
        recordings=len(rows),
    )


def _trend(key: tuple[str, str], rows: list[Row]) -> _Trend:
    plots = []
    for name, label in _TRENDS.items():
        points = [row for row in rows if row[name] is not None and row[f"{name}_identified"] and not row["per_inertia"]]
        if len(points) >= _LEAST_POINTS:
            plots.append(_friction(points, name, label))
    if len(rows) >= _LEAST_POINTS:
        plots.append(_sticking(rows))
    return _Trend(robot=key[0], joint=key[1], rows=rows, plots=plots)


def _axes(rows: Sequence[Row], label: str) -> tuple[Any, list[Any]]:
    """An empty figure and where the recordings stand on it: by date, or by number where there are no dates."""
    from stickslip_ros.analysis.report.plots import new_figure

    times = [row["recorded"] for row in rows]
    dated = all(time is not None and time > YEAR_2001 for time in times)
    kind = "datetime" if dated else "linear"
    plot = new_figure("date (UTC)" if dated else "recording", label, height=260, x_axis_type=kind)
    return plot, [1000.0 * float(time) for time in times] if dated else list(range(1, len(rows) + 1))


def _friction(rows: Sequence[Row], name: str, label: str) -> Plot:
    from stickslip_ros.analysis.report.plots import BLUE

    plot, at = _axes(rows, label)
    values = np.array([row[name] for row in rows])
    errors = np.array([row[f"{name}_std"] or 0.0 for row in rows])
    plot.segment(at, values - 2.0 * errors, at, values + 2.0 * errors, color=BLUE, line_width=1.5, alpha=0.6)
    plot.line(at, values, color=BLUE, alpha=0.4)
    plot.scatter(at, values, size=7, color=BLUE)
    # What hardly changes is to look so.
    low, high = float((values - 2.0 * errors).min()), float((values + 2.0 * errors).max())
    room = max(0.05 * (high - low), 0.5 * (_LEAST_SPAN * float(np.abs(values).max()) - (high - low)))
    plot.y_range.start, plot.y_range.end = low - room, high + room
    said = f"{label.partition(' [')[0]} in {len(rows)} recordings: {values[0]:.3g} at first, {values[-1]:.3g} at last."
    return Plot(plot, label, f"{said} Bars: two standard errors.")


def _sticking(rows: Sequence[Row]) -> Plot:
    from stickslip_ros.analysis.report.plots import RED

    label = "stick slip [% of moving time]"
    plot, at = _axes(rows, label)
    shares = [100.0 * (row["stick_slip_share"] or 0.0) for row in rows]
    plot.line(at, shares, color=RED, alpha=0.4)
    plot.scatter(at, shares, size=7, color=RED)
    plot.y_range.start, plot.y_range.end = -2, 102
    said = f"{percent(shares[0] / 100.0)} at first, {percent(shares[-1] / 100.0)} at last."
    return Plot(plot, "Stick slip [% of moving time]", said)
