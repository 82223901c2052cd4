# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Options that many commands have, in one form."""

from __future__ import annotations

import math
from typing import Any


def add_number(group: Any, name: str, metavar: str, text: str, default: float | None = None) -> None:
    """Add an option that takes a number; its help ends with the default, where that is a finite number."""
    shown = "" if default is None or not math.isfinite(default) else f" (default: {default:g})"
    group.add_argument(name, type=float, metavar=metavar, default=default, help=f"{text}{shown}")


def add_flag(group: Any, name: str, text: str) -> None:
    """Add an option without a value."""
    group.add_argument(name, action="store_true", help=text)


def add_json(group: Any) -> None:
    """Add ``--json``."""
    add_flag(group, "--json", "print one JSON object and nothing else")
