# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""LeRobot data sets (versions 2 and 3): a folder with meta/info.json and data/chunk-*/*.parquet.

Each episode is a recording of its own, named FOLDER/episode_000012 whether a file holds one (version 2) or many
(version 3). Its columns are `observation.state.<joint>`, positions; `action.<joint>`, references of the joints of the
same names; `observation.velocity.<joint>` and `observation.effort.<joint>`, where they are there.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np

from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table_columns import POSITION, Named, factor_of, spelled_unit
from stickslip_ros.bags.table_files import ParquetFile
from stickslip_ros.errors import optional_packages
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.regular_files import open_regular, read_regular

_INFO = Path("meta") / "info.json"
_LARGEST_INFO = 4_000_000  # bytes
_MOST_EPISODES = 100_000
_FILES_KNOWN = 1024  # whose episodes are not read again for each of them
_EPISODE = re.compile(r"episode_(\d{1,9})")
_INDEX = "episode_index"
_STATE, _ACTION = "observation.state", "action"
_FIELDS = {_STATE: POSITION, _ACTION: "reference_position", "observation.velocity": "velocity",
           "observation.effort": "effort"}  # fmt: skip
_OF_A_MOTOR = ".pos"  # what LeRobot puts behind a motor's name


def is_data_set(folder: Path) -> bool:
    """Whether a folder is a data set."""
    return (folder / _INFO).is_file()


def name_an_episode(folder: Path) -> str:
    """Why a data set is no recording, and what is: for errors.

    Raises
    ------
    OSError
        If a file of it cannot be read.
    """
    first = next(iter(episodes(folder)), None)
    return "is a LeRobot data set" + (f"; name one of its episodes, as in {first}" if first else " without episodes")


def episode_of(path: Path) -> tuple[Path, int] | None:
    """The data set and the number of an episode, of a path that names one; else None."""
    found = _EPISODE.fullmatch(path.name)
    return (path.parent, int(found[1])) if found is not None and is_data_set(path.parent) else None


def episodes(folder: Path) -> list[Path]:
    """The paths of all episodes of a data set, in their order, and after them the files that are damaged.

    Raises
    ------
    OSError
        If a folder or file of it cannot be read.
    StickSlipError
        If the package pyarrow is missing, and files do not name their episodes.
    """
    numbers: set[int] = set()
    damaged = []
    with optional_packages(f"data set {folder}: reading it"):
        for file in _data_files(folder):
            there = _numbers_in(file)
            numbers |= there
            damaged += [] if there else [file]
    return [*(folder / f"episode_{number:06d}" for number in sorted(numbers)[:_MOST_EPISODES]), *damaged]


def files_of_episode(path: Path) -> list[Path]:
    """The files that an episode is read from: that of its rows, and the description of the data set.

    Raises
    ------
    ValueError
        If there is no such episode.
    """
    episode = episode_of(path)
    assert episode is not None
    folder, number = episode
    for file in _data_files(folder):
        if number in _numbers_in(file):
            return [file, folder / _INFO]
    raise ValueError(f"the data set {folder} has no episode {number}")


@contextmanager
def open_episode(path: Path, limit: UnpackLimit) -> Iterator[EpisodeFile]:
    """Open an episode as a table.

    Raises
    ------
    OSError
        If a file of it cannot be opened.
    ValueError
        If there is no such episode, or its files are damaged or unpack to more than they may.
    ImportError
        If the package pyarrow is missing.
    """
    file, info = files_of_episode(path)
    number = int(path.name.removeprefix("episode_"))
    with open_regular(file) as stream:
        yield EpisodeFile(stream, limit.of_table(file.stat().st_size), number, _features(info))


