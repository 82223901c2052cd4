# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages of times and tables."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from std_msgs.msg import Float64MultiArray, MultiArrayDimension


def stamp(time: float) -> Time:
    """Stamp of a time in seconds."""
    nanoseconds = round(time * 1e9)
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def table(rows: Sequence[str], columns: Sequence[str], values: Sequence[float]) -> Float64MultiArray:
    """Labelled table, row by row, in the layout of `pd_gains`."""
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label=",".join(rows), size=len(rows), stride=len(rows) * len(columns)),
        MultiArrayDimension(label=",".join(columns), size=len(columns), stride=len(columns)),
    ]
    message.data = array("d", values)
    return message
