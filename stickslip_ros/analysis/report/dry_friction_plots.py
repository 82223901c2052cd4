# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The report's plots of what the dry friction depends on: position and time, slip by slip."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, Range1d, Whisker

from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.report.page import Plot
from stickslip_ros.analysis.report.plots import BLUE, GREEN, ORANGE, finish, new_figure
from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.samples import FloatArray

_LEAST_SLIPS = 8
_LEAST_SPAN = 0.1  # of the largest value, that an axis covers
_PER_PERIOD, _MOST_POINTS = 24, 3000  # of a curve
_WAYS = ((1, BLUE, "forward"), (-1, ORANGE, "back"))


def _shown(joint: JointAnalysis) -> DryFriction | None:
    estimate = joint.assessment.estimate
    dry = estimate.dry if estimate is not None and estimate.usable else None
    return dry if dry is not None and len(dry.kinetic) >= _LEAST_SLIPS else None


def _show_in_proportion(plot: Any, dry: DryFriction) -> None:
    """What hardly changes is to look so."""
    low, high = float(dry.kinetic.min()), float(dry.kinetic.max())
    room = max(0.1 * (high - low), 0.5 * (_LEAST_SPAN * max(abs(low), abs(high)) - (high - low)))
    plot.y_range = Range1d(low - room, high + room)


def _level(dry: DryFriction, way: int) -> float:
    """Mean friction in a direction [N·m]."""
    return dry.coulomb.value + (way * dry.load.value if dry.load is not None else 0.0)


def position_dependence_plot(joint: JointAnalysis) -> Plot | None:
    """Kinetic friction over position, in both directions: each slip, means of places, the ripple."""
    dry = _shown(joint)
    if dry is None:
        return None
    plot = new_figure("position [rad]", "kinetic friction [N·m]")
    for way, colour, name in _WAYS:
        here = dry.direction == way
        if not here.any():
            continue
        plot.scatter(dry.position[here], dry.kinetic[here], size=4, color=colour, alpha=0.4, legend_label=name)
        if dry.ripple is not None:
            x = _along(dry.position, dry.ripple.period)
            plot.line(x, _level(dry, way) + dry.ripple.at(x), color=GREEN, line_width=1.5, legend_label="ripple")
        places = [place for place in dry.places if place.direction == way]
        errors = [place.std if math.isfinite(place.std) else 0.0 for place in places]
        source = ColumnDataSource(
            {
                "position": [place.position for place in places],
                "mean": [place.mean for place in places],
                "low": [place.mean - error for place, error in zip(places, errors, strict=True)],
                "high": [place.mean + error for place, error in zip(places, errors, strict=True)],
            }
        )
        whisker = Whisker(source=source, base="position", lower="low", upper="high", line_color=colour, line_width=1.5)
        whisker.upper_head.line_color = whisker.lower_head.line_color = colour
        whisker.upper_head.size = whisker.lower_head.size = 6
        plot.add_layout(whisker)
        plot.scatter(
            "position", "mean", source=source, size=8, color=colour, marker="square", legend_label=f"{name}, mean"
        )
    _show_in_proportion(plot, dry)
    finish(plot)
    ripple_text = "no period stands out of the scatter"
    if dry.ripple is not None:
        ripple_text = (
            f"the curve is a ripple of ±{dry.ripple.amplitude:.2g} N·m, {1.0 / dry.ripple.period:.3g} times a radian"
        )
    return Plot(
        plot,
        "Friction over position",
        f"Kinetic friction of {len(dry.kinetic)} slips against their direction, at the positions that they began from; "
        f"squares are means of places with their standard errors; {ripple_text}.",
    )


def _along(position: FloatArray, period: float) -> FloatArray:
    """Positions of a smooth curve [rad]."""
    extent = float(np.ptp(position))
    number = min(max(int(_PER_PERIOD * extent / period), 2), _MOST_POINTS)
    return np.asarray(np.linspace(float(position.min()), float(position.max()), number))


def time_dependence_plot(joint: JointAnalysis) -> Plot | None:
    """Kinetic friction over time, in both directions: each slip, and the drift."""
    dry = _shown(joint)
    if dry is None:
        return None
    plot = new_figure("time [s]", "kinetic friction [N·m]")
    since = dry.time - joint.start
    ends = np.array([since.min(), since.max()])
    for way, colour, name in _WAYS:
        here = dry.direction == way
        if not here.any():
            continue
        plot.scatter(since[here], dry.kinetic[here], size=6, color=colour, legend_label=name)
        if dry.drift is not None:
            level = _level(dry, way) + dry.drift.value * (ends + joint.start - dry.middle)
            plot.line(ends, level, color=GREEN, line_width=2, legend_label="drift")
    _show_in_proportion(plot, dry)
    finish(plot)
    drift_text = "the line is its drift" if dry.drift is not None else "no drift stands out of the scatter"
    return Plot(
        plot,
        "Friction over time",
        f"Kinetic friction of {len(dry.kinetic)} slips against their direction, at the times that they began; "
        f"{drift_text}.",
    )


DRY_FRICTION_PLOTS = (position_dependence_plot, time_dependence_plot)
