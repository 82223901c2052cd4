# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip convert`: turn a table of samples (CSV, Parquet, NPZ) into a bag, which every other command can read.

The bag gets every joint of the table. Columns are recognised by their names, such as timestamp, q1, shoulder_pos,
position[0], /joint_states/elbow/velocity, target_q_3, torque_nm, "Speed [deg/s]". Other columns can be named, with
their unit: --column 'position=q*:deg', where * stands for the joint. In a table without a line of names they are
column1, column2 and so on: --column time=column1:s --column position=column2:deg. The columns used are shown before
anything is written. Time stamps are kept as they are.

Examples:
    stickslip convert log.csv --out robot.mcap
    stickslip convert log.csv --out robot.mcap --column 'position=q*:deg' --stiffness 630
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from shlex import quote

import numpy as np
from rich.console import Console
from rich.markup import escape

from stickslip_ros.bags import table_columns as columns
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError, Table, find_recording, load_table
from stickslip_ros.bags.table_columns import POSITION, Column, Named
from stickslip_ros.bags.writing import COMPRESSIONS, LAST_STAMP, write_recording
from stickslip_ros.cli.bag_options import GAINS_RULE, add_unpack_argument, can_be_a_gain
from stickslip_ros.cli.options import (
    add_bag_output,
    add_number,
    add_option,
    add_repeated,
    refuse_inputs,
    refuse_to_overwrite,
)
from stickslip_ros.cli.terminal import console_of_tables, console_of_text, new_table, print_warning
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.output.wording import in_metres_text

_GAINS = ("stiffness", "damping", "integral")
_WIDTH = 160
_MOST_UNUSED = 12
_PLACES = (POSITION, "reference_position")
_MORE_THAN_A_TURN = 7.0  # [rad] that few joints span; more is asked about where the unit is only assumed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "recording",
        metavar="RECORDING",
        help="a table: text of any ending, .parquet or .npz; or the beginning of a known recording's name",
    )
    add_bag_output(parser)
    parser.add_argument(
        "--names", "--name", metavar="A,B", help="names of the joints, in the table's order (default: from the columns)"
    )
    column = f"column of a FIELD, which is one of {', '.join(columns.FIELDS)}; * stands for the joint; may be repeated"
    add_repeated(parser, "--column", "FIELD=COLUMN[:UNIT]", column)
    add_number(parser, "--first-stamp", "S", "time stamp of time zero [s] (default: 1, or as recorded)")
    add_number(parser, "--stiffness", "KP", "k_p of the controllers in the recording, to write into the bag [N·m/rad]")
    add_number(parser, "--damping", "KV", "k_v of the controllers [N·m·s/rad] (default: 0)")
    add_number(parser, "--integral", "KI", "k_i of the controllers [N·m/(rad·s)] (default: 0)")
    add_unpack_argument(parser)
    add_option(parser, "--compression", None, "compression of the chunks", "zstd", choices=sorted(COMPRESSIONS))


def run(options: argparse.Namespace) -> int:
    """Convert; exit status 0."""
    path = find_recording(options.recording)
    refuse_inputs({"--out": options.out}, [path])
    refuse_to_overwrite(options)
    gains = _gains(options)
    table = load_table(
        path, [_column(text) for text in options.column], UnpackLimit(largest_unpacked=options.largest_unpacked)
    )
    names = _names(options.names, table)
    first = float(np.nanmin(next(iter(table.batches.values())).time, initial=math.inf))
    # A stamp of zero means that there is none.
    start = options.first_stamp if options.first_stamp is not None else (0.0 if first > 0.0 else 1.0 - first)
    if not 0.0 < first + start <= LAST_STAMP:
        if options.first_stamp is None or first == math.inf:
            raise RecordingError(f"recording {path}: no row has a time that a stamp can be")
        rule = f"such that the first stamp is after zero and at most {LAST_STAMP:.0f} s"
        raise InvalidParameterError("--first-stamp", rule, start)
    console = console_of_text(stderr=True)
    _show(table, names)
    batches = dict(zip(names, table.batches.values(), strict=True))
    in_metres = _in_metres(table, names)
    count = write_recording(options.out, batches, start, gains, options.compression, prismatic=in_metres)
    now = f"stickslip analyze {quote(str(options.out))}"
    console.print(f"{options.out}: {count} samples of {', '.join(names)}; now: {now}")
    left = len(next(iter(batches.values()))) - count
    if left:
        print_warning(console, f"{left} rows have no time, or none that a stamp can be, and were left out")
    _warn(console, table, batches)
    return 0


def _gains(options: argparse.Namespace) -> Gains | None:
    given = {name: value for name in _GAINS if (value := getattr(options, name)) is not None}
    for name, value in given.items():
        if not can_be_a_gain(value):
            raise InvalidParameterError(f"--{name}", GAINS_RULE, value)
        if "stiffness" not in given:
            raise InvalidParameterError(f"--{name}", "given together with --stiffness", value)
    return Gains(**given) if given else None


