# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip analyze`: detect stick-slip in recorded bags and advise gains; ROS is not needed.

A bag is an MCAP file, a rosbag2 directory, a .db3 file, a .bag file of ROS 1 or an episode of a LeRobot data set
(DATASET/episode_000012); a folder stands for every bag in it. For several bags, one table of the fleet is printed, and
--html writes one page that lists the worst joints first. Exit status: 0 done; 1 with --fail-on-stick-slip if a joint
sticks and slips in any part of a recording, or if an --alarm is raised; 2 a bag could not be analysed, or none of its
joints could be judged.

Examples:
    stickslip analyze robot.mcap --html report.html
    stickslip analyze recordings/ --gains 630,12 --jobs 4 --html fleet.html
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from stickslip_ros.analysis import words
from stickslip_ros.analysis.analysis import AnalysisOptions, BagAnalysis, analyze
from stickslip_ros.analysis.analysis_json import bag_json, write_cycles
from stickslip_ros.analysis.annotation import Annotation
from stickslip_ros.analysis.fleet import Answer, TimedAnswer, analyze_fleet, find_bags
from stickslip_ros.analysis.fleet_joints import (
    LEAST_MOVING,
    FleetJoint,
    fleet_joints,
    parse_alarm,
    rows_of,
    write_table,
)
from stickslip_ros.analysis.joint_analysis import JointAnalysis, JointAnalyzer
from stickslip_ros.analysis.judgement import NOT_JUDGED, lacks_data
from stickslip_ros.analysis.report.fleet_page import write_fleet_page
from stickslip_ros.analysis.report.report import write_report
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.cli.bag_options import add_bag_arguments, add_limit_arguments, analysis_options, check_named_joints
from stickslip_ros.cli.options import (
    CSV,
    PAGE,
    TABLE,
    add_flag,
    add_json,
    add_option,
    add_repeated,
    output_bag,
    output_folder,
    refuse_given,
    refuse_inputs,
)
from stickslip_ros.cli.terminal import (
    Terminal,
    complain,
    console_of_tables,
    console_of_text,
    fitting_table,
    number_text,
    print_warning,
    progress_bar,
    status_text,
)
from stickslip_ros.errors import InvalidParameterError, StickSlipError, in_words
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.output.as_json import json_text
from stickslip_ros.output.wording import OUTCOME_WORDS, counted
from stickslip_ros.visible import visible

_ANNOTATED_EVERY = 1.0  # [s]
_STICKS = Status.STICK_SLIP.value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG",
        help="MCAP file, rosbag2 directory, .db3 or .bag file, LeRobot data set or episode")  # fmt: skip
    add_bag_arguments(parser)
    add_limit_arguments(parser)
    output = parser.add_argument_group("output")
    printed = output.add_mutually_exclusive_group()
    add_json(printed)
    add_flag(printed, "--brief", "print one line for each bag and nothing else")
    add_option(output, "--csv", "FILE", "write a table of all stick-slip cycles", type=CSV)
    add_option(output, "--html", "FILE", "write a report: one page that needs no network", type=PAGE)
    add_option(output, "--out", "BAG", "write cycles, margins and diagnostics as a bag", type=output_bag)
    add_flag(output, "--fail-on-stick-slip", "exit with status 1 if a joint sticks and slips, however briefly")
    fleet = parser.add_argument_group("many bags")
    add_option(fleet, "--jobs", "N", "number of bags analysed at once", 1, type=int)
    add_option(fleet, "--scheduler", "ADDRESS", "address of a Dask cluster that can read the files: tcp://…")
    add_option(
        fleet, "--results", "FOLDER", "cache results in this folder and reuse them next time", type=output_folder
    )
    add_option(
        fleet, "--reports", "FOLDER", "write a report of each bag; the page of --html links to them", type=output_folder
    )
    add_repeated(
        fleet, "--alarm", "A",
        "condition that raises an alarm, e.g. coulomb=+15%% (since the first bag), 'stick_slip>5%%' or 'reserve<20%%'; "
        "may be repeated",
    )  # fmt: skip
    rows = "write a table with a row for each joint of each bag (.csv or .parquet)"
    add_option(fleet, "--table", "FILE", rows, type=TABLE)


