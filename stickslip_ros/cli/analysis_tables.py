# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip analyze` prints: one bag's joints, or a fleet's."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime

from rich.console import Console
from rich.markup import escape

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import BagAnalysis
from stickslip_ros.analysis.fleet import Answer, TimedAnswer
from stickslip_ros.analysis.fleet_joints import LEAST_MOVING, FleetJoint
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.judgement import lacks_data
from stickslip_ros.cli.terminal import console_of_tables, console_of_text, fitting_table, number_text, print_warning
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.wording import OUTCOME_WORDS, counted
from stickslip_ros.visible import visible

COLOURS = {"stick_slip": "red", "at_risk": "yellow", "smooth": "green"}
_STICKS = Status.STICK_SLIP.value


def print_analysis(analysis: BagAnalysis) -> None:
    """One bag: a row for each joint, then in words what matters, the joint that stuck most first."""
    console = console_of_tables()
    console.print(f"[bold]{escape(visible(analysis.path))}[/]", soft_wrap=True)
    joints = list(analysis.joints.values())
    _print_table(console, [_cells(joint) for joint in joints], _SPARED)
    console.print(
        "[dim]status: the one that lasted longest; worst: the most severe one seen; sticking: time in stick-slip,\n"
        "slips included; moving: time in which the joint moved or stuck; stick-slip: share of that time;\n"
        "reserve: damping in excess of that at which stick-slip ends; model predicts: what the joint does in the\n"
        "end by the friction model, from which the reserve is computed too[/]",
        soft_wrap=True,
    )
    if len(analysis.robots) > 1:
        for name, topics in analysis.robots.items():
            for text in words.topics_read(name, topics):
                console.print(text, style="dim", markup=False, soft_wrap=True)
    for joint in sorted(joints, key=lambda joint: -_share(joint.stick_slip_share)):
        if words.matters(joint) or lacks_data(joint.status, joint.assessment):
            console.print(f"{words.finding(joint)} {words.advice(joint)}".rstrip(), soft_wrap=True, markup=False)
            if words.rests_on(joint):
                console.print(f"  {words.rests_on(joint)}", style="dim", soft_wrap=True, markup=False)
        for text in (words.reversals(joint, joint.name), words.presliding(joint, joint.name)):
            if text:
                console.print(text, soft_wrap=True, markup=False)
    if words.smooth(joints):
        console.print(words.smooth(joints), soft_wrap=True, markup=False)
    for reason, names in words.not_judged(joints).items():
        console.print(f"not judged, {reason}: {', '.join(names)}", soft_wrap=True, markup=False)
    for warning in analysis.warnings:
        print_warning(console, warning)


_TEXTS = ("robot\n", "joint\n", "status\n", "worst\n")
# The headings of a bag's table, and of a fleet's, that a narrow terminal has no room for, the first one first.
_SPARED = ("moving\n[s]", "sticking\n[s]", "slip\n[rad]", "speed\n[rad/s]", "model\npredicts", "reserve\n")
_SPARED_OF_FLEET = ("moving\n[s]", "sticking\n[s]", "cycles\n", "friction\n[N·m]", "bags\n", "sticking\nin bags")


def _print_table(console: Console, rows: Sequence[Mapping[str, str]], spared: Sequence[str]) -> None:
    if rows:
        console.print(fitting_table(console, rows, spared, _TEXTS, padding=(0, 2, 0, 0), pad_edge=False))


def _cells(joint: JointAnalysis) -> dict[str, str]:
    predicted = "-" if joint.exact.outcome is None else OUTCOME_WORDS[joint.exact.outcome.value]
    return {
        "joint\n": escape(visible(joint.name)),
        "status\n": status_text(joint.status.value),
        "stick-slip\n": words.percent(joint.stick_slip_share),
        "worst\n": status_text(joint.worst.value),
        "sticking\n[s]": f"{joint.time_in(Status.STICK_SLIP):.3g}",
        "moving\n[s]": f"{joint.moving_time:.4g}",
        "cycles\n": str(len(joint.cycles)),
        "speed\n[rad/s]": number_text(joint.velocity),
        "slip\n[rad]": number_text(joint.usual_slip),
        "reserve\n": number_text(100.0 * joint.reserve, "+.0f", " %"),
        "model\npredicts": predicted,
    }


