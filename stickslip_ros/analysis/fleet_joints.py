# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A fleet's answers as one table, a row for each joint of each bag; and each joint over its recordings: how it is now,
how it changes, which alarms ring.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip_ros.analysis.fleet import Answer
from stickslip_ros.analysis.judgement import JUDGED, SEVERITY
from stickslip_ros.analysis.trend import BEYOND_CHANCE, YEAR_2001, Measured, Trend, trend
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.files import whole_file
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES
from stickslip_ros.output import published
from stickslip_ros.output.csv_table import write_csv

# What is shorter says too little of a joint to be a point of its history: a few cycles of a slow one.
LEAST_MOVING = 5.0  # [s]
# What an alarm may be about: what it is called, and whether it is a share, which is told in per cent.
QUANTITIES = {
    "coulomb": ("Coulomb friction", False),
    "stribeck": ("Stribeck friction", False),
    "viscous": ("viscous friction", False),
    "stick_slip": ("stick-slip", True),
    "reserve": ("damping reserve", True),
}
_FORM = re.compile(r"\s*([a-z_]+)\s*(=\s*[+-]|[<>])\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*(%?)\s*")
_NEVER = 0.0

Row = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """What rings.

    Attributes
    ----------
    quantity : one of :data:`QUANTITIES`. text : as it was typed.
    change : share of the first value by which the latest has to differ, signed; NaN if the alarm has a bound instead.
    above, below : bounds of the latest value; infinite if there is none.
    """

    quantity: str
    text: str
    change: float = math.nan
    above: float = math.inf
    below: float = -math.inf

    def rings(self, first: Measured, latest: Measured) -> str:
        """What is the matter, in words; "" if nothing is.

        A change counts where it is also more than chance makes of both errors, a bound where it is passed by more
        than the value's error.
        """
        name, is_share = QUANTITIES[self.quantity]
        error = math.hypot(*(one.error if one.error > 0.0 else 0.0 for one in (first, latest)))
        differs = latest.value - first.value
        if not math.isnan(self.change):
            threshold = self.change * abs(first.value)
            if abs(differs) < abs(threshold) or differs * self.change <= 0.0 or abs(differs) <= BEYOND_CHANCE * error:
                return ""
            share = f" ({100.0 * differs / abs(first.value):+.0f} %)" if first.value else ""
            return f"{name} {_value_text(first.value, is_share)} → {_value_text(latest.value, is_share)}{share}"
        own = BEYOND_CHANCE * latest.error if latest.error > 0.0 else 0.0
        if latest.value - own > self.above or latest.value + own < self.below:
            return f"{name} {_value_text(latest.value, is_share)}"
        return ""


def _value_text(value: float, is_share: bool) -> str:
    return f"{100.0 * value:.0f} %" if is_share else f"{value:.3g}"


def parse_alarm(text: str) -> Alarm:
    """An alarm as it is typed: ``coulomb=+15%``, ``reserve=-30%``, ``stick_slip>5%``, ``reserve<20%``, ``coulomb>12``.

    Raises
    ------
    InvalidParameterError
        If it is none of these; the text says what would be.
    """
    found = _FORM.fullmatch(text)
    if found is None:
        raise InvalidParameterError("--alarm", "like coulomb=+15%, reserve=-30% or 'stick_slip>5%'", text)
    name, sign, number, percent = found.groups()
    if name not in QUANTITIES:
        raise InvalidParameterError("--alarm", f"about one of {', '.join(QUANTITIES)}", text)
    try:
        value = float(number) * (0.01 if percent else 1.0)
    except ValueError:
        raise InvalidParameterError("--alarm", "with a number after its sign", text) from None
    if not (math.isfinite(value) and (value > 0.0 or sign in "<>")):
        raise InvalidParameterError("--alarm", "with a finite number above 0", text)
    if sign.startswith("="):
        if not percent:
            raise InvalidParameterError("--alarm", "a change in per cent, like coulomb=+15%", text)
        return Alarm(quantity=name, text=text, change=-value if sign.endswith("-") else value)
    if bool(percent) is not QUANTITIES[name][1]:
        unit = "in per cent" if QUANTITIES[name][1] else "a number in SI units, without %"
        raise InvalidParameterError("--alarm", f"with the bound of {name} {unit}", text)
    return Alarm(quantity=name, text=text, above=value) if sign == ">" else Alarm(quantity=name, text=text, below=value)


@dataclass(frozen=True, kw_only=True)
class History:
    """A quantity over the recordings that tell it, by their numbers; with its trend where their dates allow one."""

    points: dict[int, Measured]
    trend: Trend | None

    @property
    def latest(self) -> float:
        """Value of the last recording that tells it; NaN if none does."""
        return next((one.value for one in reversed(self.points.values())), math.nan)


