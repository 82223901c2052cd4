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
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from itertools import pairwise
from os.path import commonprefix

from stickslip_ros.settings.parameter_names import did_you_mean, nearest_name

TIME, POSITION = "time", "position"
_REFERENCES = {POSITION: "reference_position", "velocity": "reference_velocity"}
FIELDS = (TIME, POSITION, "velocity", "effort", *_REFERENCES.values())

# Whose factor is only known with the counts that make a turn: `counts/4096`.
COUNTS = "counts"
_COUNTS_A_TURN = re.compile(rf"{COUNTS}_per_([1-9]\d*(?:\.\d+)?)(_per_s)?")
_ROTATION = {"rad": 1.0, "deg": math.pi / 180.0, "rev": 2.0 * math.pi, COUNTS: math.nan}
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
_OTHER_PLACES = {
    "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad",
    "revs": "rev", "revolution": "rev", "revolutions": "rev", "turn": "rev", "turns": "rev",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "millimeter": "mm", "millimeters": "mm",
    "millimetre": "mm", "millimetres": "mm", "µm": "um", "count": COUNTS, "ticks": COUNTS, "tick": COUNTS,
}  # fmt: skip
_OTHER_SPELLINGS = _OTHER_PLACES | {
    f"{other}_per_{second}": f"{unit}_per_s"
    for other, unit in ({unit: unit for unit in _PLACE} | _OTHER_PLACES).items()
    for second in ("s", "sec", "second")
} | {
    "rads": "rad_per_s", "rad_s": "rad_per_s", "degs": "deg_per_s", "deg_s": "deg_per_s",
    "mm_s": "mm_per_s", "m_s": "m_per_s",
    "n_m": "nm", "newton_meter": "nm", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "millisecond": "ms", "milliseconds": "ms", "millisec": "ms", "millisecs": "ms", "msec": "ms", "msecs": "ms",
    "microsecond": "us", "microseconds": "us", "microsec": "us", "microsecs": "us", "usec": "us", "usecs": "us",
    "µs": "us", "nanosecond": "ns", "nanoseconds": "ns", "nanosec": "ns", "nanosecs": "ns", "nsec": "ns", "nsecs": "ns",
}  # fmt: skip

# Of names that are as good, the first serves; "" is a unit by itself, as in `seconds`.
_TIMES = ("time", "timestamp", "stamp", "header_stamp", "t", "time_stamp", "elapsed", "elapsed_time", "log_time",
          "clock", "datetime", "date_time", "date", "ts", "")  # fmt: skip
_AROUND = ("joint", "joints", "states", "state", "field", "msg", "data")  # words before the time of a message
_KINDS = {
    ("position",): POSITION, ("positions",): POSITION, ("pos",): POSITION, ("q",): POSITION, ("angle",): POSITION,
    ("angles",): POSITION, ("theta",): POSITION, ("process", "value"): POSITION,
    ("velocity",): "velocity", ("velocities",): "velocity", ("vel",): "velocity", ("qd",): "velocity",
    ("dq",): "velocity", ("qdot",): "velocity", ("q", "dot"): "velocity", ("speed",): "velocity",
    ("omega",): "velocity", ("process", "value", "dot"): "velocity",
    ("effort",): "effort", ("efforts",): "effort", ("torque",): "effort", ("torques",): "effort", ("tau",): "effort",
    ("tau", "j"): "effort", ("force",): "effort", ("moment",): "effort",
}  # fmt: skip
_DESIRED = ("action", "reference", "ref", "desired", "des", "target", "setpoint", "goal", "commanded", "command", "cmd")
_SET_POINT = ("set", "point")  # of a position controller, as control_msgs spells it
# Whose column a desired word names need not be said again: `shoulder_goal`; what they want alone may be anything.
_DESIRED_PLACES = ("reference", "ref", "goal", "target", "setpoint")
# Gains of the controller, which some messages have beside the positions: `position_p`, `position_i_clamp`.
_GAINS = frozenset({"p", "i", "i_clamp", "i_clamp_min", "i_clamp_max", "i_max", "i_min", "antiwindup"})
_DERIVATIVE_GAIN = "d"  # which is also what is desired, as in q_d, unless other gains stand beside it
_MEASURED = ("measured", "meas", "actual", "act", "feedback", "fbk", "present", "current")
_MOTORS = "current"  # where nothing says what of, it is the motor's
_FILTERED = ("filtered", "filt")  # where the same is there unfiltered, that serves
# Of efforts that there are the first one serves: what the motor gave. What it was told to give comes after them.
_EFFORTS = (("effort",), _MEASURED, ("friction",), ("torque", "torques", "tau", "moment"), ())
# What has one of these words is about a joint, but none of its fields.
_NO_FIELD = {
    "error", "err", "limit", "max", "min", "std", "offset", "sensor", "temperature", "feedforward", "ext", "external",
    "tcp", "ee", "eef", "pose", "cartesian", "acceleration", "gravity", "covariance",
}  # fmt: skip
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|\d+|°")
_UNIT_IN_BRACKETS = re.compile(r"\s*[\[(]\s*([^\W\d][^\])]*|°[^\])]*)[\])]")
_OUTPUT_OF_A_CONTROLLER = re.compile(r"\boutput\.(positions|velocities|accelerations|effort)\b")
_JOINT_ALONE = re.compile(r"(joint|axis|j)[ _.]?\d+|.+[ _]joint", re.IGNORECASE)
_STAR = "*"
_LONGEST_UNIT = 3  # words


