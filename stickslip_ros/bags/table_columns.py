# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the columns of a table mean, told by their names: the field, the joint and the unit.

A name is taken apart into words: ``shoulder_pos``, ``q1``, ``position[0]``, ``/joint_states/elbow/velocity``,
``target_q_3``, ``Joint 2 Torque [Nm]``. One word or two say what it is, words such as *actual* or *target* whose, the
last one may be a unit, and what remains names the joint. What is no field's is left alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from stickslip_ros.settings.nearest_name import did_you_mean

TIME, POSITION = "time", "position"
_REFERENCES = {POSITION: "reference_position", "velocity": "reference_velocity"}
FIELDS = (TIME, POSITION, "velocity", "effort", *_REFERENCES.values())

_ROTATION = {"rad": 1.0, "deg": math.pi / 180.0}
TRANSLATION = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_EFFORT = {"nm": 1.0, "n": 1.0, "mnm": 1e-3}
_SPEED = {f"{unit}_per_s": factor for unit, factor in (_ROTATION | TRANSLATION).items()} | {"rpm": math.pi / 30.0}
_PLACE = _ROTATION | TRANSLATION
UNITS: dict[str, dict[str, float]] = {
    TIME: _TIME,
    POSITION: _PLACE,
    "velocity": _SPEED,
    "effort": _EFFORT,
    "reference_position": _PLACE,
    "reference_velocity": _SPEED,
}
# Where a name has no unit; of time it is told by its values.
USUAL_UNIT = {TIME: "", POSITION: "rad", "velocity": "rad_per_s", "effort": "nm",
              "reference_position": "rad", "reference_velocity": "rad_per_s"}  # fmt: skip
_OTHER_SPELLINGS = {
    "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad",
    "°_per_s": "deg_per_s", "rads": "rad_per_s", "rad_s": "rad_per_s", "degs": "deg_per_s", "deg_s": "deg_per_s",
    "rad_per_sec": "rad_per_s", "deg_per_sec": "deg_per_s", "µm": "um", "mm_s": "mm_per_s", "m_s": "m_per_s",
    "n_m": "nm", "newton_meter": "nm", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "millisecond": "ms", "milliseconds": "ms", "msec": "ms", "msecs": "ms",
    "microsecond": "us", "microseconds": "us", "usec": "us", "usecs": "us", "µs": "us",
    "nanosecond": "ns", "nanoseconds": "ns", "nsec": "ns", "nsecs": "ns", "nanosec": "ns",
}  # fmt: skip

# Of names that are as good, the first serves; "" is a unit by itself, as in `seconds`.
_TIMES = ("time", "timestamp", "stamp", "header_stamp", "t", "time_stamp", "elapsed", "elapsed_time", "log_time",
          "clock", "datetime", "date_time", "date", "ts", "")  # fmt: skip
_AROUND = ("joint", "joints", "states", "state", "field", "msg", "data")  # words before the time of a message
_KINDS = {
    ("position",): POSITION, ("positions",): POSITION, ("pos",): POSITION, ("q",): POSITION, ("angle",): POSITION,
    ("angles",): POSITION, ("theta",): POSITION,
    ("velocity",): "velocity", ("velocities",): "velocity", ("vel",): "velocity", ("qd",): "velocity",
    ("dq",): "velocity", ("qdot",): "velocity", ("q", "dot"): "velocity", ("speed",): "velocity",
    ("omega",): "velocity",
    ("effort",): "effort", ("efforts",): "effort", ("torque",): "effort", ("torques",): "effort", ("tau",): "effort",
    ("tau", "j"): "effort", ("force",): "effort", ("moment",): "effort",
}  # fmt: skip
_DESIRED = ("action", "reference", "ref", "desired", "des", "target", "setpoint", "goal", "commanded", "command", "cmd")
_MEASURED = ("measured", "meas", "actual", "act", "feedback", "fbk", "present", "current")
_AFTER_KIND = ("d",)  # desired, as in q_d
# Of efforts that there are the first one serves: what the motor gave, or was told to give.
_EFFORTS = (("effort",), _MEASURED, ("friction",), _DESIRED, ("torque", "torques", "tau", "moment"), ())
# What has one of these words is about a joint, but none of its fields.
_NO_FIELD = {
    "error", "err", "limit", "max", "min", "std", "offset", "sensor", "temperature", "feedforward", "ext", "external",
    "tcp", "pose", "cartesian", "acceleration", "gravity", "covariance",
}  # fmt: skip
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+|°")
_UNIT_IN_BRACKETS = re.compile(r"\s*[\[(]\s*([^\W\d][^\])]*|°[^\])]*)[\])]")
_STAR = "*"
_LONGEST_UNIT = 3  # words


