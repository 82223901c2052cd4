# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The demo's picture: position, velocity and damping reserve over time, with the cycles marked."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from stickslip_ros.cli.demo_log import DemoData
from stickslip_ros.files import whole_file
from stickslip_ros.output.plotting import BLUE, GREEN, GREY, RED
from stickslip_ros.output.published import RESERVE_FIELD

_MOST_POINTS = 6000
_LINE = 0.06  # of the panel's height
_MOST_RESERVE = 120.0  # [%]: what is beyond is drawn at the edge


def draw(data: DemoData, path: Path, *, title: str, marks: Sequence[tuple[float, str]] = (), unit: str) -> None:
    """Write the picture as the file's ending says (.png, .svg, .pdf).

    Parameters
    ----------
    marks : stamps of changes [s], and what was changed.
    unit : of position, "rad" or "m".
    """
    from matplotlib.figure import Figure

    states = np.array(data.states)
    states = states[np.argsort(states[:, 0], kind="stable")]
    states = states[:: max(1, len(states) // _MOST_POINTS)]
    start = states[0, 0]
    reserves = [
        (row["time"] - start, 100.0 * row[RESERVE_FIELD]) for row in data.margins if not np.isnan(row[RESERVE_FIELD])
    ]
    has_velocity = bool(np.isfinite(states[:, 2]).any())
    rows = 1 + has_velocity + bool(reserves)
    heights = [2.2] + [1.3] * has_velocity + [1.2] * bool(reserves)
    figure = Figure(figsize=(10, 2.3 + 2.1 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, height_ratios=heights, squeeze=False)
    panels = list(axes[:, 0])
    scale, prefix = (1e3, "m") if np.ptp(states[:, 1]) < 1.0 else (1.0, "")
    top = panels.pop(0)
    if data.references:
        references = np.array(data.references)
        references = references[:: max(1, len(references) // _MOST_POINTS)]
        top.plot(references[:, 0] - start, scale * references[:, 1], color=GREY, linewidth=1.2, label="reference")
    top.plot(states[:, 0] - start, scale * states[:, 1], color=BLUE, linewidth=1.6, label="measured position")
    for number, cycle in enumerate(data.cycles):
        begin, end = cycle["breakaway"] - start, cycle["arrest"] - start
        top.axvspan(
            begin, end, color=RED, alpha=0.12, linewidth=0, label="slip of a detected cycle" if number == 0 else None
        )
    top.set_ylabel(f"position [{prefix}{unit}]")
    top.legend(loc="upper left", frameon=False)
    top.set_title(title, loc="left")
    if has_velocity:
        panel = panels.pop(0)
        panel.plot(states[:, 0] - start, scale * states[:, 2], color=BLUE, linewidth=1.0)
        panel.set_ylabel(f"velocity [{prefix}{unit}/s]")
    if reserves:
        panel = panels.pop(0)
        times, values = np.array(reserves).T
        values = np.minimum(values, _MOST_RESERVE)
        panel.axhline(0.0, color=GREY, linewidth=0.8)
        for where, colour in ((values > 0, GREEN), (values <= 0, RED)):
            panel.fill_between(times, values, 0.0, where=where, color=colour, alpha=0.25, linewidth=0, step="post")
        panel.step(times, values, where="post", color=BLUE, linewidth=1.4)
        panel.set_ylim(-_MOST_RESERVE, _MOST_RESERVE)
        panel.set_ylabel("damping reserve [%]")
        at = 0.005 * (states[-1, 0] - start)
        # Beside the line at 0, of which they speak: a joint that sticks stays near the lower edge.
        panel.text(at, 5.0, "above 0: smooth", fontsize=8, color=GREEN)
        panel.text(at, -5.0, "below 0: stick-slip", va="top", fontsize=8, color=RED)
    for panel in axes[:, 0]:
        for changed, _ in marks:
            panel.axvline(changed - start, color="black", linestyle="--", linewidth=1.0)
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    for number, (changed, text) in enumerate(marks):
        # One below the other, as they may be close together.
        top.annotate(
            f" {text}", (changed - start, 0.03 + _LINE * (len(marks) - 1 - number)), xycoords=("data", "axes fraction"),
            fontsize=9,
        )  # fmt: skip
    axes[-1, 0].set_xlabel("time [s]")
    axes[-1, 0].set_xlim(0.0, states[-1, 0] - start)
    with whole_file(path) as image:
        figure.savefig(image, dpi=110, format=path.suffix[1:])
