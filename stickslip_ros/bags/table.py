# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recordings that are tables (CSV, Parquet, NPZ) of one joint or many, as batches of samples in SI units."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import environ
from pathlib import Path
from shlex import quote

import numpy as np

from stickslip_ros.bags.lerobot import episode_of, is_data_set, name_an_episode, open_episode
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table_columns import (
    POSITION,
    TIME,
    TRANSLATION,
    UNITS,
    USUAL_UNIT,
    Column,
    Named,
    assign,
    factor_of,
    hint,
)
from stickslip_ros.bags.table_files import SUFFIXES, TableFile, open_table
from stickslip_ros.errors import StickSlipError, optional_packages, reason
from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.settings.known_joints import config_folder
from stickslip_ros.settings.parameter_names import did_you_mean, nearest_joint

# What a damaged table makes its readers raise.
_DAMAGE = (ValueError, EOFError, KeyError, MemoryError, NotImplementedError, zipfile.BadZipFile, zlib.error)
FOLDER_VARIABLE = "STICKSLIP_RECORDINGS"
_MOSTLY = 0.9  # share of the steps between rows
ONLY = "joint1"  # the joint of a table whose columns name none
# Stamps since 1970 are of this size in each unit; times from zero are told by their steps.
_SINCE_1970 = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"), (1e8, "s"))
_STEPS = ((1e5, "ns"), (1e2, "us"), (1.0, "ms"), (0.0, "s"))


class RecordingError(StickSlipError, ValueError):
    """A recording that cannot be found or read."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Samples of one joint; ``unit`` is that of position, "rad" or "m"."""

    name: str
    unit: str
    batch: Batch


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of samples.

    Attributes
    ----------
    name : of the file, without its ending. form : how it is written, in words.
    time : the columns whose sum it is. joints : of each joint the columns of its fields. unused : the other columns.
    batches : the samples of each joint, all of the same times.
    notes : what of the file is not used, or not known, a sentence each.
    """

    name: str
    form: str
    time: tuple[Column, ...]
    joints: dict[str, dict[str, Column]]
    unused: tuple[str, ...]
    batches: dict[str, Batch]
    notes: tuple[str, ...] = ()

    def unit(self, joint: str) -> str:
        """Of a joint's position: "rad" or "m"."""
        return "m" if self.joints[joint][POSITION].unit in TRANSLATION else "rad"


def find_recording(name_or_path: str) -> Path:
    """A file by its path, or by the beginning of its name in the package's examples or $STICKSLIP_RECORDINGS.

    Raises
    ------
    RecordingError
        If there is none, or more than one; the message lists those that are there.
    """
    path = Path(name_or_path)
    if path.suffix in SUFFIXES or episode_of(path) is not None or (path.exists() and not path.is_dir()):
        return path
    if is_data_set(path):
        raise RecordingError(f"recording {path}: {name_an_episode(path)}")
    folders = [config_folder().parent / "examples" / "recordings"]
    if environ.get(FOLDER_VARIABLE):
        folders.append(Path(environ[FOLDER_VARIABLE]))
    there = [file for folder in folders for file in sorted(folder.glob("*")) if file.suffix in SUFFIXES]
    found = [file for file in there if file.stem == name_or_path] or [
        file for file in there if file.stem.startswith(name_or_path)
    ]
    if len(found) == 1:
        return found[0]
    names = ", ".join(file.stem for file in (found or there)) or "none"
    problem = f"{len(found)} recordings begin with" if found else "no file has this path, and no recording begins with"
    raise RecordingError(
        f"{problem} {name_or_path!r}: {names} (searched: {', '.join(map(str, folders))}; "
        f"set {FOLDER_VARIABLE} to add a folder)"
    )


def convert_command(path: Path) -> str:
    """The command that makes a bag of a table, as it can be typed."""
    return f"stickslip convert {quote(str(path))} --out {quote(f'{path.stem}.mcap')}"


def load_table(path: Path, named: Sequence[Named] = (), limit: UnpackLimit | None = None) -> Table:
    """Read a table of samples, every joint of it, in SI units.

    Parameters
    ----------
    named : columns whose meaning is not to be told by their names. limit : of what is unpacked; none: the usual one.

    Raises
    ------
    RecordingError
        If the file cannot be read, has no time or position column, or a column or unit named is not there.
    StickSlipError
        If the package pyarrow is missing, which it needs.
    """
    try:
        opened = open_table if episode_of(path) is None else open_episode
        with optional_packages(f"recording {path}: reading it"), opened(path, limit or UnpackLimit()) as file:
            return _read(path, file, named)
    except (*_DAMAGE, OSError) as error:
        raise RecordingError(f"recording {path}: {_one_line(error)}") from error


