# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's answers as one table: a row for each joint of each bag."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.errors import StickSlipError
from stickslip_ros.monitoring.friction.estimate import NAMES

_PLAIN = ("samples", "duration", "sample_rate", "status", "velocity")
_MARGIN = ("energy_margin", "damping_ratio", "critical_damping_ratio", "lowest_smooth_velocity")
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
            rows.append(_row(path, found) | _joint(name, joint))
    return rows


def by_joint(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    """The rows of each robot's joint, in the order of their recording; those without a joint are left out."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in sorted(rows, key=lambda row: row["recorded"] or 0.0):
        if row["joint"] is not None:
            groups.setdefault((row["robot"], row["joint"]), []).append(row)
    return groups


def _row(path: Path, found: Answer) -> Row:
    columns = ("bag", "robot", "recorded", "joint", *_PLAIN, "sticking_time", "cycles", "usual_slip", "reserve")
    empty = dict.fromkeys((*columns, *_MARGIN, "exactly_smooth", "stiffness", "damping"))
    for name in NAMES:
        empty |= dict.fromkeys((name, f"{name}_std", f"{name}_identified"))
    empty |= dict.fromkeys(("per_inertia", "advised_stiffness", "advised_damping", "warnings", "error"))
    known = {"bag": str(path), "robot": robot_of(path, found), "recorded": found.get("recorded")}
    return empty | known | {"warnings": len(found.get("warnings", []))}


def robot_of(path: Path, found: Answer) -> str:
    """The robot's name: the namespace of its joint states, else the folder that the bag lies in."""
    topic = found.get("topics", {}).get("joint_states", "")
    namespace = topic.rpartition("/")[0].strip("/")
    return namespace or path.resolve().parent.name


def _joint(name: str, joint: dict[str, Any]) -> Row:
    slips = sorted(abs(cycle["slip_distance"]) for cycle in joint["cycles"])
    row: Row = {"joint": name, **{key: joint[key] for key in _PLAIN}}
    row |= {
        "sticking_time": joint["time_in"]["stick_slip"] or _NEVER,
        "cycles": len(slips),
        "usual_slip": slips[len(slips) // 2] if slips else None,
    }
    margin, advice = joint["margin"], joint["recommendation"]
    if margin is not None:
        row |= {key: margin[key] for key in _MARGIN}
        row |= {"per_inertia": margin["per_inertia"], "exactly_smooth": margin["exact"]["smooth"]}
        if margin["critical_damping_ratio"]:
            row["reserve"] = margin["damping_ratio"] / margin["critical_damping_ratio"] - 1.0
    if joint["friction"] is not None:
        for key in NAMES:
            found = joint["friction"][key]
            row |= {key: found["value"], f"{key}_std": found["std"], f"{key}_identified": found["identified"]}
    if joint["gains"] is not None:
        row |= {key: joint["gains"][key] for key in ("stiffness", "damping")}
    if advice is not None:
        row |= {"advised_stiffness": advice["stiffness"], "advised_damping": advice["damping"]}
    return row


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """Write the table: Parquet if the name ends in .parquet, else CSV.

    Raises
    ------
    StickSlipError
        If Parquet is asked for and the package pyarrow is missing.
    OSError
        If it cannot be written.
    """
    if path.suffix == ".parquet":
        _write_parquet(path, rows)
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]) if rows else ["bag"])
        writer.writeheader()
        writer.writerows(rows)


def _write_parquet(path: Path, rows: Sequence[Row]) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise StickSlipError(f"Parquet needs the package {error.name}: pip install 'stickslip_ros[parquet]'") from error
    text, whole = pyarrow.string(), pyarrow.int64()
    flags = {"exactly_smooth", "per_inertia"} | {f"{name}_identified" for name in NAMES}
    kinds = dict.fromkeys(("bag", "robot", "joint", "status", "error"), text)
    kinds |= dict.fromkeys(("samples", "cycles", "warnings"), whole) | dict.fromkeys(flags, pyarrow.bool_())
    # Types by name, not by what happens to be there: tables of many runs fit together.
    schema = pyarrow.schema([(name, kinds.get(name, pyarrow.float64())) for name in (rows[0] if rows else ["bag"])])
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(rows), schema=schema), path)
