# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip analyze`: what recordings show of their joints; no ROS is needed.

A bag is an MCAP file, a rosbag2 directory or a .db3 file; a folder stands for every bag in it. Of several bags a
table of the fleet is printed, and --html writes a page with trends instead of one bag's report. Exit status: 0 done,
1 with --fail-on-stick-slip if a joint sticks and slips, for however short a part of the recording, 2 a bag could not
be analysed, or none of its joints be judged.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.analysis import AnalysisOptions, BagAnalysis, analyze
from stickslip_ros.analysis.analysis_json import bag_json, write_cycles
from stickslip_ros.analysis.annotation import Annotation
from stickslip_ros.analysis.data_problems import nothing_judged
from stickslip_ros.analysis.fleet import Answer, analyze_fleet, find_bags
from stickslip_ros.analysis.fleet_table import rows_of, write_table
from stickslip_ros.analysis.report.fleet_page import write_fleet_page
from stickslip_ros.analysis.report.report import write_report
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.cli.analysis_tables import print_analysis, print_fleet
from stickslip_ros.cli.bag_options import add_bag_arguments, analysis_options, check_output
from stickslip_ros.cli.progress import progress_bar
from stickslip_ros.cli.terminal import complain
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.output.as_json import json_text

_ANNOTATED_EVERY = 1.0  # [s]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("bags", nargs="+", type=Path, metavar="BAG", help="MCAP file, rosbag2 directory or .db3 file")
    add_bag_arguments(parser)
    output = parser.add_argument_group("output")
    output.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    output.add_argument("--csv", type=Path, metavar="FILE", help="write every cycle into a table")
    output.add_argument("--html", type=Path, metavar="FILE", help="write a report: one page that needs no network")
    output.add_argument(
        "--out", type=Path, metavar="BAG", help="write cycles, margins and diagnostics as a bag, to be opened beside it"
    )
    output.add_argument(
        "--fail-on-stick-slip", action="store_true", help="exit status 1 if a joint sticks and slips, however short"
    )
    fleet = parser.add_argument_group("many bags")
    fleet.add_argument("--jobs", type=int, metavar="N", default=1, help="bags at once (default: %(default)s)")
    fleet.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster that sees the files: tcp://…")
    fleet.add_argument("--results", type=Path, metavar="FOLDER", help="keep answers, and begin with those in it")
    fleet.add_argument(
        "--table", type=Path, metavar="FILE", help="write a row for each joint of each bag (.csv or .parquet)"
    )


def run(options: argparse.Namespace) -> int:
    """Analyse and print."""
    if options.jobs < 1:
        raise InvalidParameterError("--jobs", ">= 1", options.jobs)
    bags = find_bags(options.bags)
    if not bags:
        raise RecordingError(f"no bags in {', '.join(map(str, options.bags))}")
    for path in (options.csv, options.html, options.out, options.table):
        if path is not None:
            check_output(path, bags)
    if len(bags) == 1 and options.scheduler is None and options.results is None:
        answers, analysis = _one(bags[0], options)
    else:
        if options.out is not None:
            raise InvalidParameterError("--out", "used with one bag, by itself", options.out)
        answers, analysis = _many(bags, options), None
    errors = [found["error"] for found in answers if "error" in found]
    blind = [text for found in answers if (text := nothing_judged(found))]
    for text in (*errors, *blind):
        complain(text)
    if options.csv:
        write_cycles(options.csv, answers)
    if options.table:
        write_table(options.table, rows_of(answers))
    if options.html and analysis is None:
        write_fleet_page(options.html, answers)
    if options.json:
        print(json_text({"bags": answers}))
    elif analysis is not None:
        print_analysis(analysis)
    elif len(bags) > 1 or not errors:
        print_fleet(answers)
    worst = [joint["worst_status"] for found in answers for joint in found.get("joints", {}).values()]
    if options.fail_on_stick_slip and "stick_slip" in worst:
        return 1
    return 2 if errors or blind else 0


def _one(path: Path, options: argparse.Namespace) -> tuple[list[Answer], BagAnalysis | None]:
    """One bag, with what only its analysis at hand can give: annotations and report."""
    more: dict[str, Any] = {"with_traces": options.html is not None}
    if options.out is not None:
        more["longest_piece"] = _ANNOTATED_EVERY
    chosen = analysis_options(options, **more)
    try:
        with progress_bar(f"reading {path.name}") as progress, _annotation(chosen, options.out) as annotation:
            analysis = analyze(path, chosen, progress, *([annotation] if annotation is not None else []))
    except (StickSlipError, OSError) as error:
        return [{"path": str(path), "error": str(error)}], None
    if options.html is not None:
        write_report(options.html, analysis)
    return [bag_json(analysis)], analysis


def _annotation(chosen: AnalysisOptions, path: Path | None) -> Any:
    """What writes the annotations, if they are wanted."""
    return nullcontext() if path is None else Annotation(path, chosen.parameters.settings_of("*").options.warn_margin)


def _many(bags: list[Path], options: argparse.Namespace) -> list[Answer]:
    with progress_bar("bags") as progress:
        return analyze_fleet(
            bags,
            analysis_options(options),
            jobs=options.jobs,
            scheduler=options.scheduler,
            results=options.results,
            progress=progress,
        )
