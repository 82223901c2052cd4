# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The report of one analysed recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime, timezone
from html import escape
from pathlib import Path
from typing import Any

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.report.page import YEAR_2001, anchor, drawn, write_page
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.friction_parameters import JOINT_PARAMETERS
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.detection.status import Status

_MATTERS = (Status.STICK_SLIP, Status.AT_RISK)
_MOST_SECTIONS = 12
_FEW_JOINTS = 2
_CYCLES_LISTED = 25


def write_report(path: Path, analysis: BagAnalysis) -> None:
    """Write the report of an analysis with traces.

    Raises
    ------
    StickSlipError
        If the package bokeh is missing.
    OSError
        If it cannot be written.
    """
    write_page(path, f"Stick slip in {Path(analysis.path).name}", *_body(analysis))


def _body(analysis: BagAnalysis) -> tuple[str, list[Any]]:
    joints = list(analysis.joints.values())
    shown = [joint for joint in joints if joint.status in _MATTERS]
    if len(joints) <= _FEW_JOINTS:
        shown = [joint for joint in joints if math.isfinite(joint.velocity)]
    shown = sorted(shown, key=lambda joint: (_MATTERS + tuple(Status)).index(joint.status))[:_MOST_SECTIONS]
    figures: list[Any] = []
    sections = "".join(_section(joint, figures) for joint in shown)
    return f"{_header(analysis)}\n{_overview(joints, shown)}\n{sections}", figures


