# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip compare`: compare two recordings of the same joints, from before and after a change: did it help?

For each joint the changes are printed with their errors, and a sentence says whether they helped. A change is called
significant if it exceeds the combined errors (95 %). Parameters that the motion does not identify are not compared.
Exit status: 0 done; 2 a bag could not be analysed, or no joint is in both.

Examples:
    stickslip compare before.mcap after.mcap
    stickslip compare before.mcap after.mcap --joint joint1 --gains 630 --gains-after 2000,30 --html page.html
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_ros.analysis.analysis import BagAnalysis, analyze
from stickslip_ros.analysis.comparison import (
    Comparison,
    JointComparison,
    compare,
    comparison_json,
    not_compared,
    rows,
    sentence,
)
from stickslip_ros.analysis.report.comparison_page import write_comparison_page
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.cli.bag_options import GAINS_FORM, add_bag_arguments, analysis_options, check_named_joints
from stickslip_ros.cli.options import PAGE, add_json, add_option, add_repeated, refuse_inputs
from stickslip_ros.cli.terminal import COLOURS, console_of_tables, new_table, print_warning, progress_bar, status_text
from stickslip_ros.output.as_json import json_text
from stickslip_ros.visible import visible


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("before", type=Path, metavar="BEFORE", help="bag recorded before the change")
    parser.add_argument("after", type=Path, metavar="AFTER", help="bag recorded after the change")
    add_bag_arguments(parser)
    after = "gains in the second bag, if they differ from --gains and are not recorded; may be repeated"
    add_repeated(parser, "--gains-after", GAINS_FORM, after)
    output = parser.add_argument_group("output")
    add_json(output)
    add_option(output, "--html", "FILE", "write a page that draws both motions over each other", type=PAGE)


def run(options: argparse.Namespace) -> int:
    """Compare and print; exit status 0."""
    refuse_inputs({"--html": options.html}, [options.before, options.after])
    bags = [options.before, options.after]
    chosen = [analysis_options(options), analysis_options(options, options.gains_after)]
    check_named_joints(options, chosen[0], bags)
    found: list[BagAnalysis] = []
    for path, one in zip(bags, chosen, strict=True):
        with progress_bar(f"reading {path.name}") as progress:
            found.append(analyze(path, one, progress))
    comparison = compare(*found)
    if not comparison.joints:
        lists = [", ".join(one.joints) for one in found]
        raise RecordingError(f"no joint is in both bags: {lists[0]} before, {lists[1]} after")
    try:
        if options.html is not None:
            write_comparison_page(options.html, comparison, chosen)
    finally:
        # Whatever becomes of the page, the answer is not lost.
        if options.json:
            print(json_text(comparison_json(comparison)))
        else:
            _print(comparison)
    return 0


def _print(comparison: Comparison) -> None:
    console = console_of_tables()
    before, after = (escape(visible(one.path)) for one in (comparison.before, comparison.after))
    console.print(f"before: [bold]{before}[/]   after: [bold]{after}[/]\n", soft_wrap=True)
    print_joints(console, comparison.joints)
    console.print(
        "[dim]±: standard error; significantly: the change exceeds 1.96 times the combined standard errors (95 %)[/]",
        soft_wrap=True,
    )
    for name, side in comparison.alone.items():
        print_warning(console, f"{name} is in the recording {side} only")
    for side, analysis in (("before", comparison.before), ("after", comparison.after)):
        for warning in analysis.warnings:
            print_warning(console, f"{side}: {warning}")


def print_joints(console: Console, joints: Sequence[JointComparison]) -> None:
    """A table for each joint, and under it the sentence."""
    for joint in joints:
        console.print(_table(joint))
        for text in not_compared(joint):
            console.print(f"[dim]not compared: {escape(text)}[/]", soft_wrap=True)
        colour = COLOURS.get(joint.verdict.like, "bold")
        console.print(f"[{colour}]{escape(visible(sentence(joint)))}[/]\n", soft_wrap=True)


def _table(joint: JointComparison) -> Table:
    table = new_table(("", "before", "after"), padding=(0, 2, 0, 0), pad_edge=False)
    table.columns[0].header = f"[bold]{escape(visible(joint.name))}[/]"
    table.add_column("", overflow="fold")
    for row in rows(joint):
        values = (status_text(one) if row.is_status else one for one in (row.before, row.after))
        style = "bold" if row.significant else "dim"
        table.add_row(escape(row.label), *values, f"[{style}]{row.change}[/]")
    return table