@dataclass(frozen=True, kw_only=True)
class FleetJoint:
    """One joint.

    Attributes
    ----------
    rows : its recordings, oldest first. dated : whether these have dates.
    histories : by the names of :data:`QUANTITIES`. alarms : what rings, in words.
    """

    robot: str
    name: str
    rows: tuple[Row, ...]
    dated: bool
    histories: dict[str, History]
    alarms: tuple[str, ...]

    @property
    def latest(self) -> Row:
        """Its last recording."""
        return self.rows[-1]

    @property
    def _judged(self) -> Row:
        """The last recording in which its motion could be judged, else the last one."""
        return next((row for row in reversed(self.rows) if Status(row["status"]) in JUDGED), self.latest)

    @property
    def status(self) -> Status:
        """In the last recording in which its motion could be judged, else in the last one."""
        return Status(self._judged["status"])

    @property
    def reason(self) -> str:
        """Of this status; "" where it says it all."""
        return str(self._judged["reason"] or "")

    @property
    def worst(self) -> Status:
        """The most severe status that occurred in any of its recordings."""
        here = {row["worst_status"] for row in self.rows}
        return next(status for status in SEVERITY if status.value in here)

    @property
    def stuck_in(self) -> int:
        """In how many recordings stick-slip occurred."""
        return sum(row["worst_status"] == Status.STICK_SLIP.value for row in self.rows)


def fleet_joints(answers: Sequence[Answer], alarms: Sequence[Alarm] = ()) -> list[FleetJoint]:
    """All joints of all bags, the worst first: those with alarms, then by their share of stick-slip."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in sorted(rows_of(answers), key=lambda row: row["recorded"] or 0.0):
        # A bag that could not be analysed has no joint.
        if row["joint"] is not None:
            groups.setdefault((row["robot"], row["joint"]), []).append(row)
    return sorted((_joint(*key, rows, alarms) for key, rows in groups.items()), key=_badness)


def _badness(joint: FleetJoint) -> tuple[object, ...]:
    share = stick_slip_share(joint.rows)
    return (
        not joint.alarms,
        -share if math.isfinite(share) else 0.0,
        SEVERITY.index(joint.worst),
        joint.robot,
        joint.name,
    )


def _joint(robot: str, name: str, rows: Sequence[Row], alarms: Sequence[Alarm]) -> FleetJoint:
    dated = all(row["recorded"] is not None and row["recorded"] > YEAR_2001 for row in rows)
    histories = {quantity: _history(rows, quantity, dated=dated) for quantity in QUANTITIES}
    ringing = []
    for alarm in alarms:
        points = list(histories[alarm.quantity].points.values())
        if points:
            ringing.append(alarm.rings(points[0], points[-1]))
    return FleetJoint(
        robot=robot, name=name, rows=tuple(rows), dated=dated, histories=histories, alarms=tuple(filter(None, ringing))
    )


def _history(rows: Sequence[Row], name: str, *, dated: bool) -> History:
    long_enough = (number for number, row in enumerate(rows) if (row["moving_time"] or 0.0) >= LEAST_MOVING)
    measured = {number: _measured(rows[number], name) for number in long_enough}
    points = {number: one for number, one in measured.items() if math.isfinite(one.value)}
    times, known = [rows[number]["recorded"] for number in points], points.values()
    line = trend(times, [one.value for one in known], [one.error for one in known]) if dated else None
    return History(points=points, trend=line)


def _measured(row: Row, name: str) -> Measured:
    """A quantity of one recording; NaN where it is not known, or is known per inertia only."""
    if name in ("stick_slip", "reserve"):
        return Measured(value=_number(row["stick_slip_share" if name == "stick_slip" else name]))
    # Coulomb friction is known with any load where the joint moved in one direction alone.
    for column in (name, COULOMB_AND_LOAD) if name == "coulomb" else (name,):
        if row[f"{column}_identified"] and not row["per_inertia"]:
            return Measured(value=_number(row[column]), error=_number(row[f"{column}_std"]))
    return Measured()


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def rows_of(answers: Iterable[Answer]) -> list[Row]:
    """The rows; None for what is unknown, and a row with the error alone for a bag that could not be analysed."""
    rows = []
    for found in answers:
        path = Path(found["path"])
        if "error" in found:
            rows.append(_row(path, found) | {"error": found["error"]})
        for name, joint in found.get("joints", {}).items():
            own = {"robot": joint["robot"]} if "robot" in joint else {}
            rows.append(_row(path, found) | own | _columns(joint.get("joint", name), joint))
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
    return known | _columns(None, None) | {"warnings": len(found.get("warnings", [])), "error": None}


def _columns(name: str | None, joint: Mapping[str, Any] | None) -> Row:
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
    row |= published.PRESLIDING.for_fleet(joint.get("presliding")) | published.RING.for_fleet(joint.get("ring"))
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
