# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip compare` prints, and the demo at its end: what changed of each joint, and whether it helped."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from stickslip_ros.analysis.comparison import JointComparison, Verdict
from stickslip_ros.analysis.comparison_words import change_text, not_compared, sentence, unit_text, value_text
from stickslip_ros.cli.analysis_tables import status_text
from stickslip_ros.output.wording import OUTCOME_WORDS
from stickslip_ros.visible import visible

_COLOURS = {
    Verdict.HELPED: "green",
    Verdict.HELPED_IN_PART: "green",
    Verdict.SMALLER_SLIPS: "green",
    Verdict.WORSE: "red",
    Verdict.LARGER_SLIPS: "red",
    Verdict.CANNOT_SAY: "yellow",
}


def print_joints(console: Console, joints: Sequence[JointComparison]) -> None:
    """A table for each joint, and under it the sentence."""
    for joint in joints:
        console.print(_table(joint))
        for text in not_compared(joint):
            console.print(f"[dim]not compared: {escape(text)}[/]", soft_wrap=True)
        console.print(f"[{_COLOURS.get(joint.verdict, 'bold')}]{escape(visible(sentence(joint)))}[/]\n", soft_wrap=True)


def _table(joint: JointComparison) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column(f"[bold]{escape(visible(joint.name))}[/]", no_wrap=True)
    table.add_column("before", justify="right", no_wrap=True)
    table.add_column("after", justify="right", no_wrap=True)
    table.add_column("", overflow="fold")
    sides = joint.before, joint.after
    same = "the same" if joint.before.status is joint.after.status else "changed"
    table.add_row("status", *(status_text(one.status.value) for one in sides), same)
    if any(one.worst is not one.status for one in sides):
        same = "the same" if joint.before.worst is joint.after.worst else "changed"
        table.add_row("at worst", *(status_text(one.worst.value) for one in sides), same)
    table.add_row("speed [rad/s]".replace("[", r"\["), *(f"{one.velocity:.3g}" for one in sides), "")
    table.add_row("cycles", *(str(len(one.cycles)) for one in sides), "")
    for one in joint.quantities:
        unit = unit_text(one)
        label = escape(f"{one.label} [{unit}]" if unit else one.label)
        colour = "bold" if one.significant else "dim"
        values = value_text(one, one.before), value_text(one, one.after)
        table.add_row(label, *values, f"[{colour}]{change_text(one)}[/]")
    if any(one.exact.outcome is not None for one in sides):
        outcomes = ("–" if one.exact.outcome is None else OUTCOME_WORDS[one.exact.outcome.value] for one in sides)
        table.add_row("integrated, it", *outcomes, "")
    return table
