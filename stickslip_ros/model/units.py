# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Units: every field has its own in its metadata, and nothing else says it again."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

_ASCII = str.maketrans({"·": "*", "²": "^2"})


def unit_of(owner: type[Any], name: str) -> str:
    """The unit of a field of a dataclass, for people: "N·m/rad" of `Gains.stiffness`."""
    return next(str(entry.metadata["unit"]) for entry in fields(owner) if entry.name == name)


def in_ascii(unit: str) -> str:
    """The unit as keys of diagnostics and descriptions of parameters have it: "N*m/rad"."""
    return unit.translate(_ASCII)