@dataclass(frozen=True, kw_only=True)
class Column:
    """What a column means.

    Attributes
    ----------
    name : in the table. field : one of :data:`FIELDS`. joint : as the name has it, "" where it has none.
    unit : a key of :data:`UNITS` of the field, "" where the name has none; then the usual one is ``assumed``.
    rank : of columns of the same field and joint the one of the lowest serves.
    """

    name: str
    field: str
    joint: str = ""
    unit: str = ""
    assumed: bool = False
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
    bracketed_unit = spelled_unit(bracketed[1]) if bracketed else ""
    words = list(_WORD.finditer(rest))
    lower = [word[0].lower() for word in words]
    found = _time(lower, bracketed_unit)
    if found is not None:
        rank, unit = found
        return Column(name=name, field=TIME, unit=unit, rank=rank)
    if _NO_FIELD & set(lower) or _OUTPUT_OF_A_CONTROLLER.search(name):
        return None
    kind, taken = _kind(lower)
    pairs = [number for number, pair in enumerate(pairwise(lower)) if pair == _SET_POINT]
    desired = [*_where(lower, _DESIRED), *pairs, *(number + 1 for number in pairs)]
    if kind is None:
        # `reference_rad` and `elbow_goal` are of the position; a wish without unit and joint may be anything.
        if not desired or set(lower) & set(_MEASURED):
            return None
        kind, taken = POSITION, set(desired)
        of_a_joint = set(lower) & set(_DESIRED_PLACES) and _joint(rest, words, taken)
        if not (pairs or of_a_joint or bracketed_unit in _PLACE or _unit_at(lower, taken, POSITION)[0]):
            return None
    after = max(taken) + 1
    if "_".join(lower[after:]) in _GAINS:
        return None
    if after < len(lower) and lower[after] == _DERIVATIVE_GAIN and kind in _REFERENCES:
        desired = [*desired, after]
    field = _REFERENCES.get(kind, kind) if desired else kind
    filtered = _where(lower, _FILTERED)
    qualifiers = {*desired, *filtered, *_where(lower, _MEASURED)}
    qualifiers |= set(_where(lower, ("friction",)) if kind == "effort" else ())
    taken = taken | qualifiers
    unit, at = (bracketed_unit, set()) if bracketed_unit in UNITS[field] else _unit_at(lower, taken, field)
    if bracketed_unit and bracketed_unit not in UNITS[field]:
        return None
    rank = next(number for number, some in enumerate(_EFFORTS) if not some or set(some) & set(lower))
    rank = (len(_EFFORTS) if desired else rank) if kind == "effort" else 0
    rank += (len(_EFFORTS) + 1) * bool(filtered)
    return Column(name=name, field=field, joint=_joint(rest, words, taken | at), unit=unit, rank=rank)