def _header(analysis: BagAnalysis) -> str:
    sticking = [joint.name for joint in analysis.joints.values() if joint.status is Status.STICK_SLIP]
    verdict = (
        f"<strong class='stick_slip'>{len(sticking)} of {len(analysis.joints)} joints stick and slip</strong>: "
        f"{escape(', '.join(sticking))}."
        if sticking
        else f"<strong class='smooth'>None of {len(analysis.joints)} joints sticks and slips.</strong>"
    )
    start = min((joint.start for joint in analysis.joints.values()), default=math.nan)
    end = max((joint.end for joint in analysis.joints.values()), default=math.nan)
    when = datetime.fromtimestamp(start, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC, ") if start > YEAR_2001 else ""
    topics = analysis.topics
    read = [f"states from {topics.states.topic}"]
    read += [f"references from {channel.topic}" for channel in topics.references]
    read += [f"gains from {channel.topic}" for channel in topics.gains]
    warnings = "".join(f"<li>{escape(warning)}</li>" for warning in analysis.warnings)
    noted = f"<div class='warnings'><strong>What is missing</strong><ul>{warnings}</ul></div>" if warnings else ""
    return (
        f"<h1>Stick slip in {escape(Path(analysis.path).name)}</h1>"
        f"<p class='faint'>{when}{end - start:.4g} s; {escape('; '.join(read))}.</p><p>{verdict}</p>{noted}"
    )


def _overview(joints: Sequence[JointAnalysis], shown: Sequence[JointAnalysis]) -> str:
    rows = []
    for joint in joints:
        name = escape(joint.name)
        link = f"<a href='#{anchor(joint.name)}'>{name}</a>" if joint in shown else name
        rows.append(
            f"<tr><td>{link}</td><td class='text'><span class='chip {joint.status.value}'>{_status(joint)}</span></td>"
            f"<td>{joint.time_in(Status.STICK_SLIP):.3g}</td><td>{joint.duration:.4g}</td><td>{len(joint.cycles)}</td>"
            f"<td>{_number(joint.velocity)}</td><td>{_number(joint.usual_slip)}</td>"
            f"<td>{_number(100.0 * joint.reserve, '+.0f', ' %')}</td></tr>"
        )
    return (
        "<div class='scroll'><table><caption class='faint'>Every joint of the recording</caption><thead><tr>"
        "<th>joint</th><th class='text'>status</th><th>sticks [s]</th><th>of [s]</th><th>cycles</th>"
        "<th>speed [rad/s]</th><th>usual slip [rad]</th><th>reserve by Eq. (43)</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div>"
        "<p class='faint'>Reserve: damping in excess of what Eq. (43) asks for; below zero stick slip is predicted.</p>"
    )


def _section(joint: JointAnalysis, figures: list[Any]) -> str:
    from stickslip_ros.analysis.report import plots as report_plots

    plots = [plot for make in report_plots.PLOTS if (plot := make(joint)) is not None]
    figures += [plot.figure for plot in plots]
    shown = [drawn(plot.title, plot.caption) for plot in plots]
    # The first plot has the page's width; the others stand in pairs where there is room.
    return (
        f"<section id='{anchor(joint.name)}'><h2>{escape(joint.name)}: "
        f"<span class='chip {joint.status.value}'>{_status(joint)}</span></h2>"
        f"<p class='todo'>{escape(words.finding(joint))}<br><strong>{escape(words.advice(joint))}</strong></p>"
        f"{''.join(shown[:1])}<div class='pair'>{''.join(shown[1:])}</div>"
        f"{_parameters(joint)}{_cycles(joint)}</section>"
    )


def _parameters(joint: JointAnalysis) -> str:
    state = joint.assessment
    rows = []
    estimate = state.estimate
    per_inertia = estimate.normalised if estimate is not None and estimate.usable else state.per_inertia
    for parameter in JOINT_PARAMETERS:
        name, unit = parameter.name, parameter.unit_where(per_inertia=per_inertia)
        source, value, error = "configured", math.nan, math.nan
        if estimate is not None and estimate.normalised and name in ("inertia", "coulomb"):
            continue
        if estimate is not None and estimate.usable:
            found = estimate[name]
            value, error = found.value, found.std
            source = "the motion shows it" if found.identified else "the motion shows little of it"
        elif state.joint is not None:
            value = float(state.joint.inertia if name == "inertia" else getattr(state.joint.friction, name))
        if math.isfinite(value):
            spread = f"± {error:.2g}" if math.isfinite(error) else ""
            rows.append(
                f"<tr><td>{parameter.label}</td><td>{value:.4g}</td><td class='text'>{spread}</td>"
                f"<td class='text'>{unit}</td><td class='text'>{source}</td></tr>"
            )
    gains = state.gains
    if gains is not None:
        for label, number, unit in (
            ("stiffness k_p", gains.stiffness, unit_of(Gains, "stiffness")),
            ("damping k_v", gains.damping, unit_of(Gains, "damping")),
        ):
            rows.append(
                f"<tr><td>{label}</td><td>{float(number):.4g}</td><td></td><td class='text'>{unit}</td>"
                "<td class='text'>of the controller</td></tr>"
            )
    if not rows:
        return f"<p class='faint'>No friction parameters: {escape(state.margin_reason)}.</p>"
    basis = words.rests_on(joint)
    return (
        "<h3>Parameters</h3><div class='scroll'><table><thead><tr><th>parameter</th><th>value</th>"
        "<th class='text'>error</th><th class='text'>unit</th><th class='text'>known from</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div><p class='faint'>Margin and advice rest on: {escape(basis)}."
        f"{_exactly(joint)}</p>"
    )


def _exactly(joint: JointAnalysis) -> str:
    if joint.exact.smooth is None:
        return ""
    return f" Integrated, Eqs (4)-(6) say: {'smooth' if joint.exact.smooth else 'stick slip'}."


def _cycles(joint: JointAnalysis) -> str:
    if not joint.cycles:
        return ""
    rows = "".join(
        f"<tr><td>{cycle.breakaway - joint.start:.3f}</td><td>{cycle.dwell:.3f}</td><td>{cycle.slip_duration:.3f}</td>"
        f"<td>{cycle.slip_distance:.5g}</td><td>{_number(cycle.effort)}</td></tr>"
        for cycle in joint.cycles[:_CYCLES_LISTED]
    )
    more = len(joint.cycles) - _CYCLES_LISTED
    rest = f"<p class='faint'>and {more} more (stickslip analyze --csv lists all).</p>" if more > 0 else ""
    return (
        f"<details><summary>The cycles in numbers</summary><div class='scroll'><table><thead><tr>"
        "<th>breakaway [s]</th><th>dwell [s]</th><th>slip [s]</th><th>distance [rad]</th><th>effort [N·m]</th></tr>"
        f"</thead><tbody>{rows}</tbody></table></div>{rest}</details>"
    )


def _status(joint: JointAnalysis) -> str:
    return joint.status.value.replace("_", " ")


def _number(value: float, form: str = ".3g", unit: str = "") -> str:
    return f"{value:{form}}{unit}" if math.isfinite(value) else "–"