class EpisodeFile(ParquetFile):
    """The rows of one episode; a :class:`~stickslip_ros.bags.table_files.TableFile`.

    Attributes
    ----------
    notes : what of the data set is not used, or not known, a sentence each.
    """

    def __init__(self, file: IO[bytes], largest: int, number: int, features: Mapping[str, Mapping[str, Any]]) -> None:
        super().__init__(file, largest)
        self._number, self._indexed = number, _INDEX in self.names
        self.form = "an episode of a LeRobot data set"
        self._column_of: dict[str, str] = {}
        lists = {key: [name for name in self.names if name.startswith(f"{key}[")] for key in _FIELDS}
        joints = {key: _joints(features.get(key, {}), len(there)) for key, there in lists.items()}
        if joints[_STATE] is None and lists[_ACTION]:
            self.notes = (*self.notes, f"meta/info.json does not name the values of {_STATE}: {_ACTION} is not used")
        elif lists[_ACTION] and not set(joints[_ACTION] or ()) & set(joints[_STATE] or ()):
            self.notes = (*self.notes, f"no value of {_ACTION} has the name of one of {_STATE}: it is not used")
        named: list[Named] = []
        for key, field in _FIELDS.items():
            names = joints[key] or ([f"joint{number}" for number in range(len(lists[key]))] if key == _STATE else [])
            if key != _STATE and not set(names) & set(joints[_STATE] or ()):
                continue
            self._column_of |= dict(zip([f"{key}.{name}" for name in names], lists[key], strict=True))
            named += [Named(field=field, column=f"{key}.*")] if names else []
            self._note_units(key, field, features.get(key, {}), names)
        taken = {name for some in lists.values() for name in some}
        self.names = (*(name for name in self.names if name not in taken), *self._column_of)
        self.named = tuple(named)

    def _note_units(self, key: str, field: str, feature: Mapping[str, Any], names: Sequence[str]) -> None:
        declared = feature.get("units", feature.get("unit"))
        units = declared if isinstance(declared, list) else [declared] * len(names)
        known = {
            f"{key}.{name}": unit
            for name, text in zip(names, units, strict=False)
            if _is_known(field, unit := spelled_unit(str(text)))
        }
        self.units = {**self.units, **known}
        if field == POSITION and len(known) < len(names):
            declared_text = "no unit" if declared is None else f"the unit {declared!r}, which is unknown"
            self.notes = (*self.notes, f"meta/info.json gives {key} {declared_text}: read as rad")

    def read(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """See :class:`~stickslip_ros.bags.table_files.TableFile`."""
        columns = {name: self._column_of.get(name, name) for name in names}
        wanted = dict.fromkeys(columns.values())
        if self._indexed:
            self.choose_groups(_INDEX, self._number)
            wanted[_INDEX] = None
        found = super().read(list(wanted))
        # A file of one episode need not say which.
        mine = found[_INDEX] == self._number if self._indexed else slice(None)
        return {name: found[column][mine] for name, column in columns.items()}


def _is_known(field: str, unit: str) -> bool:
    try:
        # Of counts it takes the number that makes a turn, as in counts/4096.
        return not math.isnan(factor_of(field, unit))
    except ValueError:
        return False


def _joints(feature: Mapping[str, Any], count: int) -> list[str] | None:
    """Names of a feature's values; None if it has none, or others than one a value."""
    names: list[Any] = [feature.get("names")]
    # They may lie in dicts or lists of one, as in {"motors": [...]} and [[...]].
    while len(names) == 1 and isinstance(names[0], dict | list):
        names = list(names[0].values()) if isinstance(names[0], dict) else names[0]
    if not all(isinstance(name, str) and name for name in names):
        return None
    joints = [name.removesuffix(_OF_A_MOTOR) for name in names]
    return joints if count and len(joints) == count == len(set(joints)) else None


def _features(info: Path) -> dict[str, dict[str, Any]]:
    """What info.json says of columns.

    Raises
    ------
    ValueError
        If it cannot be read.
    """
    try:
        known = json.loads(read_regular(info, _LARGEST_INFO))
        features = known.get("features", {})
        return {str(key): one for key, one in features.items() if isinstance(one, dict)}
    except (ValueError, AttributeError, RecursionError) as error:
        raise ValueError(f"{_INFO} is damaged: {error}") from error


def _data_files(folder: Path) -> list[Path]:
    return sorted((folder / "data").glob("chunk-*/*.parquet"))


def _numbers_in(file: Path) -> frozenset[int]:
    """The episodes that a file holds: the one of its name, else those of its rows; none if it is damaged."""
    found = _EPISODE.fullmatch(file.stem)
    if found is not None:
        return frozenset([int(found[1])])
    state = file.stat()
    return _numbers_as_of(file, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=_FILES_KNOWN)
def _numbers_as_of(file: Path, modified: int, size: int) -> frozenset[int]:
    """The episodes of a file's rows, as it was modified at a time [ns], with a size [bytes]."""
    try:
        with open_regular(file) as stream:
            table = ParquetFile(stream, UnpackLimit().of_table(size))
            return frozenset(int(one) for one in np.unique(table.read([_INDEX])[_INDEX]) if 0 <= one < 1e9)
    except (ValueError, KeyError):
        return frozenset()
