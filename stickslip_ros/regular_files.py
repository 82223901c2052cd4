# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files to read that others named: regular ones alone, whole ones up to a size, YAML that ends.

A FIFO would keep who opens it waiting, a device such as /dev/zero has no end, and a few lines of YAML whose aliases
stand for each other mean more than any memory holds.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import IO, Any

import yaml

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
LARGEST_TEXT = 4_000_000  # bytes; parsing so much YAML takes half a minute
_MOST_NODES = 200_000  # of YAML, aliases counted as what they stand for


def open_regular(path: Path) -> IO[bytes]:
    """Open a file to read, if it is a regular one.

    Raises
    ------
    OSError
        If it cannot be opened, or is a folder, a FIFO, a socket or a device; the text says what it is.
    """
    # Opening a FIFO without a writer waits for one, unless it is asked not to.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    kind = stat.S_IFMT(os.fstat(handle).st_mode)
    if kind != stat.S_IFREG:
        os.close(handle)
        raise OSError(f"must be a regular file: it is {_KINDS.get(kind, 'none')}")
    return os.fdopen(handle, "rb")


def read_regular(path: Path, largest: int) -> bytes:
    """The content of a regular file of at most so many bytes.

    Raises
    ------
    OSError
        If it is none, or larger.
    """
    with open_regular(path) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise OSError(f"must have at most {largest} bytes: it has more")
    return content


def read_yaml(path: Path, *, unique: bool = False) -> Any:
    """The content of a YAML file.

    Parameters
    ----------
    unique : whether a key that stands twice in one place is refused; else the last one counts.

    Raises
    ------
    OSError
        If it cannot be read, is no regular file, or has more than 4 MB.
    ValueError
        If it is no YAML, or means more than can be held.
    """
    return parsed_yaml(read_regular(path, LARGEST_TEXT).decode("utf-8"), unique=unique)


def parsed_yaml(text: str, *, unique: bool = False) -> Any:
    """What a YAML text means; ``unique`` as of :func:`read_yaml`.

    Raises
    ------
    ValueError
        If it is no YAML, has a key twice where that is refused, is nested too deeply, or has too many nodes, each
        alias counted as what it stands for.
    """
    try:
        # The loader in C is ten times faster, but deep nesting ends the process.
        loader = yaml.SafeLoader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            if _count(node, {}) > _MOST_NODES:
                raise ValueError(f"must have at most {_MOST_NODES} nodes, aliases counted as what they stand for")
            if unique:
                _refuse_repeated_keys(node, set())
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except RecursionError as error:
        raise ValueError("must be nested less deeply, and hold no alias of what it is part of") from error
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error


def _count(node: yaml.Node, known: dict[int, int]) -> int:
    """How many nodes a node stands for; what it is an alias of within itself recurs until Python ends it."""
    if id(node) in known:
        return known[id(node)]
    parts: list[Any] = []
    if isinstance(node, yaml.SequenceNode):
        parts = node.value
    elif isinstance(node, yaml.MappingNode):
        parts = [one for pair in node.value for one in pair]
    found = 1 + sum(_count(part, known) for part in parts)
    known[id(node)] = found
    return found


def _refuse_repeated_keys(node: yaml.Node, seen: set[int]) -> None:
    """Raise ValueError for a key that stands twice in a mapping at or below a node."""
    if id(node) in seen or isinstance(node, yaml.ScalarNode):
        return
    seen.add(id(node))
    lines: dict[str, int] = {}
    for part in node.value:
        key, value = part if isinstance(node, yaml.MappingNode) else (None, part)
        if isinstance(key, yaml.ScalarNode):
            line = key.start_mark.line + 1
            if key.value in lines and key.value != "<<":
                raise ValueError(f"must have {key.value!r} once: it is in line {lines[key.value]} and in line {line}")
            lines[key.value] = line
        _refuse_repeated_keys(value, seen)
