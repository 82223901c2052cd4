# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A history as a picture of a word's size, in SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence

_WIDTH, _HEIGHT, _EDGE = 84.0, 20.0, 3.0  # pixels
_LEAST_SPAN = 0.2  # of the largest value, that the height covers: what hardly changes is to look so
_MOST_POINTS = 60


def sparkline(at: Sequence[float], values: Sequence[float], *, low: float = math.nan, high: float = math.nan) -> str:
    """A line through values, with a dot at the last; "" where there are fewer than two.

    Parameters
    ----------
    at : where the values stand, of shape (n,). low, high : ends of the axis; NaN: those of the values.
    """
    if len(values) < 2:
        return ""
    step = math.ceil(len(values) / _MOST_POINTS)
    # Thinned from behind, so that the last is there.
    at, values = list(at)[::-1][::step][::-1], list(values)[::-1][::step][::-1]
    largest = max(abs(value) for value in values)
    bottom = min(values) if math.isnan(low) else low
    top = max(values) if math.isnan(high) else high
    room = 0.5 * max(0.0, _LEAST_SPAN * largest - (top - bottom))
    bottom, top = bottom - room, top + room
    across, along = (top - bottom) or 1.0, (at[-1] - at[0]) or 1.0
    points = [
        (
            _EDGE + (_WIDTH - 2.0 * _EDGE) * (x - at[0]) / along,
            _HEIGHT - _EDGE - (_HEIGHT - 2.0 * _EDGE) * (min(max(y, bottom), top) - bottom) / across,
        )
        for x, y in zip(at, values, strict=True)
    ]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[-1]
    return (
        f'<svg class="spark" width="{_WIDTH:.0f}" height="{_HEIGHT:.0f}" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" '
        f'aria-hidden="true"><polyline points="{line}"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.2"/></svg>'
    )