@dataclass(frozen=True, kw_only=True)
class Column:
    """What a column means.

    Attributes
    ----------
    name : in the table. field : one of :data:`FIELDS`. joint : as the name has it, "" where it has none.
    unit : a key of :data:`UNITS` of the field, "" where the name has none.
    rank : of columns of the same field and joint the one of the lowest serves.
    """

    name: str
    field: str
    joint: str = ""
    unit: str = ""
    rank: int = 0


@dataclass(frozen=True, kw_only=True)
class Named:
    """What the user says of columns: `position=q*:deg`. A * in the column's name stands for the joint."""

    field: str
    column: str
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """Which columns serve: of time (seconds and nanoseconds may be two), and of each joint by field."""

    time: tuple[Column, ...]
    joints: dict[str, dict[str, Column]]
    unused: tuple[str, ...]


def meaning(name: str) -> Column | None:
    """What a column means by its name; None if it is no field's."""
    rest, bracketed = _UNIT_IN_BRACKETS.sub("", name, count=1), _UNIT_IN_BRACKETS.search(name)
    said = _spelled(bracketed[1]) if bracketed else ""
    words = list(_WORD.finditer(rest))
    lower = [word[0].lower() for word in words]
    found = _time(lower, said)
    if found is not None:
        rank, unit = found
        return Column(name=name, field=TIME, unit=unit, rank=rank)
    if _NO_FIELD & set(lower):
        return None
    kind, taken = _kind(lower)
    desired = _where(lower, _DESIRED)
    if kind is None:
        # `reference_rad` is of the position; a wish without a unit may be anything.
        if not desired or set(lower) & set(_MEASURED):
            return None
        kind, taken = POSITION, set(desired)
        if not (said in _PLACE or _unit_at(lower, taken, POSITION)[0]):
            return None
    after = max(taken) + 1
    if after < len(lower) and lower[after] in _AFTER_KIND and kind in _REFERENCES:
        desired = [*desired, after]
    field = _REFERENCES.get(kind, kind) if desired else kind
    qualifiers = {*desired, *_where(lower, _MEASURED), *(_where(lower, ("friction",)) if kind == "effort" else ())}
    taken = taken | qualifiers
    unit, at = (said, set()) if said in UNITS[field] else _unit_at(lower, taken, field)
    if said and said not in UNITS[field]:
        return None
    rank = next(number for number, some in enumerate(_EFFORTS) if not some or set(some) & set(lower))
    joint = _joint(rest, words, taken | at)
    return Column(name=name, field=field, joint=joint, unit=unit, rank=rank if kind == "effort" else 0)


def _time(words: Sequence[str], said: str) -> tuple[int, str] | None:
    """Rank and unit of a column of time; None if it is none."""
    while words and words[0] in _AROUND:
        words = words[1:]
    unit, at = (said, set()) if said in _TIME else _unit_at(words, set(), TIME)
    if said and said not in _TIME:
        return None
    kept = "_".join(word for number, word in enumerate(words) if number not in at)
    return (_TIMES.index(kept), unit) if kept in _TIMES and (kept or unit) else None


def _kind(words: Sequence[str]) -> tuple[str | None, set[int]]:
    """The field that the last words say that say one, and where they are."""
    for last in reversed(range(len(words))):
        for length in (2, 1):
            first = last + 1 - length
            kind = _KINDS.get(tuple(words[first : last + 1])) if first >= 0 else None
            if kind is not None:
                return kind, set(range(first, last + 1))
    return None, set()


def _where(words: Sequence[str], wanted: Iterable[str]) -> list[int]:
    return [number for number, word in enumerate(words) if word in wanted]


def _unit_at(words: Sequence[str], taken: set[int], field: str) -> tuple[str, set[int]]:
    """The unit that words behind those taken say, or the last ones but for a number, and where they are."""
    last = len(words) - 1 if not (words and words[-1].isdigit()) else len(words) - 2
    for length in range(_LONGEST_UNIT, 0, -1):
        begins = [last + 1 - length, *([max(taken) + 1] if taken else [])]
        for begin in begins:
            places = set(range(begin, begin + length))
            if begin < 0 or begin + length > len(words) or places & taken:
                continue
            unit = _spelled(" ".join(words[begin : begin + length]))
            if unit in UNITS[field]:
                return unit, places
    return "", set()


def _spelled(text: str) -> str:
    """A unit as :data:`UNITS` has it, if it is one."""
    words = "_".join(text.lower().replace("/", " per ").replace("·", "").replace("*", "").split())
    return _OTHER_SPELLINGS.get(words, words)