def run(options: argparse.Namespace) -> int:
    """Analyse and print."""
    if options.jobs < 1:
        raise InvalidParameterError("--jobs", ">= 1", options.jobs)
    if options.scheduler is not None:
        refuse_given(options, {"jobs": 1}, "left out with --scheduler, whose workers are as many as it has")
    options.alarm = [parse_alarm(text) for text in options.alarm]
    bags = find_bags(options.bags)
    if not bags:
        folders = ", ".join(map(str, options.bags))
        raise RecordingError(f"no bags in {folders}; a table becomes one by stickslip convert")
    refuse_inputs({f"--{name}": getattr(options, name) for name in ("csv", "html", "out", "table")}, bags)
    alone = len(bags) == 1 and options.scheduler is None and options.results is None
    if not alone:
        refuse_given(options, {"out": None}, "used with one bag, by itself")
    chosen = analysis_options(options)
    check_named_joints(options, chosen, bags)
    if alone:
        refuse_given(options, {"reports": None}, "used with several bags (one has --html)")
    pages = _report_pages(bags, options.reports)
    answers, analysis, unwritten = (
        _one(bags[0], chosen, options) if alone else (_many(bags, chosen, options, pages), None, [])
    )
    errors = [found["error"] for found in answers if "error" in found]
    blind = [text for found in answers if (text := words.nothing_judged(found))]
    for text in (*errors, *blind):
        complain(text)
    joints = fleet_joints(answers, options.alarm)
    alarms = [{"robot": joint.robot, "joint": joint.name, "alarm": one} for joint in joints for one in joint.alarms]
    try:
        unwritten += _write(options, answers, analysis, joints, pages)
    finally:
        # Whatever becomes of the files, the answer is not lost.
        if options.json:
            print(json_text({"bags": answers} | ({"alarms": alarms} if options.alarm else {})))
        elif options.brief:
            _print_brief(answers)
        elif analysis is not None:
            _print_analysis(analysis)
        elif len(bags) > 1 or not errors:
            print_fleet(joints, answers)
        if not options.json:
            _print_alarms(alarms)
    for text in unwritten:
        complain(text)
    worst = [joint["worst_status"] for found in answers for joint in found.get("joints", {}).values()]
    if (options.fail_on_stick_slip and "stick_slip" in worst) or alarms:
        return 1
    return 2 if errors or blind or unwritten else 0


def _report_pages(bags: Sequence[Path], folder: Path | None) -> dict[Path, Path]:
    """Where each bag's report is to be: named after the bag and its folder, and no two alike."""
    pages: dict[Path, Path] = {}
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        for bag in bags:
            name = "-".join(filter(None, (bag.resolve().parent.name, bag.stem)))
            taken = sum(page.stem == name or page.stem.startswith(f"{name}~") for page in pages.values())
            pages[bag] = folder / f"{name}{f'~{taken + 1}' if taken else ''}.html"
    return pages


def _write(
    options: argparse.Namespace,
    answers: Sequence[Answer],
    analysis: BagAnalysis | None,
    joints: Sequence[FleetJoint],
    pages: Mapping[Path, Path],
) -> list[str]:
    """Write the files that are asked for; returns of each that was not why: one takes no other with it."""

    def write_html(path: Path) -> None:
        if analysis is not None:
            write_report(path, analysis)
            return
        written = {str(bag): page for bag, page in pages.items() if page.exists()}
        write_fleet_page(path, answers, joints, written, with_alarms=bool(options.alarm))

    writers: dict[str, Callable[[Path], None]] = {
        "csv": lambda path: write_cycles(path, answers),
        "table": lambda path: write_table(path, rows_of(answers)),
        "html": write_html,
    }
    unwritten = []
    for name, write in writers.items():
        path = getattr(options, name)
        try:
            if path is not None:
                write(path)
        except (StickSlipError, OSError) as error:
            unwritten.append(_unwritten(name, path, error))
    return unwritten