def _time(words: Sequence[str], bracketed_unit: str) -> tuple[int, str] | None:
    """Rank and unit of a column of time; None if it is none."""
    while words and words[0] in _AROUND:
        words = words[1:]
    unit, at = (bracketed_unit, set()) if bracketed_unit in _TIME else _unit_at(words, set(), TIME)
    if bracketed_unit and bracketed_unit not in _TIME:
        return None
    kept = "_".join(word for number, word in enumerate(words) if number not in at)
    return (_TIMES.index(kept), unit) if kept in _TIMES and (kept or unit) else None


def _kind(words: Sequence[str]) -> tuple[str | None, set[int]]:
    """The field that the last words say that say one, and where they are."""
    for last in reversed(range(len(words))):
        for length in (3, 2, 1):
            first = last + 1 - length
            kind = _KINDS.get(tuple(words[first : last + 1])) if first >= 0 else None
            if kind is not None:
                return kind, set(range(first, last + 1))
    return None, set()


def factor_of(field: str, unit: str) -> float:
    """What a value in a unit is multiplied with, to have SI units; NaN of counts whose number a turn is not known.

    Raises
    ------
    ValueError
        If the unit is none of the field's; the text lists them.
    """
    counts = _COUNTS_A_TURN.fullmatch(unit)
    if counts is not None and bool(counts[2]) == field.endswith("velocity") and UNITS[field] in (_PLACE, _SPEED):
        return 2.0 * math.pi / float(counts[1])
    if unit not in UNITS[field]:
        raise ValueError(f"a unit of {', '.join(shown_unit(one) for one in UNITS[field])}")
    return UNITS[field][unit]


def shown_unit(unit: str) -> str:
    """A unit as people write it; it may be typed so."""
    shown = unit.replace("_per_", "/").replace("nm", "N·m")
    return shown.replace(COUNTS, f"{COUNTS}/4096") if unit in (COUNTS, f"{COUNTS}_per_s") else shown


def hint(field: str, columns: Mapping[str, tuple[str, str]]) -> str:
    """Options that say of a field which columns it has, and in which units, by joint: one with a * where that does."""
    names = [name for name, _ in columns.values()]
    units = [shown_unit(unit) for _, unit in columns.values()]
    # These are no paths: character by character is meant.
    before, after = commonprefix(names), commonprefix([name[::-1] for name in names])[::-1]  # noqa: RUF071
    stars = [name[len(before) : len(name) - len(after)] for name in names]
    joints = [f"joint{star}" if star.isdigit() else star for star in stars]
    if len(names) > 1 and len(set(units)) == 1 and joints == list(columns):
        names, units = [f"{before}{_STAR}{after}"], units[:1]
    return " ".join(f"--column '{field}={name}:{unit}'" for name, unit in zip(names, units, strict=True))


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
            unit = spelled_unit(" ".join(words[begin : begin + length]))
            if unit in UNITS[field]:
                return unit, places
    return "", set()


def spelled_unit(text: str) -> str:
    """A unit as :data:`UNITS` has it, if it is one; else the text in lower case."""
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