def _joint(name: str, words: Sequence[re.Match[str]], taken: set[int]) -> str:
    """What is left of a name, as it is written there."""
    left = [number for number in range(len(words)) if number not in taken]
    lower = [words[number][0].lower() for number in left]
    # Of the topic, where the tools that write tables have it.
    for begin in (["joint", "states"], ["joint", "state"], ["field"]):
        if lower[: len(begin)] == begin:
            left, lower = left[len(begin) :], lower[len(begin) :]
    if not left or lower in (["joint"], ["joints"]):
        return ""
    text = words[left[0]][0]
    for before, number in pairwise(left):
        between = name[words[before].end() : words[number].start()] if number == before + 1 else "_"
        text += re.sub(r"[\[\]().\s]+", "_", between) + words[number][0]
    return f"joint{text}" if text.isdigit() else text


def assign(names: Sequence[str], named: Sequence[Named] = ()) -> Assignment:
    """Which columns serve, by what the user says and else by their names.

    Raises
    ------
    ValueError
        If a column named is not there, or its unit is none of the field's, or there is no time or no position.
    """
    said = _said(names, named)
    fields = {column.field for column in said}
    columns = [*said, *(one for name in names if (one := meaning(name)) is not None and one.field not in fields)]
    times = sorted((one for one in columns if one.field == TIME), key=lambda one: one.rank)
    joints: dict[str, dict[str, Column]] = {}
    for one in columns:
        if one.field != TIME:
            kept = joints.setdefault(one.joint, {}).get(one.field)
            if kept is None or one.rank < kept.rank:
                joints[one.joint][one.field] = one
    joints = {joint: found for joint, found in joints.items() if POSITION in found}
    for field, there in ((TIME, times), (POSITION, joints)):
        if not there:
            wanted = " or ".join(f"{field}_{unit}" for unit in UNITS[field])
            raise ValueError(f"needs a column {wanted}, or one named with --column; has {_listed(names)}")
    time = tuple(times[:1]) if fields & {TIME} else _seconds_and_rest(times)
    used = {one.name for one in time} | {one.name for found in joints.values() for one in found.values()}
    return Assignment(time=time, joints=joints, unused=tuple(name for name in names if name not in used))


def _seconds_and_rest(times: Sequence[Column]) -> tuple[Column, ...]:
    """The column of time, or the two of a stamp: whole seconds, and the nanoseconds beyond them."""
    first = times[0]
    if _last_word(first.name) in ("sec", "secs"):
        rest = [one for one in times if one.unit == "ns" and _stem(one.name) == _stem(first.name)]
        return (first, *rest[:1])
    return (first,)


def _last_word(name: str) -> str:
    words = _WORD.findall(name)
    return words[-1].lower() if words else ""


def _stem(name: str) -> str:
    return "_".join(word.lower() for word in _WORD.findall(name)[:-1])


def _said(names: Sequence[str], named: Sequence[Named]) -> list[Column]:
    """The columns that the user names."""
    found: list[Column] = []
    alone = [one for one in named if one.field == POSITION and _STAR not in one.column]
    only = _own_joint(alone[0]) if len(alone) == 1 and not any(_STAR in one.column for one in named) else None
    for one in named:
        before, star, after = one.column.partition(_STAR)
        if star:
            fits = [
                (name, name[len(before) : len(name) - len(after)])
                for name in names
                if name.startswith(before) and name.endswith(after) and len(name) > len(before) + len(after)
            ]
            if not fits:
                raise ValueError(f"no column {one.column!r} for {one.field}; has {_listed(names)}")
            found += [_column(one, name, f"joint{joint}" if joint.isdigit() else joint) for name, joint in fits]
            continue
        if one.column not in names:
            near = did_you_mean(one.column, names)
            raise ValueError(f"no column {one.column!r} for {one.field}{near or '; has ' + _listed(names)}")
        joint = only if only is not None else _own_joint(one) or one.column
        found.append(_column(one, one.column, "" if one.field == TIME else joint))
    return found


def _own_joint(one: Named) -> str:
    told = meaning(one.column)
    return told.joint if told is not None and told.field == one.field else ""


def _column(one: Named, name: str, joint: str) -> Column:
    told = meaning(name)
    unit = one.unit or _unit_at([word.lower() for word in _WORD.findall(name)], set(), one.field)[0]
    unit = unit or (told.unit if told is not None and told.field == one.field else "")
    return Column(name=name, field=one.field, joint=joint, unit=unit, rank=-1)


def _listed(names: Sequence[str], most: int = 20) -> str:
    shown = ", ".join(names[:most]) or "none"
    return f"{shown}, and {len(names) - most} more" if len(names) > most else shown