def _unwritten(name: str, path: Path, error: Exception) -> str:
    reason = in_words(error).removeprefix(f"{path}: ")
    return f"--{name} {path} was not written: {reason}"


def _one(
    path: Path, chosen: AnalysisOptions, options: argparse.Namespace
) -> tuple[list[Answer], BagAnalysis | None, list[str]]:
    """One bag, with what only its analysis at hand can give: traces for a report, and annotations; and why these were
    not written.
    """
    chosen = replace(
        chosen,
        with_traces=options.html is not None,
        longest_piece=chosen.longest_piece if options.out is None else _ANNOTATED_EVERY,
    )
    analysis: BagAnalysis | None = None
    failed: list[OSError] = []
    try:
        with progress_bar(f"reading {path.name}") as progress, _annotation(chosen, options.out) as annotation:

            def watch(joints: dict[str, JointAnalyzer], found: dict[str, list[Cycle]], clock: float) -> None:
                try:
                    if annotation is not None and not failed:
                        annotation(joints, found, clock)
                except OSError as error:
                    failed.append(error)

            analysis = analyze(path, chosen, progress, watch)
            if failed:
                raise failed[0]
    except (StickSlipError, OSError) as error:
        if analysis is None:
            return [{"path": str(path), "error": in_words(error)}], None, []
        return [bag_json(analysis)], analysis, [_unwritten("out", options.out, error)]
    return [bag_json(analysis)], analysis, []


def _annotation(chosen: AnalysisOptions, path: Path | None) -> Any:
    """What writes the annotations, if they are wanted."""
    return nullcontext() if path is None else Annotation(path, chosen.parameters.settings_of("*").options.warn_margin)


def _many(
    bags: list[Path], chosen: AnalysisOptions, options: argparse.Namespace, pages: Mapping[Path, Path]
) -> list[Answer]:
    watched = Terminal(stderr=True).is_terminal
    with progress_bar("bags") as progress:
        return analyze_fleet(
            bags,
            chosen,
            jobs=options.jobs,
            scheduler=options.scheduler,
            results=options.results,
            reports=pages,
            progress=progress,
            # Where nobody watches a bar, a log has a line a bag.
            finished=(lambda _: None) if watched else _print_finished,
        )


def _print_analysis(analysis: BagAnalysis) -> None:
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
        for text in (sentence(joint, joint.name) for sentence in (words.reversals, words.presliding, words.ring)):
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


def _print_brief(answers: Sequence[Answer]) -> None:
    """A line for each bag: what it shows."""
    for found in answers:
        console_of_text().print(visible(f"{found['path']}: {_result(found)}"), markup=False)


def _print_alarms(alarms: Sequence[Mapping[str, str]]) -> None:
    """A line for each alarm that is raised."""
    console = console_of_text()
    for one in alarms:
        console.print("[red]alarm:[/] ", end="")
        console.print(visible(f"{one['robot']} {one['joint']}: {one['alarm']}"), markup=False)


def _print_finished(found: TimedAnswer) -> None:
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
    unjudged = sum(Status(joint["status"]) in NOT_JUDGED for name, joint in joints.items() if name not in sticking)
    rest = f"; {unjudged} could not be judged" if unjudged else ""
    if not sticking:
        return f"none of {counted(len(joints), 'joint')} stuck and slipped{rest}"
    worst = sorted(sticking.items(), key=lambda one: -(one[1] or 0.0))
    listed = ", ".join(f"{name} {words.percent(math.nan if share is None else share)}" for name, share in worst)
    return f"{len(sticking)} of {counted(len(joints), 'joint')} stuck and slipped: {listed}{rest}"