def assign(
    names: Sequence[str],
    named: Sequence[Named] = (),
    days: AbstractSet[str] = frozenset(),
    clocks: AbstractSet[str] = frozenset(),
    layout: Sequence[Named] = (),
) -> Assignment:
    """Which columns serve, by what the user says and else by their names.

    Parameters
    ----------
    days, clocks : columns of dates without a time, and of times of the day.
    layout : what the file itself says of columns; the user's word counts more.

    Raises
    ------
    ValueError
        If a column named is not there, has no effect, or its unit is none of the field's, or there is no time or no
        position.
    """
    fields = {one.field for one in named}
    known = _named_columns(names, layout)
    by_user = _named_columns(names, named, {column.name: column.joint for _, column in known})
    for name, count in Counter(column.name for _, column in by_user).items():
        if count > 1:
            meant = " and ".join(column.field for _, column in by_user if column.name == name)
            raise ValueError(f"column {name!r} must be named once: it is for {meant}")
    own = [column for one, column in known if one.field not in fields]
    fields |= {column.field for column in own}
    taken = {column.name for _, column in by_user} | {column.name for column in own}
    free = [name for name in names if name not in taken]
    gains = _derivative_gains(names)
    recognised = [one for name in free if name not in gains and (one := meaning(name)) is not None]
    recognised = [one for one in recognised if one.field not in fields]
    by_joint = _positions_by_joint(free, recognised) if POSITION not in fields else []
    if any(one.field == POSITION and _JOINT_ALONE.fullmatch(one.joint) for one in (*recognised, *by_joint)):
        # Beside joints these are a tool's.
        recognised = [one for one in recognised if one.joint.lower() not in ("x", "y", "z")]
    if all(one.field != POSITION for one in recognised):
        recognised += by_joint
    columns = [*(column for _, column in by_user), *own, *recognised]
    times = sorted((one for one in columns if one.field == TIME), key=lambda one: (one.name in days, one.rank))
    joints: dict[str, dict[str, Column]] = {}
    for one in columns:
        if one.field != TIME:
            kept = joints.setdefault(one.joint, {}).get(one.field)
            if kept is None or one.rank < kept.rank:
                joints[one.joint][one.field] = one
    joints = _with_position(joints, [column for _, column in by_user])
    for field, there in ((TIME, times), (POSITION, joints)):
        if not there:
            wanted = " or ".join(f"{field}_{unit}" for unit in UNITS[field])
            option = f"one named with stickslip convert --column {field}=COLUMN"
            every = "; if every other column is a joint's position: --column 'position=*'" if field == POSITION else ""
            raise ValueError(f"needs a column {wanted}, or {option}; has {_listed(names)}{every}")
    time = _parts_of_time(times, days, clocks)
    used = {one.name for one in time} | {one.name for found in joints.values() for one in found.values()}
    for wish in named:
        if not any(column.name in used for by, column in by_user if by is wish):
            raise ValueError(_without_effect(wish, joints))
    return Assignment(time=time, joints=joints, unused=tuple(name for name in names if name not in used))


def _positions_by_joint(names: Iterable[str], recognised: Sequence[Column]) -> list[Column]:
    """Positions, where no name says so: columns that are named after joints and nothing else, and what is actual beside
    what is wanted of the same joint, with that: `elbow_actual` and `elbow_target`.
    """
    others = [name for name in names if meaning(name) is None]
    alone = [Column(name=name, field=POSITION, joint=name) for name in others if _JOINT_ALONE.fullmatch(name)]
    pairs = [
        replace(one, name=name)
        for name in others
        if _MOTORS not in name.lower() and (one := meaning(_WORD.sub(_with_field, name))) is not None and one.joint
    ]
    actual, wanted = (
        {one.joint for one in (*recognised, *pairs) if one.field == field}
        for field in (POSITION, _REFERENCES[POSITION])
    )
    return [*alone, *(one for one in pairs if one.joint in actual & wanted)]


def _with_field(word: re.Match[str]) -> str:
    return f"{word[0]}_{POSITION}" if word[0].lower() in (*_DESIRED, *_MEASURED) else word[0]


def _with_position(joints: dict[str, dict[str, Column]], by_user: Sequence[Column]) -> dict[str, dict[str, Column]]:
    """The joints that have a position. Columns that name no joint, and those that the user names, are of the only
    one.
    """
    kept = {joint: found for joint, found in joints.items() if POSITION in found}
    if len(kept) == 1:
        (only,) = kept.values()
        for joint, found in joints.items():
            for field, column in found.items():
                if joint == "" or column in by_user:
                    only.setdefault(field, column)
    return kept


