# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip convert`: a table of samples (.csv, .npz) as a bag, so that it takes the same road as any other.

A column is found by its name, as in time_s, position_rad, velocity_deg_per_s, torque_nm, reference_rad; or it is
named, with its unit where the name has none: --column position=q1:deg. Stamps are kept as they are.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from stickslip_ros.bags.conversion import write_recording
from stickslip_ros.bags.table import COLUMNS, UNITS, find_recording, load_recording
from stickslip_ros.bags.writing import COMPRESSIONS
from stickslip_ros.cli.bag_options import add_unpack_argument, check_output, unpack_limit
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.add_argument("recording", metavar="RECORDING", help="a .csv or .npz file, or a known one")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="BAG", help="one file if it ends in .mcap, else a directory"
    )
    parser.add_argument("--name", default="joint1", help="of the joint (default: %(default)s)")
    parser.add_argument(
        "--column", action="append", metavar="FIELD=COLUMN[:UNIT]", default=[],
        help=f"FIELD one of {', '.join(COLUMNS)}; UNIT as in position=q1:deg; may be repeated",
    )  # fmt: skip
    parser.add_argument("--start", type=float, metavar="S", help="stamp of time zero [s] (default: 1, or as recorded)")
    parser.add_argument("--stiffness", type=float, metavar="KP", help="k_p of the controller then, to be recorded too")
    parser.add_argument("--damping", type=float, metavar="KV", default=0.0, help="k_v then (default 0)")
    add_unpack_argument(parser)
    parser.add_argument("--compression", choices=sorted(COMPRESSIONS), default="zstd", help="of the chunks")


def run(options: argparse.Namespace) -> int:
    """Convert; exit status 0."""
    path = find_recording(options.recording)
    check_output(options.out, [path])
    recording = load_recording(path, dict(_column(text) for text in options.column), unpack_limit(options))
    first = float(np.nanmin(recording.batch.time))
    # A stamp of zero means that there is none.
    start = options.start if options.start is not None else (0.0 if first > 0.0 else 1.0 - first)
    if not math.isfinite(start) or first + start <= 0.0:
        raise InvalidParameterError("--start", f"such that the first stamp is after zero (> {-first:g})", start)
    gains = None
    if options.stiffness is not None:
        gains = Gains(stiffness=options.stiffness, damping=options.damping)
    count = write_recording(options.out, recording.batch, options.name, start, gains, options.compression)
    left = len(recording.batch) - count
    console = Terminal(stderr=True, highlight=False, soft_wrap=True)
    console.print(f"{options.out}: {count} samples of {options.name}; now: stickslip analyze {options.out}")
    if left:
        console.print(f"[yellow]warning:[/] {left} rows have no time and were left out")
    unit = recording.unit
    if unit != "rad":
        console.print(f"[yellow]note:[/] positions are in {unit}; wherever rad is said, read {unit}")
    return 0


def _column(text: str) -> tuple[str, tuple[str, str]]:
    field, equals, rest = text.partition("=")
    name, colon, unit = rest.rpartition(":")
    if not colon:
        name, unit = rest, ""
    if not equals or field not in COLUMNS or not name:
        wanted = f"FIELD=COLUMN[:UNIT] with a field of {', '.join(COLUMNS)}"
        raise InvalidParameterError("--column", wanted, text)
    if unit and unit not in UNITS[field]:
        raise InvalidParameterError(f"--column {text}", f"a unit of {', '.join(UNITS[field])}", unit)
    return field, (name, unit)
