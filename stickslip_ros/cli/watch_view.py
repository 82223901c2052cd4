# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What `stickslip watch` shows: one line a joint, and in words what is the matter with those that are not well."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from stickslip_ros.cli.terminal import fitting, number_text, width_of
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.diagnosis import Level

_BARS = " ▁▂▃▄▅▆▇█"
_LEAST_WIDTH, _MOST_WIDTH = 12, 60  # of a sparkline
_LONGEST_NAME = 28
_INDENT = 2  # columns before the lines of a message
_STYLES = {Level.OK: "green", Level.WARN: "yellow", Level.ERROR: "bold red", Level.STALE: "dim"}
MARKS = {Level.OK: "●", Level.WARN: "▲", Level.ERROR: "■", Level.STALE: "○"}
_WORST_FIRST = (Level.ERROR, Level.WARN, Level.STALE, Level.OK)
_FRAME = 7  # lines of the view that are no joint's
_STATUS, _SPEED, _OUTCOME, _RESERVE = "status", "speed", "model\npredicts", "reserve\n[%]"
_COMMANDED, _CYCLES, _SLIP = "commanded\n[rad/s]", "cycles\n[1]", "slip\n[rad]"
_HEADINGS = ("joint", _STATUS, _SPEED, _COMMANDED, _OUTCOME, _RESERVE, _CYCLES, _SLIP)
_NUMBERS = (_COMMANDED, _RESERVE, _CYCLES, _SLIP)
# The headings that a narrow terminal has no room for, the first one first.
_SPARED = (_SLIP, _COMMANDED, _CYCLES, _OUTCOME, _SPEED, _RESERVE)
_OUTCOMES = {"steady": "green", "swings": "yellow", "sticks": "red"}


@dataclass(frozen=True, kw_only=True)
class JointView:
    """What is shown of a joint.

    Attributes
    ----------
    message : a summary for a person. velocity : commanded [rad/s]. slip : the last one's distance [rad].
    outcome : what becomes of it by integration: sticks, swings or steady; "" if unknown.
    reserve : relative damping reserve ρ/ρ_c − 1 by integration [1]; NaN if unknown.
    history : times [s] and positions [rad] of late, of shape (n, 2). values : its last diagnostics, by key.
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
    values: Mapping[str, str] = field(default_factory=dict)


def worst_first(joints: Iterable[JointView]) -> list[JointView]:
    """The joints in the order in which they are shown."""
    return sorted(joints, key=lambda joint: (_WORST_FIRST.index(joint.level), joint.name))


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
    joints: Sequence[JointView], header: str, console: Console, *, duration: float, height: int | None = None
) -> RenderableType:
    """The view as wide as the console, worst joints first; with a height [lines] what fits in, else all of it."""
    ordered = worst_first(joints)
    messages = [_message(joint, console) for joint in ordered if joint.level is not Level.OK]
    if height is not None:
        room = max(6, height - _FRAME)
        lines = list(accumulate(map(len, messages)))
        most = max(room // 3, room - len(ordered))
        fit = sum(line <= most for line in lines) or min(1, len(messages))
        messages = messages[:fit]
        ordered = ordered[: max(1, room - sum(map(len, messages)))]

    def table(headings: Sequence[str], line: int = _LEAST_WIDTH) -> Table:
        made = Table(box=None, pad_edge=False, header_style="dim", collapse_padding=True)
        for heading in headings:
            made.add_column(
                f"speed,\nlast {duration:g} s" if heading is _SPEED else escape(heading),
                justify="right" if heading in _NUMBERS else "left", no_wrap=True,
                max_width=_LONGEST_NAME if heading == "joint" else None,
            )  # fmt: skip
        for joint in ordered:
            cells = _cells(joint, duration, line)
            made.add_row(*[cells[heading] for heading in headings])
        return made

    kept = fitting(console, _HEADINGS, _SPARED, table)
    left = console.width - width_of(console, table(kept))
    parts: list[RenderableType] = [Text(header, style="bold"), Text()]
    parts.append(table(kept, max(_LEAST_WIDTH, min(_MOST_WIDTH, _LEAST_WIDTH + left))))
    if len(ordered) < len(joints):
        parts.append(Text(f"… and {len(joints) - len(ordered)} more", style="dim"))
    parts.append(Text())
    return Group(*parts, *(line for message in messages for line in message))


def _cells(joint: JointView, duration: float, line: int) -> dict[str, RenderableType]:
    """A joint's cells by heading; its speeds are so many columns wide."""
    speeds = sparkline(joint.history, duration, line, commanded=_known(abs(joint.velocity)))
    return {
        "joint": Text(joint.name),
        _STATUS: Text(f"{MARKS[joint.level]} {joint.status}", style=_STYLES[joint.level]),
        _SPEED: Text(speeds, style="red" if joint.level is Level.ERROR else "cyan"),
        _COMMANDED: number_text(joint.velocity),
        _OUTCOME: Text(joint.outcome or "-", style=_OUTCOMES.get(joint.outcome, "")),
        _RESERVE: _reserve(joint.reserve),
        _CYCLES: str(joint.cycles),
        _SLIP: number_text(joint.slip),
    }


def _message(joint: JointView, console: Console) -> list[Text]:
    """What is the matter with a joint: in one line where there is room, else under its name, wrapped between words."""
    words = Text.assemble((f"{joint.name}: ", _STYLES[joint.level]), joint.message)
    if words.cell_len <= console.width:
        return [words]
    lines = Text(joint.message).wrap(console, console.width - _INDENT)
    for line in lines:
        line.rstrip()
        line.pad_left(_INDENT)
    return [Text(f"{joint.name}:", style=_STYLES[joint.level]), *lines]


def _known(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _reserve(value: float) -> Text:
    """Whether there is more damping than ends stick-slip, in per cent."""
    if math.isnan(value):
        return Text("-")
    text = f"{100 * value:+.0f}" if value < 10 else "> 1000"
    return Text(text, style="green" if value > 0 else "red")