def _without_effect(one: Named, joints: Mapping[str, Mapping[str, Column]]) -> str:
    """Why a column that the user names does not serve."""
    other = next((found[one.field].name for found in joints.values() if one.field in found), None)
    if one.field == TIME or (len(joints) == 1 and other is not None):
        return f"--column {one.field}={one.column}: has no effect, for another column is its {one.field}"
    listed = ", ".join(joints)
    return (
        f"--column {one.field}={one.column}: has no effect, for its name says of none of the joints {listed}; "
        f"name it after its joint, as in {next(iter(joints))}_{one.field}"
    )


def _derivative_gains(names: Sequence[str]) -> set[str]:
    """`position_d` beside `position_p` is a gain, not what is desired."""
    stems = {_stem(name) for name in names if _last_word(name) == "p"}
    return {name for name in names if _last_word(name) == _DERIVATIVE_GAIN and _stem(name) in stems}


def _parts_of_time(times: Sequence[Column], days: AbstractSet[str], clocks: AbstractSet[str]) -> tuple[Column, ...]:
    """The column of time, or the two of a stamp: whole seconds and the nanoseconds beyond them, or day and time."""
    first = times[0]
    if first.name in clocks:
        return (first, *[one for one in times if one.name in days][:1])
    if _last_word(first.name) in ("sec", "secs"):
        rest = [one for one in times if one.unit == "ns" and _stem(one.name) == _stem(first.name)]
        return (first, *rest[:1])
    return (first,)


def _last_word(name: str) -> str:
    words = _WORD.findall(name)
    return words[-1].lower() if words else ""


def _stem(name: str) -> str:
    return "_".join(word.lower() for word in _WORD.findall(name)[:-1])


def _named_columns(
    names: Sequence[str], named: Sequence[Named], joints: Mapping[str, str] | None = None
) -> list[tuple[Named, Column]]:
    """The columns that somebody names, whose joints may be known."""
    found: list[tuple[Named, Column]] = []
    alone = [one for one in named if one.field == POSITION and _STAR not in one.column]
    only = _own_joint(alone[0]) if len(alone) == 1 and not any(_STAR in one.column for one in named) else None
    by_name = {_as_in_table(one.column, names) for one in named if _STAR not in one.column}
    for one in named:
        before, star, after = one.column.partition(_STAR)
        if star:
            # A star stands for no column that has another meaning.
            fits = [
                (name, name[len(before) : len(name) - len(after)])
                for name in names
                if name.startswith(before) and name.endswith(after) and len(name) > len(before) + len(after)
                if name not in by_name and not ((recognised := meaning(name)) and recognised.field == TIME)
            ]
            if not fits:
                raise ValueError(f"no column {one.column!r} for {one.field}; has {_listed(names)}")
            found += [(one, _column(one, name, f"joint{joint}" if joint.isdigit() else joint)) for name, joint in fits]
            continue
        column = _as_in_table(one.column, names)
        if column not in names:
            near = did_you_mean(nearest_name(one.column, names))
            raise ValueError(f"no column {one.column!r} for {one.field}{near or '; has ' + _listed(names)}")
        joint = (joints or {}).get(column) or (only if only is not None else _own_joint(one) or column)
        found.append((one, _column(one, column, "" if one.field == TIME else joint)))
    return found


def _as_in_table(column: str, names: Sequence[str]) -> str:
    """A column's name without the mark of a comment that its line begins with, as in `%time`."""
    bare = column.lstrip("%# ")
    return bare if column not in names and bare in names else column


def _own_joint(one: Named) -> str:
    recognised = meaning(one.column)
    return recognised.joint if recognised is not None and recognised.field == one.field else ""


def _column(one: Named, name: str, joint: str) -> Column:
    recognised = meaning(name)
    unit = one.unit or _unit_at([word.lower() for word in _WORD.findall(name)], set(), one.field)[0]
    unit = unit or (recognised.unit if recognised is not None and recognised.field == one.field else "")
    return Column(name=name, field=one.field, joint=joint, unit=unit, rank=-1)


def _listed(names: Sequence[str], most: int = 20) -> str:
    shown = ", ".join(names[:most]) or "none"
    return f"{shown}, and {len(names) - most} more" if len(names) > most else shown
