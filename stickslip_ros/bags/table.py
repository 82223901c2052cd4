# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recordings that are tables (.csv, .npz) with the unit in every column's name, as batches of samples."""

from __future__ import annotations

import csv
import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from os import environ
from pathlib import Path

import numpy as np

from stickslip_ros.bags.storage.unpacking import TooMuchUnpackedError, UnpackLimit
from stickslip_ros.errors import StickSlipError
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.regular_files import open_regular
from stickslip_ros.settings.known_joints import config_folder

# A column's name begins with what it is and ends with its unit; the first kind that is there serves.
COLUMNS: dict[str, tuple[str, ...]] = {
    "time": ("time", "stamp", "t"),
    "position": ("position", "q", "angle"),
    "velocity": ("velocity", "qd", "speed"),
    "effort": ("effort", "measured_torque", "friction_torque", "commanded_torque", "torque", "force"),
    "reference_position": ("reference", "reference_position", "desired_position"),
    "reference_velocity": ("reference_velocity", "desired_velocity"),
}
_ROTATION = {"rad": 1.0, "deg": math.pi / 180.0}
_TRANSLATION = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_EFFORT = {"nm": 1.0, "n": 1.0, "mnm": 1e-3}
_SPEED = {f"{unit}_per_s": factor for unit, factor in (_ROTATION | _TRANSLATION).items()} | {"rpm": math.pi / 30.0}
UNITS = {
    "time": _TIME,
    "position": _ROTATION | _TRANSLATION,
    "velocity": _SPEED,
    "effort": _EFFORT,
    "reference_position": _ROTATION | _TRANSLATION,
    "reference_velocity": _SPEED,
}
# What a damaged table makes its readers raise.
_DAMAGE = (ValueError, csv.Error, EOFError, KeyError, MemoryError, NotImplementedError, zipfile.BadZipFile, zlib.error)
FOLDER_VARIABLE = "STICKSLIP_RECORDINGS"


class RecordingError(StickSlipError, ValueError):
    """A recording that cannot be found or read."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Samples of one joint; ``unit`` is that of position, "rad" or "m"."""

    name: str
    unit: str
    batch: Batch


def find_recording(name_or_path: str) -> Path:
    """A file by its path, or by the beginning of its name in the package's examples or $STICKSLIP_RECORDINGS.

    Raises
    ------
    RecordingError
        If there is none, or more than one; the message lists those that are there.
    """
    path = Path(name_or_path)
    if path.suffix in (".csv", ".npz"):
        return path
    folders = [config_folder().parent / "examples" / "recordings"]
    if environ.get(FOLDER_VARIABLE):
        folders.append(Path(environ[FOLDER_VARIABLE]))
    there = [file for folder in folders for file in sorted(folder.glob("*")) if file.suffix in (".csv", ".npz")]
    found = [file for file in there if file.stem == name_or_path] or [
        file for file in there if file.stem.startswith(name_or_path)
    ]
    if len(found) == 1:
        return found[0]
    names = ", ".join(file.stem for file in (found or there)) or "none"
    problem = f"{len(found)} recordings begin with" if found else "no recording begins with"
    raise RecordingError(
        f"{problem} {name_or_path!r}: {names} (searched: {', '.join(map(str, folders))}; "
        f"set {FOLDER_VARIABLE} to add a folder)"
    )


def load_recording(
    path: Path, named: Mapping[str, tuple[str, str]] | None = None, limit: UnpackLimit | None = None
) -> Recording:
    """Read a table of samples of one joint, in SI units.

    Parameters
    ----------
    named : column and unit of a field, where they are not to be found by the column's name; "" for the unit that the
        name ends with.
    limit : of what is unpacked; none: the usual one.

    Raises
    ------
    RecordingError
        If the file cannot be read, has no time or position column, or a column or unit named is not there.
    """
    try:
        columns = _read_npz(path, limit or UnpackLimit()) if path.suffix == ".npz" else _read_csv(path)
    except (*_DAMAGE, OSError) as error:
        raise RecordingError(f"recording {path}: {_one_line(error)}") from error
    fields, translates = {}, False
    for field in COLUMNS:
        try:
            found = _find(field, columns, (named or {}).get(field))
        except ValueError as error:
            raise RecordingError(f"recording {path}: {error}") from error
        if found is not None:
            name, unit = found
            fields[field] = columns[name] * UNITS[field][unit]
            translates = translates or (field == "position" and unit in _TRANSLATION)
        elif field in ("time", "position"):
            names = " or ".join(f"{COLUMNS[field][0]}_{unit}" for unit in UNITS[field])
            raise RecordingError(
                f"recording {path}: needs a column {names}, or one named with --column; has {', '.join(columns)}"
            )
    return Recording(name=path.stem, unit="m" if translates else "rad", batch=Batch(**fields))


def _find(field: str, columns: Mapping[str, np.ndarray], named: tuple[str, str] | None) -> tuple[str, str] | None:
    """A field's column and its unit, None if there is none.

    Raises
    ------
    ValueError
        If a column named is not there, or its unit is none of the field's.
    """
    units = UNITS[field]
    if named is not None:
        name, unit = named
        if name not in columns:
            raise ValueError(f"no column {name!r} for {field}; has {', '.join(columns)}")
        unit = unit or next((one for one in sorted(units, key=len, reverse=True) if name.endswith(f"_{one}")), "")
        if unit not in units:
            raise ValueError(f"column {name!r} for {field} needs a unit of {', '.join(units)}, got {unit!r}")
        return name, unit
    for kind in COLUMNS[field]:
        for unit in units:
            if f"{kind}_{unit}" in columns:
                return f"{kind}_{unit}", unit
    return None


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    with open_regular(path) as raw, io.TextIOWrapper(raw, encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        header = next(reader, None)
        if header is None:
            raise ValueError("the file is empty")
        rows = [[float(value) if value else np.nan for value in row] for row in reader if row]
    if any(len(row) != len(header) for row in rows) or not rows:
        raise ValueError(f"every row must have the header's {len(header)} values")
    return dict(zip(header, np.array(rows).T, strict=True))


def _read_npz(path: Path, limit: UnpackLimit) -> dict[str, np.ndarray]:
    with open_regular(path) as file:
        # What the archive says of its members is what is unpacked of them at most.
        with zipfile.ZipFile(file) as members:
            largest = limit.of_table(path.stat().st_size)
            if sum(member.file_size for member in members.infolist()) > largest:
                raise TooMuchUnpackedError("it", largest)
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            columns = {name: np.atleast_1d(archive[name]).astype(float) for name in archive.files}
    if len({column.shape for column in columns.values()}) != 1 or any(one.ndim != 1 for one in columns.values()):
        raise ValueError("every column must be one row of as many numbers as the others")
    return columns


def _one_line(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "it says that it holds more than the memory does"
    return " ".join(str(error).split()) or type(error).__name__
