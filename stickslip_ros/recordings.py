# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recordings that are tables (.csv, .npz) with the unit in every column's name, as batches of samples."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from os import environ
from pathlib import Path

import numpy as np

from stickslip_ros.errors import StickSlipError
from stickslip_ros.known_joints import config_folder
from stickslip_ros.monitoring.samples import Batch

# The first column that is there serves; rotation and translation go through the same code.
COLUMNS: dict[str, tuple[str, ...]] = {
    "time": ("time_s",),
    "position": ("position_rad", "position_m"),
    "velocity": ("velocity_rad_per_s", "velocity_m_per_s"),
    "effort": ("effort_nm", "measured_torque_nm", "friction_torque_nm", "commanded_torque_nm", "effort_n"),
    "reference_position": ("reference_rad", "reference_m"),
    "reference_velocity": ("reference_velocity_rad_per_s", "reference_velocity_m_per_s"),
}
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


def load_recording(path: Path) -> Recording:
    """Read a table of samples of one joint.

    Raises
    ------
    RecordingError
        If the file cannot be read, or has no time or position column.
    """
    try:
        columns = _read_npz(path) if path.suffix == ".npz" else _read_csv(path)
    except (OSError, ValueError, csv.Error) as error:
        raise RecordingError(f"recording {path}: {error}") from error
    fields = {}
    for field, names in COLUMNS.items():
        present = [name for name in names if name in columns]
        if present:
            fields[field] = columns[present[0]]
        elif field in ("time", "position"):
            raise RecordingError(f"recording {path}: needs a column {' or '.join(names)}; has {', '.join(columns)}")
    unit = "rad" if COLUMNS["position"][0] in columns else "m"
    return Recording(name=path.stem, unit=unit, batch=Batch(**fields))


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.reader(file)
        header = next(reader, None)
        if header is None:
            raise ValueError("the file is empty")
        rows = [[float(value) if value else np.nan for value in row] for row in reader if row]
    if any(len(row) != len(header) for row in rows) or not rows:
        raise ValueError(f"every row must have the header's {len(header)} values")
    return dict(zip(header, np.array(rows).T, strict=True))


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name].astype(float) for name in archive.files}