def _names(text: str | None, table: Table) -> list[str]:
    found = list(table.joints)
    if text is None:
        return found
    names = [name.strip() for name in text.split(",")]
    if len(names) != len(found) or len(set(names)) != len(names) or not all(names):
        listed = f"{len(found)} different names, separated by commas, of the joints {', '.join(found)}"
        raise InvalidParameterError("--names", listed if len(found) > 1 else "one name", text)
    return names


def _show(table: Table, names: list[str]) -> None:
    """Which columns were taken for what."""
    console = console_of_tables(_WIDTH, stderr=True)
    fields = [field for field in columns.FIELDS if any(field in uses for uses in table.joints.values())]
    headings = ["joint", *(field.replace("_", " ") for field in fields)]
    grid = new_table(headings, headings, padding=(0, 2, 0, 0), pad_edge=False)
    for name, uses in zip(names, table.joints.values(), strict=True):
        grid.add_row(escape(name), *(_shown(uses[field]) if field in uses else "-" for field in fields))
    form = f" ({table.form})" if table.form else ""
    time = " + ".join(_shown(use) for use in table.time)
    console.print(f"[bold]{escape(table.name)}[/]{escape(form)}: time from {time}", soft_wrap=True)
    console.print(grid)
    assumed = [use for use in table.time if use.assumed]
    assumed += [use for uses in table.joints.values() for use in uses.values() if use.assumed]
    if assumed:
        console.print(
            "[dim]?: no unit in the column name; guessed (time by its values, else as the joint's "
            f"position or as usual). To set it: {escape(_hints(table, 'deg'))}[/]",
            soft_wrap=True,
        )
    for note in table.notes:
        console.print(f"[yellow]note:[/] {escape(note)}", soft_wrap=True)
    if table.unused:
        more = len(table.unused) - _MOST_UNUSED
        listed = ", ".join(table.unused[:_MOST_UNUSED]) + (f" and {more} more" if more > 0 else "")
        console.print(f"[dim]not used: {escape(listed)}[/]", soft_wrap=True)


def _shown(use: Column) -> str:
    return escape(f"{use.name} [{columns.shown_unit(use.unit)}{'?' if use.assumed else ''}]")


def _warn(console: Console, table: Table, batches: dict[str, Batch]) -> None:
    if in_metres := _in_metres(table, list(batches)):
        console.print(f"[yellow]note:[/] {escape(in_metres_text(in_metres))}")
    uses_of = dict(zip(batches, table.joints.items(), strict=True))
    spans = {name: _span(batches[name]) for name, (_, uses) in uses_of.items() if uses[POSITION].assumed}
    suspect = max(spans, key=lambda name: spans[name], default="")
    if suspect and spans[suspect] > _MORE_THAN_A_TURN:
        counts = all(np.array_equal(known, np.round(known)) for name in spans if len(known := _known(batches[name])))
        # What is named of a field stands for all of it: the other joints are named too.
        print_warning(
            console,
            f"{suspect} spans {spans[suspect]:.3g} rad: is {uses_of[suspect][1][POSITION].name} in "
            f"{'encoder counts' if counts else 'degrees'}? Then: {_hints(table, columns.COUNTS if counts else 'deg')}",
        )


def _in_metres(table: Table, names: Sequence[str]) -> list[str]:
    return [name for name, own in zip(names, table.joints, strict=True) if table.unit(own) == "m"]


def _known(batch: Batch) -> FloatArray:
    return batch.position[np.isfinite(batch.position)]


def _span(batch: Batch) -> float:
    known = _known(batch)
    return float(known.max() - known.min()) if len(known) else 0.0


def _hints(table: Table, unit: str) -> str:
    """Options that give positions and their references a unit, or else times, where they have none of their own."""
    texts = []
    for field in _PLACES:
        of_field = {own: uses[field] for own, uses in table.joints.items() if field in uses}
        if any(use.assumed for use in of_field.values()):
            named = {own: (use.name, unit if use.assumed else use.unit) for own, use in of_field.items()}
            texts.append(columns.hint(field, named))
    if not texts:
        texts = [f"--column {quote(f'{columns.TIME}={use.name}:ms')}" for use in table.time if use.assumed]
    return " ".join(texts) or f"--column 'FIELD=COLUMN:{unit}'"


def _column(text: str) -> Named:
    field, equals, rest = text.partition("=")
    name, colon, unit = rest.rpartition(":")
    if not colon:
        name, unit = rest, ""
    if not equals or field not in columns.FIELDS or not name:
        wanted = f"FIELD=COLUMN[:UNIT] with a field of {', '.join(columns.FIELDS)}"
        raise InvalidParameterError("--column", wanted, text)
    if field == columns.TIME and "*" in name:
        raise InvalidParameterError("--column", "of one column, where it is of the time", text)
    spelled = columns.spelled_unit(unit)
    try:
        factor = columns.factor_of(field, spelled) if unit else 1.0
    except ValueError as error:
        raise InvalidParameterError(f"--column {text}", str(error), unit) from error
    if math.isnan(factor):
        example = f"{name}:{columns.shown_unit(spelled)}"
        raise InvalidParameterError(f"--column {text}", f"with the counts that make a turn, as in {example}", unit)
    return Named(field=field, column=name, unit=spelled)
