# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The report of one analysed recording."""

from __future__ import annotations

import math
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.judgement import NOT_JUDGED, SEVERITY
from stickslip_ros.analysis.report.page import write_page
from stickslip_ros.analysis.trend import YEAR_2001
from stickslip_ros.errors import optional_packages
from stickslip_ros.model.friction import JOINT_PARAMETERS, Gains
from stickslip_ros.model.units import unit_of
from stickslip_ros.monitoring.advice.compensations import CompensatedGains, compensation_advice
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.diagnosis import compensation_question, compensation_words

_MOST_SECTIONS = 12
_FEW_JOINTS = 2
_CYCLES_LISTED = 25
_COMPENSATED = 3  # sections that say what compensation buys, which takes a second each


@optional_packages("a page")
def write_report(path: Path, analysis: BagAnalysis) -> None:
    """Write the report of an analysis with traces.

    Raises
    ------
    StickSlipError
        If the package bokeh is missing.
    OSError
        If it cannot be written.
    """
    joints = list(analysis.joints.values())
    shown = [joint for joint in joints if words.matters(joint)]
    if len(joints) <= _FEW_JOINTS:
        shown = [joint for joint in joints if math.isfinite(joint.velocity)]
    shown = sorted(shown, key=_goodness)[:_MOST_SECTIONS]
    sections = [_section(joint, with_compensation=number < _COMPENSATED) for number, joint in enumerate(shown)]
    plots = [plot for section in sections for plot in section["plots"]]
    start = min((joint.start for joint in joints if math.isfinite(joint.start)), default=math.nan)
    end = max((joint.end for joint in joints if math.isfinite(joint.end)), default=math.nan)
    read = [text for name, topics in analysis.robots.items() for text in words.topics_read(name, topics)]
    write_page(
        path,
        "report.html",
        plots,
        title=f"Stick-slip in {Path(analysis.path).name}",
        when=f"{datetime.fromtimestamp(start, timezone.utc):%Y-%m-%d %H:%M:%S UTC, }" if start > YEAR_2001 else "",
        duration=end - start,
        read="; ".join(read),
        warnings=analysis.warnings,
        joints=joints,
        shown=shown,
        judged=sum(joint.status not in NOT_JUDGED for joint in joints),
        sticking=sorted((joint for joint in joints if joint.worst is Status.STICK_SLIP), key=_goodness),
        sections=sections,
        stick_slip=Status.STICK_SLIP,
        cycles_listed=_CYCLES_LISTED,
        words=words,
    )


def _goodness(joint: JointAnalysis) -> tuple[float, int, int]:
    """Puts joints in order, the one that stuck for the largest share of its moving time first."""
    share = joint.stick_slip_share
    return (-share if math.isfinite(share) else 0.0, SEVERITY.index(joint.worst), SEVERITY.index(joint.status))


def _section(joint: JointAnalysis, *, with_compensation: bool) -> dict[str, Any]:
    """What the page has of one joint, beside what it is in words."""
    from stickslip_ros.analysis.report.plots import PLOTS

    compensation: tuple[CompensatedGains, ...] = ()
    question = compensation_question(joint.assessment, joint.velocity, joint.settings.options.conditions)
    if with_compensation and question is not None:
        compensation = compensation_advice(question, with_limits=False)
    return {
        "joint": joint,
        "compensation": compensation,
        "compensation_words": compensation_words(compensation) if compensation else "",
        "plots": [plot for make in PLOTS if (plot := make(joint)) is not None],
        "parameters": _parameters(joint),
    }


def _parameters(joint: JointAnalysis) -> list[dict[str, Any]]:
    """The rows of parameters, each with its error where it was learnt."""
    state = joint.assessment
    rows: list[dict[str, Any]] = []
    estimate = state.estimate
    per_inertia = estimate.normalised if estimate is not None and estimate.usable else state.per_inertia
    for parameter in JOINT_PARAMETERS:
        name, unit = parameter.name, parameter.unit_where(per_inertia=per_inertia)
        label, source, value, error = parameter.label, "configured", math.nan, math.nan
        if estimate is not None and estimate.normalised and name in ("inertia", "coulomb"):
            continue
        if estimate is not None and estimate.usable:
            found = estimate[name]
            if name == "coulomb" and math.isfinite(estimate.coulomb_and_load.value):
                found, label = estimate.coulomb_and_load, "Coulomb friction with any load"
            value, error = found.value, found.std
            source = "the motion shows it" if found.identified else "the motion shows little of it"
        elif state.joint is not None:
            value = float(state.joint.inertia if name == "inertia" else getattr(state.joint.friction, name))
        if math.isfinite(value):
            rows.append({"meaning": label, "value": value, "unit": unit, "source": source, "error": error})
    if state.gains is not None:
        for meaning, name in (("stiffness k_p", "stiffness"), ("damping k_v", "damping")):
            value, source = float(getattr(state.gains, name)), "of the controller"
            unit = unit_of(Gains, name)
            rows.append({"meaning": meaning, "value": value, "unit": unit, "source": source, "error": math.nan})
    return rows
