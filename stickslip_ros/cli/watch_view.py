# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip watch` shows: one line a joint, and in words what is the matter with those that are not well."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.diagnosis import Level

_BARS = " ▁▂▃▄▅▆▇█"
_LEAST_WIDTH, _MOST_WIDTH = 12, 60  # of a sparkline
_OTHER_COLUMNS, _LONGEST_NAME = 57, 28
_STYLES = {Level.OK: "green", Level.WARN: "yellow", Level.ERROR: "bold red", Level.STALE: "dim"}
_MARKS = {Level.OK: "●", Level.WARN: "▲", Level.ERROR: "■", Level.STALE: "○"}
_WORST_FIRST = (Level.ERROR, Level.WARN, Level.STALE, Level.OK)
_FRAME = 7  # lines of the view that are no joint's
_OUTCOMES = {"steady": "green", "swings": "yellow", "sticks": "red"}


@dataclass(frozen=True, kw_only=True)
class JointView:
    """What is shown of a joint.

    Attributes
    ----------
    message : a summary for a person. velocity : commanded [rad/s]. slip : the last one's distance [rad].
    outcome : what becomes of it by integration: sticks, swings or steady; "" if unknown.
    reserve : relative damping reserve ρ/ρ_c − 1 by integration [1]; NaN if unknown.
    history : times [s] and positions [rad] of late, of shape (n, 2).
    """

    name: str
    level: Level
    status: str
    message: str
    velocity: float
    outcome: str
    reserve: float
    cycles: int
    slip: float
    history: FloatArray


def sparkline(history: FloatArray, duration: float, width: int, *, commanded: float = 0.0) -> str:
    """The speed over the last seconds, each character the mean over its share; blank where nothing is known.

    Parameters
    ----------
    history : times [s] and positions [rad], of shape (n, 2).
    commanded : speed [rad/s], which is at half height at most: even motion then looks like no peak.
    """
    if len(history) < 2:
        return " " * width
    edges = history[-1, 0] + np.linspace(-duration, 0.0, width + 1)
    places = np.interp(edges, history[:, 0], history[:, 1], left=math.nan)
    speeds = np.abs(np.diff(places)) / (duration / width)
    largest = max(np.nanmax(speeds, initial=0.0), 2.0 * commanded)
    heights = np.zeros(width, dtype=int) if largest == 0 else np.nan_to_num(np.ceil(speeds / largest * 7)).astype(int)
    return "".join(
        " " if math.isnan(speed) else _BARS[1 + height] for speed, height in zip(speeds, heights, strict=True)
    )


def view(
    joints: Sequence[JointView], header: str, *, duration: float, width: int, height: int | None = None
) -> RenderableType:
    """The view, worst joints first, for a terminal of so many columns and lines; without lines, the whole of it."""
    ordered = sorted(joints, key=lambda joint: (_WORST_FIRST.index(joint.level), joint.name))
    matters = [joint for joint in ordered if joint.level is not Level.OK]
    if height is not None:
        room = max(6, height - _FRAME)
        matters = matters[: max(1, min(len(matters), room // 3), room - len(ordered))]
        ordered = ordered[: room - len(matters)]
    name_width = min(_LONGEST_NAME, max((len(joint.name) for joint in joints), default=0))
    line = min(_MOST_WIDTH, max(_LEAST_WIDTH, width - _OTHER_COLUMNS - name_width))
    table = Table(box=None, pad_edge=False, header_style="dim", collapse_padding=True)
    table.add_column("joint", no_wrap=True, max_width=_LONGEST_NAME)
    table.add_column("status", no_wrap=True)
    table.add_column(f"speed,\nlast {duration:g} s", no_wrap=True, min_width=line)
    table.add_column("told\n\\[rad/s]", justify="right", no_wrap=True)
    table.add_column("by\nphysics", no_wrap=True)
    table.add_column("reserve\n\\[%]", justify="right", no_wrap=True)
    table.add_column("cycles\n\\[1]", justify="right", no_wrap=True)
    table.add_column("slip\n\\[rad]", justify="right", no_wrap=True)
    for joint in ordered:
        style = _STYLES[joint.level]
        speeds = sparkline(joint.history, duration, line, commanded=_known(abs(joint.velocity)))
        table.add_row(
            Text(joint.name),
            Text(f"{_MARKS[joint.level]} {joint.status}", style=style),
            Text(speeds, style="red" if joint.level is Level.ERROR else "cyan"),
            _number(joint.velocity),
            Text(joint.outcome or "-", style=_OUTCOMES.get(joint.outcome, "")),
            _reserve(joint.reserve),
            str(joint.cycles),
            _number(joint.slip),
        )
    parts: list[RenderableType] = [Text(header, style="bold"), Text(), table]
    if len(ordered) < len(joints):
        parts.append(Text(f"… and {len(joints) - len(ordered)} more", style="dim"))
    parts.append(Text())
    for joint in matters:
        words = Text(no_wrap=height is not None, overflow="ellipsis")
        words.append(f"{joint.name}: ", style=_STYLES[joint.level])
        parts.append(words.append(joint.message))
    return Group(*parts)


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _reserve(value: float) -> Text:
    """Whether there is more damping than ends stick slip, in per cent."""
    if math.isnan(value):
        return Text("-")
    text = f"{100 * value:+.0f}" if value < 10 else "> 1000"
    return Text(text, style="green" if value > 0 else "red")
