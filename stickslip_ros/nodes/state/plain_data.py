# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Content of the files that a node keeps: dataclasses as plain data, under a line with kind, version and checksum.

Reading is strict, because a file may have been changed by anybody.
"""

from __future__ import annotations

import dataclasses
import json
import types
import zlib
from collections.abc import Mapping
from enum import Enum
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from stickslip_ros.errors import StickSlipError

Kind = TypeVar("Kind")


def to_plain(value: Any) -> Any:
    """Plain data of a value made of dataclasses, arrays of numbers, enumerations, tuples, numbers and texts."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {_key(field): to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, (list, tuple)):
        return [to_plain(one) for one in value]
    return value


def from_plain(kind: type[Kind], data: Any) -> Kind:
    """Dataclass of plain data.

    Raises
    ------
    ValueError
        If the data do not fit the dataclass; the text names the field.
    """
    found: Kind = _read(kind, data, kind.__name__)
    return found


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _read(hint: Any, data: Any, where: str) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        if data is None and type(None) in get_args(hint):
            return None
        # Of several kinds of number, the first one fits all.
        return _read(next(one for one in get_args(hint) if one is not type(None)), data, where)
    if dataclasses.is_dataclass(hint):
        return _dataclass(hint, data, where)
    if get_origin(hint) is tuple:
        return _tuple(hint, data, where)
    if _is_array(hint):
        return _array(data, where)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint(data)
    if hint is float and isinstance(data, (int, float)) and not isinstance(data, bool):
        return float(data)
    if hint in (bool, int, str) and type(data) is hint:
        return data
    raise ValueError(f"{where} cannot be {data!r:.60}")


def _is_array(hint: Any) -> bool:
    """Whether a type is that of arrays; with numpy 2.5 and Python 3.12 `NDArray[…]` is an alias of it."""
    origin = get_origin(hint) or hint
    alias = getattr(origin, "__value__", origin)
    return (get_origin(alias) or alias) is np.ndarray


def _key(field: dataclasses.Field[Any]) -> str:
    """Key of a field in files: its name, or the name before the field was renamed."""
    return str(field.metadata.get("key", field.name))


def _dataclass(kind: Any, data: Any, where: str) -> Any:
    names = {_key(field): field.name for field in dataclasses.fields(kind)}
    # Fields with a default are newer than some files, which lack them.
    later = {_key(field) for field in dataclasses.fields(kind) if field.default is not dataclasses.MISSING}
    if not isinstance(data, Mapping) or not set(names) - later <= set(data) <= set(names):
        raise ValueError(f"{where} must have exactly {', '.join(sorted(names))}")
    return kind(**{names[key]: _read(_hints(kind)[names[key]], data[key], f"{where}.{key}") for key in data})


def _tuple(hint: Any, data: Any, where: str) -> Any:
    """Tuple of any length, of one kind of element."""
    if not isinstance(data, list):
        raise ValueError(f"{where} cannot be {data!r:.60}")
    kind = get_args(hint)[0]
    return tuple(_read(kind, one, f"{where}[{number}]") for number, one in enumerate(data))


def _array(data: Any, where: str) -> Any:
    try:
        array = np.array(data)
    except ValueError as error:
        raise ValueError(f"{where} is no array") from error
    if array.dtype.kind not in "if":
        raise ValueError(f"{where} is no array of numbers")
    return array


class NewerVersionError(StickSlipError):
    """A sound file of a version that a later release writes."""


def sealed(kind: str, version: int, body: str) -> bytes:
    """Content of a file: a line with kind, version and checksum, and the body."""
    encoded = body.encode()
    return json.dumps({"format": kind, "version": version, "crc32": zlib.crc32(encoded)}).encode() + b"\n" + encoded


def unsealed(content: bytes, kind: str, newest: int) -> tuple[int, bytes]:
    """Version and body of a file's content.

    Parameters
    ----------
    kind : format of the file, two words, the second for error messages. newest : newest version that can be read.

    Raises
    ------
    NewerVersionError
        If a later release wrote the file.
    ValueError
        If the file is of another kind, or damaged.
    """
    line, _, body = content.partition(b"\n")
    header = json.loads(line)
    if not isinstance(header, dict) or header.get("format") != kind:
        raise ValueError(f"it is no {kind.partition(' ')[2]} of a stickslip_monitor")
    version = header.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ValueError(f"it has version {version!r}, not {newest}")
    if version > newest:
        raise NewerVersionError(f"it has version {version}; this release reads versions up to {newest}")
    if header.get("crc32") != zlib.crc32(body):
        raise ValueError("its checksum is wrong")
    return version, body
