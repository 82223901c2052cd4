# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""CSV tables whose cells are text or numbers to every spreadsheet, never a formula that it runs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from stickslip_ros.files import write_whole

# With which spreadsheets know a formula, the wide ones of East Asian keyboards among them, and blanks before it.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")
_AS_TEXT = "'"


def write_csv(path: Path, rows: Iterable[Sequence[Any]]) -> None:
    """Write rows of cells, whole or not at all; None is an empty one.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    text = io.StringIO(newline="")
    csv.writer(text).writerows([cell(value) for value in row] for row in rows)
    write_whole(path, text.getvalue().encode("utf-8", "backslashreplace"))


def cell(value: Any) -> Any:
    """A cell's content; of text that a spreadsheet would run, with an apostrophe before it."""
    return f"{_AS_TEXT}{value}" if isinstance(value, str) and _would_run(value) else value


def _would_run(text: str) -> bool:
    if not text.lstrip(" ").startswith(_FORMULA):
        return False
    try:
        float(text)
    except ValueError:
        return True
    # A negative number is no formula.
    return text.startswith(("\t", "\r", "\n"))
