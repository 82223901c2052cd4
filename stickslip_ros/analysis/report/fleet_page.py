# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's page for triage: one table with a row a joint, the worst first; plots of the joint that is chosen."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import quote

from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.fleet_joints import FleetJoint, Row
from stickslip_ros.analysis.judgement import NOT_JUDGED
from stickslip_ros.analysis.report.page import Plot, number_text, percent_text, write_page
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.wording import counted
from stickslip_ros.visible import visible

# Plotted of the joint that is chosen: what it is called, and what its values are multiplied by.
_PLOTS = {
    "stick_slip": ("Stick-slip [% of moving time]", 100.0),
    "coulomb": ("Coulomb friction, with any load [N·m]", 1.0),
    "reserve": ("Damping reserve [%]", 100.0),
    "stribeck": ("Stribeck friction [N·m]", 1.0),
    "viscous": ("Viscous friction [N·m·s/rad]", 1.0),
}
_NOTHING = "–"
_WIDTH, _HEIGHT, _EDGE = 84.0, 20.0, 3.0  # pixels
_LEAST_SPAN = 0.2  # of the largest value, that the height covers: what hardly changes is to look so
_MOST_POINTS = 60


@dataclass(frozen=True, kw_only=True)
class _Cell:
    """A quantity: as text, as a number to sort by (NaN where there is none), and its history as a picture."""

    text: str
    sort: float
    spark: str = ""


def write_fleet_page(
    path: Path,
    answers: Sequence[Answer],
    joints: Sequence[FleetJoint],
    reports: Mapping[str, Path] | None = None,
    *,
    with_alarms: bool = False,
) -> None:
    """Write the page.

    Parameters
    ----------
    joints : of these answers. reports : a page of each bag, by the bag's path, that is linked to.
    with_alarms : whether alarms were asked for, so that none is worth a word.

    Raises
    ------
    ImportError
        If the package bokeh is missing.
    OSError
        If it cannot be written.
    """
    from markupsafe import Markup

    links = {bag: _link(page, path) for bag, page in (reports or {}).items()}
    dated = all(joint.dated for joint in joints)
    plots = _plots(dated=dated) if joints else []
    write_page(
        path,
        "fleet.html",
        plots,
        own_script="fleet.js",
        title=f"Stick-slip in {counted(len(answers), 'recording')}",
        robots=len({joint.robot for joint in joints}),
        lines=[_line(joint) for joint in joints],
        links=links,
        statuses=[status for status in Status if any(joint.status is status for joint in joints)],
        sticking=sum(joint.stuck_in > 0 for joint in joints),
        unjudged=sum(joint.worst in NOT_JUDGED for joint in joints),
        ringing=sum(bool(joint.alarms) for joint in joints) if with_alarms else None,
        failed=sum("error" in found for found in answers),
        errors=[found["error"] for found in answers if "error" in found],
        data=Markup(_script_text([_data(joint, links, dated=dated) for joint in joints])),
    )


def _line(joint: FleetJoint) -> dict[str, Any]:
    """A joint's row in the table."""
    line = joint.histories["coulomb"].trend
    change = line.relative if line is not None and math.isfinite(line.relative) else math.nan
    recorded = joint.latest["recorded"] if joint.dated else None
    advised = next((row for row in reversed(joint.rows) if row["advised_stiffness"] is not None), {})
    return {
        "joint": joint,
        "share": _cell(joint, "stick_slip", lambda share: percent_text(share).removesuffix(" %"), low=0.0, high=1.0),
        "coulomb": _cell(joint, "coulomb", number_text),
        "change": _Cell(text=number_text(100.0 * change, "+.1f"), sort=change),
        "change_is_sure": line is not None and line.significant and not math.isnan(change),
        "reserve": _cell(joint, "reserve", lambda reserve: number_text(100.0 * reserve, "+.0f")),
        "stiffness": _whole(advised.get("advised_stiffness")),
        "damping": _whole(advised.get("advised_damping")),
        "date": _Cell(text=_date(recorded), sort=math.nan if recorded is None else recorded),
    }


def _cell(
    joint: FleetJoint, name: str, text: Callable[[float], str], low: float = math.nan, high: float = math.nan
) -> _Cell:
    """The latest value of a quantity, and its history."""
    history = joint.histories[name]
    where = [_where(joint, recording) for recording in history.points]
    spark = sparkline(where, [point.value for point in history.points.values()], low=low, high=high)
    return _Cell(text=text(history.latest), sort=history.latest, spark=spark)


def _where(joint: FleetJoint, recording: int) -> float:
    """Where a recording stands on an axis: its date [s], or where there are no dates its number."""
    return float(joint.rows[recording]["recorded"]) if joint.dated else recording + 1.0


