# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's answers as one table: a row for each joint of each bag."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.files import whole_file
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES
from stickslip_ros.output import published
from stickslip_ros.output.csv_table import write_csv

_NEVER = 0.0

Row = dict[str, Any]


def rows_of(answers: Iterable[Answer]) -> list[Row]:
    """The rows; None for what is unknown, and a row with the error alone for a bag that could not be analysed."""
    rows = []
    for found in answers:
        path = Path(found["path"])
        if "error" in found:
            rows.append(_row(path, found) | {"error": found["error"]})
        for name, joint in found.get("joints", {}).items():
            own = {"robot": joint["robot"]} if "robot" in joint else {}
            rows.append(_row(path, found) | own | _joint(joint.get("joint", name), joint))
    return rows


def stick_slip_share(rows: Sequence[Row]) -> float:
    """Share of the moving time of a joint's recordings that it spent in stick-slip, 0 to 1; NaN if it never moved."""
    moving = sum(row["moving_time"] or _NEVER for row in rows)
    return sum(row["sticking_time"] for row in rows) / moving if moving > 0.0 else math.nan


def _row(path: Path, found: Answer) -> Row:
    # The robot has the name of its joint states' namespace, else that of the folder that the bag lies in.
    namespace = found.get("topics", {}).get("joint_states", "").rpartition("/")[0].strip("/")
    robot = namespace or path.resolve().parent.name
    known = {"bag": str(path), "robot": robot, "recorded": found.get("recorded")}
    return known | _joint(None, None) | {"warnings": len(found.get("warnings", [])), "error": None}


def _joint(name: str | None, joint: Mapping[str, Any] | None) -> Row:
    """The columns that are about a joint, in their order; all None where there is none."""
    joint = joint or {}
    margin, friction = joint.get("margin"), joint.get("friction") or {}
    exact = None if margin is None else margin["exact"]
    cycles = joint.get("cycles")
    slips = sorted(abs(cycle["slip_distance"]) for cycle in cycles or ())
    row: Row = {"joint": name, "samples": joint.get("samples"), "duration": joint.get("duration")}
    for section in (published.SAMPLING, published.POSITION, published.STATUS, published.VELOCITY):
        row |= section.for_fleet(joint or None)
    row |= {key: joint.get(key) for key in ("reason", "worst_status", "stick_slip_share", "moving_time")}
    row |= {
        "sticking_time": joint["time_in"]["stick_slip"] or _NEVER if joint else None,
        "cycles": None if cycles is None else len(cycles),
        "usual_slip": slips[len(slips) // 2] if slips else None,
    }
    row |= published.RESERVE.for_fleet(exact) | published.MARGIN.for_fleet(margin)
    row |= published.MARGIN_TERMS.for_fleet(margin) | published.LOWEST_SMOOTH_VELOCITY.for_fleet(margin)
    row |= published.UNCERTAINTY.for_fleet(margin) | published.EXACT_UNCERTAINTY.for_fleet(margin)
    row |= published.EXACT.for_fleet(exact)
    row |= published.GAINS.for_fleet(joint.get("gains")) | published.INTEGRAL_GAIN.for_fleet(joint.get("gains"))
    for key in (*NAMES, COULOMB_AND_LOAD):
        found = friction.get(key, {})
        row |= {key: found.get("value"), f"{key}_std": found.get("std"), f"{key}_identified": found.get("identified")}
    row |= published.BELIEF.for_fleet(margin) | published.REVERSALS.for_fleet(joint.get("reversals"))
    row |= published.PRESLIDING.for_fleet(joint.get("presliding"))
    for section in published.OF_ADVICE:
        row |= section.for_fleet(joint.get("recommendation"))
    return row


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the table: Parquet if the name ends in .parquet, else CSV.

    Raises
    ------
    ImportError
        If Parquet is asked for and the package pyarrow is missing.
    OSError
        If it cannot be written.
    """
    if path.suffix == ".parquet":
        _write_parquet(path, rows)
        return
    columns = list(rows[0]) if rows else ["bag"]
    write_csv(path, [columns, *([row[name] for name in columns] for row in rows)])


def _write_parquet(path: Path, rows: Sequence[Row]) -> None:
    import pyarrow
    import pyarrow.parquet

    text, whole = pyarrow.string(), pyarrow.int64()
    # What has no unit is an answer, if it is no text.
    flags = {row.fleet for section in published.SECTIONS for row in section.rows if row.fleet and not row.unit}
    kinds = dict.fromkeys(flags | {f"{name}_identified" for name in (*NAMES, COULOMB_AND_LOAD)}, pyarrow.bool_())
    kinds |= dict.fromkeys(
        ("bag", "robot", "joint", "status", "reason", "worst_status", "exact_outcome", "error"), text
    )
    kinds |= dict.fromkeys(("samples", "cycles", "warnings"), whole)
    # Types by name, not by what happens to be there: tables of many runs fit together.
    schema = pyarrow.schema([(name, kinds.get(name, pyarrow.float64())) for name in (rows[0] if rows else ["bag"])])
    with whole_file(path) as file:
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(rows), schema=schema), file)
