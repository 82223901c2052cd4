# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Figures as data: panels of curves, written as PNG, SVG and the numbers as CSV."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.files import whole_file
from stickslip_ros.output.csv_table import write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

BLUE, RED, GREEN, ORANGE, PURPLE, GREY = "#1f5fa8", "#c0392b", "#2e8b57", "#d9822b", "#7d4fa3", "#777777"
COLOURS = (BLUE, RED, GREEN, ORANGE, PURPLE, GREY)
_DOTS = 130  # an inch
_SHADE = 0.22  # opacity of a region, 1: the lightest colour still differs from white paper
_MOST_ABREAST = 2  # panels: three are wider than a page
_MOST_DECADES = 4.0  # of an axis whose labels at 1, 2 and 5 have room


@dataclass(frozen=True, kw_only=True)
class Curve:
    """One curve; NaN where it is interrupted. ``style`` is a line style, or a marker such as "o"."""

    label: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    colour: str = BLUE
    style: str = "-"


@dataclass(frozen=True, kw_only=True)
class Region:
    """A shaded part of the plane: where ``inside`` on the grid of x and y is positive."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    inside: NDArray[np.float64]
    colour: str


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Axes with curves.

    Attributes
    ----------
    legend : a place of matplotlib's, or "below" for under the axes.
    right : label of a second scale on the right, and the factor from the left one's values to its own.
    """

    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    regions: tuple[Region, ...] = ()
    title: str = ""
    logarithmic: bool = False
    equal: bool = False
    legend: str = "best"
    right: tuple[str, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Panels, two side by side, under a title and a note."""

    name: str
    title: str
    note: str
    panels: tuple[Panel, ...]


def boundary(
    label: str, x: NDArray[np.float64], y: NDArray[np.float64], values: NDArray[np.float64], colour: str, style: str
) -> Curve:
    """The curve on which values, of shape (len(y), len(x)), change sign."""
    from contourpy import contour_generator

    lines = contour_generator(x, y, np.ma.masked_invalid(values)).lines(0.0)
    parts = [part for line in lines for part in (np.asarray(line), np.full((1, 2), np.nan))]
    points = np.concatenate(parts[:-1]) if parts else np.full((1, 2), np.nan)
    return Curve(label=label, x=points[:, 0], y=points[:, 1], colour=colour, style=style)


def save(figure: Figure, folder: Path) -> list[Path]:
    """Write the figure and its numbers; returns the files."""
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    drawing = _drawn(figure)
    files = [folder / f"{figure.name}.{ending}" for ending in ("png", "svg", "csv")]
    # A fixed salt and no date: the same numbers give the same file.
    with matplotlib.rc_context({"svg.hashsalt": figure.name}):
        with whole_file(files[0]) as image:
            drawing.savefig(image, dpi=_DOTS, format="png")
        with whole_file(files[1]) as image:
            drawing.savefig(image, metadata={"Date": None}, format="svg")
    write_csv(files[2], _rows(figure))
    return files


def png(figure: Figure) -> bytes:
    """The figure as a PNG image."""
    image = io.BytesIO()
    _drawn(figure).savefig(image, dpi=_DOTS, format="png")
    return image.getvalue()


def _drawn(figure: Figure) -> Drawing:
    # Not by pyplot, which keeps every figure until it is closed.
    from matplotlib.figure import Figure as NewDrawing

    columns = min(len(figure.panels), _MOST_ABREAST)
    lines = math.ceil(len(figure.panels) / columns)
    width, height = 7.5 if columns == 1 else 5.6 * columns, 5.6 if lines == 1 else 4.6 * lines
    drawing = NewDrawing(figsize=(width, height), layout="constrained")
    for number, panel in enumerate(figure.panels, start=1):
        _draw(panel, drawing.add_subplot(lines, columns, number))
    drawing.suptitle(figure.title, x=0.01, ha="left", fontsize=12)
    drawing.supxlabel(figure.note, x=0.01, ha="left", fontsize=8, color=GREY)
    return drawing


def _draw(panel: Panel, axis: Axes) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    for region in panel.regions:
        axis.contourf(
            region.x, region.y, np.ma.masked_invalid(region.inside), levels=[0.0, np.inf], colors=[region.colour],
            alpha=_SHADE,
        )  # fmt: skip
    for curve in panel.curves:
        if curve.style in ("o", "s", "*"):
            axis.plot(
                curve.x, curve.y, curve.style, color=curve.colour, markersize=15 if curve.style == "*" else 9,
                markeredgecolor="white", label=curve.label,
            )  # fmt: skip
        else:
            axis.plot(curve.x, curve.y, curve.style, color=curve.colour, linewidth=1.6, label=curve.label or None)
    axis.spines[["top", "right"]].set_visible(False)
    if panel.logarithmic:
        axis.set_xscale("log")
        axis.set_yscale("log")
    scales = [(axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())]
    if panel.right is not None:
        label, factor = panel.right
        scale = (lambda left: np.multiply(left, factor), lambda right: np.divide(right, factor))
        second = axis.secondary_yaxis("right", functions=scale)
        second.set_ylabel(label)
        scales.append((second.yaxis, axis.get_ylim()))
    if panel.logarithmic:
        for ticks, (low, high) in scales:
            few = math.log10(high / low) <= _MOST_DECADES
            ticks.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
            ticks.set_major_formatter("{x:g}")
            ticks.set_minor_formatter(NullFormatter())
    if panel.equal:
        axis.set_aspect("equal")
    axis.set_xlabel(panel.x_label)
    axis.set_ylabel(panel.y_label)
    axis.set_title(panel.title, fontsize=10)
    axis.grid(alpha=0.25)
    if sum(bool(curve.label) for curve in panel.curves) > 1:
        if panel.legend == "below":
            axis.legend(frameon=False, fontsize=8.5, loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=2)
        else:
            axis.legend(frameon=False, fontsize=8.5, loc=panel.legend)


def _rows(figure: Figure) -> Iterable[list[object]]:
    yield ["panel", "curve", "x", "y", "x_label", "y_label"]
    for number, panel in enumerate(figure.panels, start=1):
        for curve in panel.curves:
            for x, y in zip(curve.x, curve.y, strict=True):
                yield [number, curve.label, f"{x:.9g}", f"{y:.9g}", panel.x_label, panel.y_label]