def _data(joint: FleetJoint, links: Mapping[str, str], *, dated: bool) -> dict[str, Any]:
    """What the page's script draws of a joint."""
    histories = {}
    for name, (_, scale) in _PLOTS.items():
        points = joint.histories[name].points
        histories[name] = {
            "at": [1000.0 * _where(joint, recording) if dated else recording + 1 for recording in points],
            "value": [_rounded(scale * one.value) for one in points.values()],
            "error": [_rounded(scale * one.error) if math.isfinite(one.error) else 0.0 for one in points.values()],
        }
    return {
        "title": visible(f"{joint.robot} {joint.name}".strip()),
        "histories": histories,
        "rows": [_recording(row, links) for row in reversed(joint.rows)],
    }


def _recording(row: Row, links: Mapping[str, str]) -> list[str]:
    """The cells of a recording in the table of the joint that is chosen; the last is a link, or nothing."""
    return [
        visible(Path(row["bag"]).name),
        _date(row["recorded"]),
        row["status"],
        row["worst_status"],
        percent_text(row["stick_slip_share"]),
        number_text(row["moving_time"], ".4g"),
        str(row["cycles"]),
        number_text(row["velocity"]),
        number_text(row["coulomb" if row["coulomb_identified"] else "coulomb_and_load"]),
        _whole(row["advised_stiffness"]),
        _whole(row["advised_damping"]),
        links.get(row["bag"], ""),
    ]


def _whole(value: float | None) -> str:
    """A gain: digits as people write them, never an exponent."""
    if value is None or not math.isfinite(value):
        return _NOTHING
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0
    return f"{value:.{min(digits, 6)}f}"


def _rounded(value: float) -> float:
    return float(f"{value:.5g}")


def _date(recorded: float | None) -> str:
    if recorded is None or not recorded > 0:
        return _NOTHING
    try:
        return datetime.fromtimestamp(recorded, timezone.utc).strftime("%Y-%m-%d")
    except (OverflowError, OSError, ValueError):
        return _NOTHING


def _link(page: Path, beside: Path) -> str:
    """From one page to another, as a browser takes it."""
    return quote(Path(os.path.relpath(page.resolve(), beside.resolve().parent)).as_posix())


def _script_text(data: Any) -> str:
    """JSON that may stand in a page: nothing in it ends the script."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c").replace("&", "\\u0026")


def _plots(*, dated: bool) -> list[Plot]:
    """Empty figures that the page's script fills."""
    from bokeh.models import ColumnDataSource, Range1d

    from stickslip_ros.analysis.report.plots import BLUE, RED, new_figure

    found = []
    for name, (label, _) in _PLOTS.items():
        plot = new_figure(
            "date (UTC)" if dated else "recording", None, height=240, x_axis_type="datetime" if dated else "linear"
        )
        plot.name = name
        plot.x_range, plot.y_range = Range1d(0, 1), Range1d(0, 1)
        source = ColumnDataSource({"at": [], "value": [], "low": [], "high": []}, name=f"{name} history")
        colour = RED if name == "stick_slip" else BLUE
        plot.segment("at", "low", "at", "high", source=source, color=colour, line_width=1.5, alpha=0.6)
        plot.line("at", "value", source=source, color=colour, alpha=0.4)
        plot.scatter("at", "value", source=source, size=7, color=colour)
        found.append(Plot(plot, label, f"{label} over the recordings of the chosen joint; bars: two standard errors."))
    return found


def sparkline(at: Sequence[float], values: Sequence[float], *, low: float = math.nan, high: float = math.nan) -> str:
    """A line through values, with a dot at the last; "" where there are fewer than two.

    Parameters
    ----------
    at : where the values stand, of shape (n,). low, high : ends of the axis; NaN: those of the values.
    """
    if len(values) < 2:
        return ""
    step = math.ceil(len(values) / _MOST_POINTS)
    # Thinned from behind, so that the last is there.
    at, values = list(at)[::-1][::step][::-1], list(values)[::-1][::step][::-1]
    largest = max(abs(value) for value in values)
    bottom = min(values) if math.isnan(low) else low
    top = max(values) if math.isnan(high) else high
    room = 0.5 * max(0.0, _LEAST_SPAN * largest - (top - bottom))
    bottom, top = bottom - room, top + room
    across, along = (top - bottom) or 1.0, (at[-1] - at[0]) or 1.0
    points = [
        (
            _EDGE + (_WIDTH - 2.0 * _EDGE) * (x - at[0]) / along,
            _HEIGHT - _EDGE - (_HEIGHT - 2.0 * _EDGE) * (min(max(y, bottom), top) - bottom) / across,
        )
        for x, y in zip(at, values, strict=True)
    ]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[-1]
    return (
        f'<svg class="spark" width="{_WIDTH:.0f}" height="{_HEIGHT:.0f}" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" '
        f'aria-hidden="true"><polyline points="{line}"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.2"/></svg>'
    )