def load_recording(path: Path, joint: str | None = None, limit: UnpackLimit | None = None) -> Recording:
    """Read one joint of a table.

    Parameters
    ----------
    joint : where there are several. limit : of what is unpacked; none: the usual one.

    Raises
    ------
    RecordingError
        As of :func:`load_table`; or if the table has several joints, and none of this name.
    """
    table = load_table(path, limit=limit)
    names = list(table.batches)
    if len(names) > 1 and joint not in names:
        problem = "several joints" if joint is None else f"no joint {joint!r}"
        problem += did_you_mean(nearest_joint(joint or "", names))
        raise RecordingError(
            f"recording {path}: has {problem}; there are {', '.join(names)}; all of them become a bag by "
            + convert_command(path)
        )
    chosen = names[0] if len(names) == 1 else str(joint)
    return Recording(name=table.name, unit=table.unit(chosen), batch=table.batches[chosen])


def _read(path: Path, file: TableFile, named: Sequence[Named]) -> Table:
    found = assign(file.names, named, file.days, file.clocks, file.named)
    columns = [*found.time, *(one for fields in found.joints.values() for one in fields.values())]
    values = file.read(list(dict.fromkeys(one.name for one in columns)))
    time = [
        replace(one, unit="s") if one.name in file.dates else _with_unit(one, values[one.name], {})
        for one in found.time
    ]
    stamps = np.sum([values[one.name] * UNITS[TIME][one.unit] for one in time], axis=0)
    stamps = np.where(np.abs(stamps) < LARGEST, stamps, math.nan)
    if not len(stamps):
        raise ValueError("it has no rows")
    notes = list(file.notes)
    if _newest_first(stamps):
        notes.append("its rows are newest first: they are read from the last one to the first")
        stamps, values = stamps[::-1], {name: column[::-1] for name, column in values.items()}
    joints: dict[str, dict[str, Column]] = {}
    batches: dict[str, Batch] = {}
    for label, columns_of in found.joints.items():
        name = file.joints.get(label.removeprefix("joint"), label or ONLY)
        place = _with_unit(columns_of[POSITION], values[columns_of[POSITION].name], file.units).unit
        uses = {field: _with_unit(one, values[one.name], file.units, place) for field, one in columns_of.items()}
        if name in joints:
            raise ValueError(f"two joints would have the name {name!r}: columns {joints[name][POSITION].name} and "
                             f"{uses[POSITION].name}; name the right one with --column")  # fmt: skip
        joints[name] = uses
        batches[name] = Batch(time=stamps, **{field: _in_si(one, values[one.name]) for field, one in uses.items()})
    return Table(
        name=path.stem,
        form=file.form,
        time=tuple(time),
        joints=joints,
        unused=found.unused,
        batches=batches,
        notes=tuple(notes),
    )


def _newest_first(stamps: FloatArray) -> bool:
    steps = np.diff(stamps[np.isfinite(stamps)])
    return len(steps) > 0 and float((steps < 0.0).mean()) > _MOSTLY


def _in_si(column: Column, values: FloatArray) -> FloatArray:
    factor = factor_of(column.field, column.unit)
    if math.isnan(factor):
        what = hint(column.field, {"": (column.name, column.unit)})
        raise ValueError(f"column {column.name!r} is in counts: say how many make a turn, as in {what}")
    return values * factor


def _with_unit(column: Column, values: FloatArray, units: Mapping[str, str], place: str = "rad") -> Column:
    """A column with the unit of its name, else the one that the file gives, else that of the joint's position, or the
    usual one.
    """
    known = column.unit or units.get(column.name, "")
    beside = USUAL_UNIT[column.field].replace("rad", place)
    return replace(column, unit=known or beside or _unit_of_time(values), assumed=not known)


def _unit_of_time(values: FloatArray) -> str:
    """The unit of stamps whose column does not say it."""
    known = values[np.isfinite(values)]
    if not len(known):
        return "s"
    latest = float(np.abs(known).max())
    for least, unit in _SINCE_1970:
        # Nanoseconds from zero are as many as milliseconds since 1970: their steps tell them.
        if latest >= least and float(np.abs(known).min()) > 0.5 * latest:
            return unit
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    return next(unit for least, unit in _STEPS if step >= least)


def _one_line(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "it says that it holds more than the memory does"
    return reason(error)
