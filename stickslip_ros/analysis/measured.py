# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A value with its standard error, and whether two of them differ by more than chance."""

from __future__ import annotations

import math
from dataclasses import dataclass

BEYOND_CHANCE = 1.96  # standard errors: 95 % of what chance makes


@dataclass(frozen=True)
class Measured:
    """A value with its standard error; NaN where it is not known. ``exact``: it was set, and has none."""

    value: float = math.nan
    error: float = math.nan
    exact: bool = False
