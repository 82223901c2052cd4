# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How a table of text is written: which line has the names, what stands between values; told from its first lines."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from itertools import pairwise

_DELIMITERS = (";", "\t", ",", "|")
_COMMENTS = ("#", "%")
_LARGEST_CELL = 1_000_000  # characters
DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
DAY = re.compile(r"\d{4}-\d\d-\d\d")
CLOCK = re.compile(r"\d\d:\d\d(:\d\d(\.\d{1,9})?)?")
_LONGEST_PREAMBLE = 100  # lines
_ECHOED = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
_ECHOED_FIELDS = ("position", "velocity", "effort")


def header_of(lines: Sequence[bytes]) -> tuple[int, str]:
    """Which line has the names, counted from 0, and its text: the first one that is no comment, or a comment above
    numbers.

    Raises
    ------
    ValueError
        If there is none, or a line is no text in UTF-8.
    """
    comment = None
    for number, line in enumerate(lines):
        try:
            text = line.decode("utf-8-sig" if number == 0 else "utf-8").strip("\r\n")
        except UnicodeDecodeError as error:
            raise ValueError(f"line {number + 1}: must be text in UTF-8: {error.reason}") from error
        if not text.strip():
            continue
        if text.lstrip().startswith(_COMMENTS):
            comment = number, text.lstrip().lstrip("".join(_COMMENTS)).lstrip(" ")
            continue
        begins = re.split(r"[;,\t| ]+", text.strip())[0]
        return comment if comment is not None and is_number(begins) else (number, text)
    raise ValueError("the file is empty" if not lines else "it has no line that names the columns")


def below_a_preamble(lines: Sequence[bytes], first: int) -> tuple[int, str] | None:
    """The line of names, and its number, where others stand above it: as many names as there are values below, while
    the first line has another number of them. None if there are no such lines.
    """
    # The last line may be cut off.
    texts = {number: line.decode("utf-8", "replace").strip("\r\n") for number, line in enumerate(lines[:-1])}
    texts = {number: text for number, text in texts.items() if number >= first and text.strip()}
    numbers = list(texts)[: _LONGEST_PREAMBLE + 1]
    for delimiter in (*_DELIMITERS, " "):
        counts = {number: len(cells_of(texts[number], delimiter)) for number in numbers}
        if not numbers or counts[numbers[-1]] < 2 or counts[first] == counts[numbers[-1]]:
            continue
        for number, after in pairwise(numbers):
            values = cells_of(texts[after], delimiter)
            if counts[number] == counts[after] == counts[numbers[-1]] and _is_value(values[0]):
                names = cells_of(texts[number], delimiter)
                return None if any(map(_is_value, names)) else (number, texts[number])
    return None


def _is_value(cell: str) -> bool:
    return is_number(cell) or DATE.match(cell) is not None or bool(DAY.fullmatch(cell) or CLOCK.fullmatch(cell))


def columns_of_an_echo(cells: Sequence[str]) -> list[str]:
    """Names of the columns that `ros2 topic echo --csv` prints of a JointState, which has no line of names: stamp,
    frame, names, and as many positions, then velocities, then efforts; [] if it is none.
    """
    stamp, rest = cells[: len(_ECHOED)], cells[len(_ECHOED) :]
    count = next((number for number, cell in enumerate(rest) if is_number(cell)), 0)
    kinds, more = divmod(len(rest) - count, count) if count else (0, 0)
    numbers = [*stamp[:2], *rest[count:]]
    if not 1 <= kinds <= len(_ECHOED_FIELDS) or more or not all(map(is_number, numbers)) or is_number(stamp[2]):
        return []
    fields = ("name", *_ECHOED_FIELDS[:kinds])
    return [*_ECHOED, *(f"{field}[{number}]" for field in fields for number in range(count))]


def delimiter_of(header: str, rows: Sequence[str]) -> str:
    """What stands between values: what the names and the first rows have as often."""
    for delimiter in _DELIMITERS:
        count = len(cells_of(header, delimiter))
        if count > 1 and rows and len(cells_of(rows[0], delimiter)) == count:
            return delimiter
    most = max(_DELIMITERS, key=header.count)
    if header.count(most):
        return most
    return " " if " " in header.strip() else ","


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without the blanks around them.

    Raises
    ------
    ValueError
        If one is too long.
    """
    if delimiter == " ":
        return line.split()
    csv.field_size_limit(_LARGEST_CELL)
    try:
        return [cell.strip() for cell in next(csv.reader([line.strip("\r\n")], delimiter=delimiter), [])]
    except csv.Error as error:
        raise ValueError(str(error)) from error


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
