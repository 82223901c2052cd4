# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's page: which joints of which robots stick, and how their friction changes over the weeks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.fleet_table import Row, by_joint, rows_of
from stickslip_ros.analysis.report.page import YEAR_2001, anchor, drawn, write_page

_WORST_FIRST = ("stick_slip", "at_risk", "smooth", "not_judged", "at_rest", "unknown")
_TRENDS = {
    "coulomb": "Coulomb friction [N·m]",
    "stribeck": "Stribeck friction [N·m]",
    "viscous": "Viscous friction [N·m·s/rad]",
}
_MOST_TRENDS = 40  # joints
_LEAST_POINTS = 2
_LEAST_SPAN = 0.2  # of the largest value, that an axis covers

Group = tuple[tuple[str, str], list[Row]]


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
    figures: list[Any] = []
    trends = "".join(_trend(key, some, figures) for key, some in ordered[:_MOST_TRENDS])
    body = f"{_header(answers, groups)}{_matrix(groups)}{_bags(rows)}{trends}"
    write_page(path, f"Stick slip in {len(answers)} recordings", body, figures)


def _badness(group: Group) -> tuple[Any, ...]:
    (robot, joint), rows = group
    worst = min(_WORST_FIRST.index(row["status"]) for row in rows)
    return (worst, -sum(row["sticking_time"] for row in rows), robot, joint)


def _header(answers: Sequence[Answer], groups: dict[tuple[str, str], list[Row]]) -> str:
    failed = sum("error" in found for found in answers)
    sticking = [key for key, rows in groups.items() if any(row["status"] == "stick_slip" for row in rows)]
    robots = {robot for robot, _ in groups}
    colour = "stick_slip" if sticking else "smooth"
    missing = f" <strong class='at_risk'>{failed} could not be analysed</strong> (listed below)." if failed else ""
    return (
        f"<h1>Stick slip in {len(answers)} recordings</h1>"
        f"<p class='faint'>{len(robots)} robots, {len(groups)} joints.{missing}</p>"
        f"<p><strong class='{colour}'>{len(sticking)} of {len(groups)} joints stuck and slipped</strong> at some time."
        "</p>"
    )


def _matrix(groups: dict[tuple[str, str], list[Row]]) -> str:
    robots = sorted({robot for robot, _ in groups})
    joints = sorted({joint for _, joint in groups})
    head = "".join(f"<th class='text'>{escape(joint)}</th>" for joint in joints)
    body = ""
    for robot in robots:
        cells = ""
        for joint in joints:
            rows = groups.get((robot, joint), [])
            if not rows:
                cells += "<td class='text faint'>–</td>"
                continue
            sticking = sum(row["status"] == "stick_slip" for row in rows)
            worst = min((row["status"] for row in rows), key=_WORST_FIRST.index)
            place = anchor(f"{robot}/{joint}")
            cells += (
                f"<td class='text'><a href='#{place}' class='chip {worst}'>"
                f"{escape(worst.replace('_', ' '))}</a> <span class='faint'>{sticking}/{len(rows)}</span></td>"
            )
        body += f"<tr><td>{escape(robot)}</td>{cells}</tr>"
    return (
        "<div class='scroll'><table><caption class='faint'>Worst status of each joint; in how many of its recordings "
        f"it stuck</caption><thead><tr><th>robot</th>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _bags(rows: Sequence[Row]) -> str:
    """Those that could not be read, and those of which something is missing."""
    errors = [row for row in rows if row["error"]]
    if not errors:
        return ""
    listed = "".join(f"<li>{escape(row['error'])}</li>" for row in errors)
    return f"<div class='warnings'><strong>Not analysed</strong><ul>{listed}</ul></div>"


def _trend(key: tuple[str, str], rows: Sequence[Row], figures: list[Any]) -> str:
    robot, joint = key
    shown = []
    for name, label in _TRENDS.items():
        points = [row for row in rows if row[name] is not None and row[f"{name}_identified"] and not row["per_inertia"]]
        if len(points) >= _LEAST_POINTS:
            shown.append(_figure(points, name, label, figures))
    if len(rows) >= _LEAST_POINTS:
        shown.append(_sticking(rows, figures))
    table = "".join(
        f"<tr><td>{escape(Path(row['bag']).name)}</td><td class='text'><span class='chip {row['status']}'>"
        f"{escape(row['status'].replace('_', ' '))}</span></td><td>{_number(row['sticking_time'])}</td>"
        f"<td>{_number(row['duration'])}</td><td>{row['cycles']}</td><td>{_number(row['velocity'])}</td>"
        f"<td>{_number(row['coulomb'])}</td><td>{_number(row['stribeck'])}</td><td>{_number(row['advised_stiffness'])}</td>"
        f"<td>{_number(row['advised_damping'])}</td></tr>"
        for row in rows
    )
    title, place = f"{escape(robot)} {escape(joint)}".strip(), anchor(f"{robot}/{joint}")
    return (
        f"<section id='{place}'><h2>{title}</h2><div class='pair'>{''.join(shown)}</div>"
        f"<details{'' if shown else ' open'}><summary>{len(rows)} recordings</summary><div class='scroll'><table>"
        "<thead><tr><th>recording</th><th class='text'>status</th><th>sticks [s]</th><th>of [s]</th><th>cycles</th>"
        "<th>speed [rad/s]</th><th>Coulomb [N·m]</th><th>Stribeck [N·m]</th><th>advised k_p</th><th>advised k_v</th>"
        f"</tr></thead><tbody>{table}</tbody></table></div></details></section>"
    )


def _axes(rows: Sequence[Row], label: str) -> tuple[Any, list[Any]]:
    """An empty figure and where the recordings stand on it: by date, or by number where there are no dates."""
    from stickslip_ros.analysis.report.plots import new_figure

    times = [row["recorded"] for row in rows]
    dated = all(time is not None and time > YEAR_2001 for time in times)
    kind = "datetime" if dated else "linear"
    plot = new_figure("date (UTC)" if dated else "recording", label, height=260, x_axis_type=kind)
    return plot, [1000.0 * float(time) for time in times] if dated else list(range(1, len(rows) + 1))


def _figure(rows: Sequence[Row], name: str, label: str, figures: list[Any]) -> str:
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
    figures.append(plot)
    said = f"{label.partition(' [')[0]} in {len(rows)} recordings: {values[0]:.3g} at first, {values[-1]:.3g} at last."
    return drawn(label, f"{said} Bars: two standard errors.")


def _sticking(rows: Sequence[Row], figures: list[Any]) -> str:
    from stickslip_ros.analysis.report.plots import RED

    label = "time spent sticking [%]"
    plot, at = _axes(rows, label)
    shares = [100.0 * row["sticking_time"] / row["duration"] if row["duration"] else 0.0 for row in rows]
    plot.line(at, shares, color=RED, alpha=0.4)
    plot.scatter(at, shares, size=7, color=RED)
    plot.y_range.start, plot.y_range.end = -2, 102
    figures.append(plot)
    return drawn("Time spent sticking [%]", f"{shares[0]:.0f} % at first, {shares[-1]:.0f} % at last.")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