def _share(share: float) -> float:
    return share if math.isfinite(share) else 0.0


def print_fleet(joints: Sequence[FleetJoint], answers: Sequence[Answer]) -> None:
    """Many bags: a row for each joint of each robot, as the page has it; and what is the matter with their answers."""
    console = console_of_tables()
    _print_table(console, [_fleet_cells(joint) for joint in joints], _SPARED_OF_FLEET)
    console.print(
        "[dim]status: in the last bag that shows it; worst: the most severe one seen; sticking in bags: how many\n"
        "sticking: time in stick-slip, slips included; moving: time in which the joint moved or stuck\n"
        f"stick-slip: share of that time, in the last bag with {LEAST_MOVING:g} s of it\n"
        "friction: Coulomb friction identified in the first and in the last such bag[/]",
        soft_wrap=True,
    )
    failed = [found["path"] for found in answers if "error" in found]
    if failed:
        console.print(f"[yellow]{counted(len(failed), 'bag')} could not be analysed:[/] ", end="")
        console.print(visible(", ".join(failed)), markup=False, soft_wrap=True)
    for found in answers:
        for warning in found.get("warnings", []):
            print_warning(console, f"{found['path']}: {warning}")


def _fleet_cells(joint: FleetJoint) -> dict[str, str]:
    friction = [number_text(point.value) for point in joint.histories["coulomb"].points.values()] or ["-"]
    return {
        "robot\n": escape(visible(joint.robot)),
        "joint\n": escape(visible(joint.name)),
        "status\n": status_text(joint.status.value),
        "stick-slip\n": words.percent(joint.histories["stick_slip"].latest),
        "worst\n": status_text(joint.worst.value),
        "bags\n": str(len(joint.rows)),
        "sticking\nin bags": str(joint.stuck_in),
        "sticking\n[s]": f"{sum(row['sticking_time'] for row in joint.rows):.3g}",
        "moving\n[s]": f"{sum(row['moving_time'] or 0.0 for row in joint.rows):.4g}",
        "cycles\n": str(sum(row["cycles"] for row in joint.rows)),
        "friction\n[N·m]": friction[0] if len(friction) == 1 else f"{friction[0]} to {friction[-1]}",
    }


def print_brief(answers: Sequence[Answer]) -> None:
    """A line for each bag: what it shows."""
    for found in answers:
        console_of_text().print(visible(f"{found['path']}: {_result(found)}"), markup=False)


def print_alarms(joints: Sequence[FleetJoint]) -> None:
    """A line for each alarm that is raised."""
    console = console_of_text()
    for joint in joints:
        for alarm in joint.alarms:
            console.print("[red]alarm:[/] ", end="")
            console.print(visible(f"{joint.robot} {joint.name}: {alarm}"), markup=False)


def alarms_json(joints: Sequence[FleetJoint]) -> list[dict[str, str]]:
    """Each alarm that is raised."""
    return [{"robot": joint.robot, "joint": joint.name, "alarm": alarm} for joint in joints for alarm in joint.alarms]


def print_finished(found: TimedAnswer) -> None:
    """One bag of many, on stderr: when it was done, what it shows, how long it took."""
    now = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S")
    took = f"{found.seconds:.1f} s" if math.isfinite(found.seconds) else "cached"
    text = f"{now} {found.answer['path']}: {_result(found.answer)} ({took})"
    console_of_text(stderr=True).print(text, markup=False)


def _result(found: Answer) -> str:
    if "error" in found:
        return "could not be analysed"
    joints = found["joints"]
    if words.nothing_judged(found):
        return "no joint could be judged"
    sticking = {name: joint["stick_slip_share"] for name, joint in joints.items() if joint["worst_status"] == _STICKS}
    if not sticking:
        return f"none of {counted(len(joints), 'joint')} stuck and slipped"
    worst = sorted(sticking.items(), key=lambda one: -(one[1] or 0.0))
    listed = ", ".join(f"{name} {words.percent(math.nan if share is None else share)}" for name, share in worst)
    return f"{len(sticking)} of {counted(len(joints), 'joint')} stuck and slipped: {listed}"


def status_text(word: str) -> str:
    """A status word in its colour."""
    return f"[{COLOURS.get(word, 'dim')}]{word}[/]"
