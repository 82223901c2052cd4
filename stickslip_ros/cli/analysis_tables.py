# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip analyze` prints: one bag's joints, or a fleet's."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.data_problems import lacks_data
from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.fleet_table import by_joint, rows_of
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.monitoring.detection.status import Status

_COLOURS = {"stick_slip": "red", "at_risk": "yellow", "smooth": "green"}
_WIDTH = 120
_TALKED_OF = (Status.STICK_SLIP, Status.AT_RISK, Status.UNKNOWN)


def print_analysis(analysis: BagAnalysis) -> None:
    """One bag: a row for each joint, then in words what matters."""
    console = _console()
    console.print(f"[bold]{analysis.path}[/]", soft_wrap=True)
    table = Table(box=None, padding=(0, 1))
    for heading in ("joint\n", "status\n"):
        table.add_column(heading, no_wrap=True)
    for heading in ("sticks\n[s]", "of\n[s]", "cycles\n", "speed\n[rad/s]", "slip\n[rad]", "reserve\n", "exactly\n"):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    for joint in analysis.joints.values():
        table.add_row(*_row(joint))
    console.print(table)
    console.print("[dim]reserve: of damping, by Eq. (43); exactly: by integration of (4)-(6)[/]", soft_wrap=True)
    if len(analysis.robots) > 1:
        for name, topics in analysis.robots.items():
            for text in words.topics_read(name, topics):
                console.print(text, style="dim", markup=False, soft_wrap=True)
    for joint in analysis.joints.values():
        if joint.status in _TALKED_OF or lacks_data(joint.status, joint.assessment):
            console.print(f"{words.finding(joint)} {words.advice(joint)}", soft_wrap=True, markup=False)
            if words.rests_on(joint):
                console.print(f"  {words.rests_on(joint)}", style="dim", soft_wrap=True, markup=False)
    for warning in analysis.warnings:
        console.print("[yellow]warning:[/] ", end="")
        console.print(warning, markup=False, soft_wrap=True)


def _row(joint: JointAnalysis) -> list[str]:
    exactly = {True: "[green]smooth[/]", False: "[red]sticks[/]", None: "-"}[joint.exact.smooth]
    return [
        joint.name,
        _status(joint.status.value),
        f"{joint.time_in(Status.STICK_SLIP):.3g}",
        _number(joint.duration, ".4g"),
        str(len(joint.cycles)),
        _number(joint.velocity),
        _number(joint.usual_slip),
        _number(100.0 * joint.reserve, "+.0f", " %"),
        exactly,
    ]


def print_fleet(answers: Sequence[Answer]) -> None:
    """Many bags: a row for each joint of each robot."""
    console = _console()
    table = Table(box=None, padding=(0, 1))
    for heading in ("robot\n", "joint\n", "latest\nstatus"):
        table.add_column(heading, no_wrap=True)
    for heading in ("bags\n", "sticking\n", "sticks\n[s]", "of\n[s]", "cycles\n", "friction\n[N·m]"):
        table.add_column(escape(heading), justify="right", no_wrap=True)
    for (robot, joint), rows in sorted(by_joint(rows_of(answers)).items()):
        known = [row["coulomb"] for row in rows if row["coulomb"] is not None and row["coulomb_identified"]]
        table.add_row(
            robot,
            joint,
            _status(rows[-1]["status"]),
            str(len(rows)),
            str(sum(row["status"] == "stick_slip" for row in rows)),
            f"{sum(row['sticking_time'] for row in rows):.3g}",
            f"{sum(row['duration'] or 0.0 for row in rows):.4g}",
            str(sum(row["cycles"] for row in rows)),
            "-" if not known else _number(known[0]) if len(known) == 1 else f"{known[0]:.3g} to {known[-1]:.3g}",
        )
    console.print(table)
    console.print("[dim]friction: Coulomb friction identified in the first and in the latest bag[/]", soft_wrap=True)
    for found in answers:
        for warning in found.get("warnings", []):
            console.print("[yellow]warning:[/] ", end="")
            console.print(f"{found['path']}: {warning}", markup=False, soft_wrap=True)


def _console() -> Console:
    """As wide as the terminal; where there is none, as wide as the tables."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=_WIDTH)


def _status(word: str) -> str:
    return f"[{_COLOURS.get(word, 'dim')}]{word}[/]"


def _number(value: float, form: str = ".3g", unit: str = "") -> str:
    return f"{value:{form}}{unit}" if math.isfinite(value) else "-"
