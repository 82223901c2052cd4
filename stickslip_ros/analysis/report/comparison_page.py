# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The page of a comparison: what changed of each joint, and both motions over each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.analysis import comparison as comparisons
from stickslip_ros.analysis.analysis import AnalysisOptions, BagAnalysis
from stickslip_ros.analysis.comparison import Comparison, JointComparison
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.judgement import JUDGED
from stickslip_ros.analysis.report.page import Plot, write_page
from stickslip_ros.bags.reading import read_windows
from stickslip_ros.monitoring.samples import FloatArray

_PERIODS = 6.0  # that are drawn
_SECONDS = 10.0  # that are drawn of joints that never stuck
_MOST_POINTS = 4000  # of a curve


def write_comparison_page(path: Path, comparison: Comparison, options: Sequence[AnalysisOptions]) -> None:
    """Write the page; both bags are read once more, for the motions it draws.

    Parameters
    ----------
    options : with which the bag before and that after were analysed.

    Raises
    ------
    StickSlipError
        If the package bokeh is missing, or a bag is no longer there.
    OSError
        If it cannot be written.
    """
    bags = (comparison.before, comparison.after)
    lengths = {joint.name: _length(joint) for joint in comparison.joints}
    motions = [_motions(bag, lengths, chosen) for bag, chosen in zip(bags, options, strict=True)]
    overlays = {
        joint.name: _overlay(joint, *(found[joint.name] for found in motions))
        for joint in comparison.joints
        if all(joint.name in found for found in motions)
    }
    write_page(
        path,
        "comparison.html",
        list(overlays.values()),
        title="Before and after: did it help?",
        names=[Path(bag.path).name for bag in bags],
        joints=comparison.joints,
        overlays=overlays,
        words=comparisons,
        missing=[
            *(f"{name} is in the recording {side} only" for name, side in comparison.alone.items()),
            *(f"before: {text}" for text in comparison.before.warnings),
            *(f"after: {text}" for text in comparison.after.warnings),
        ],
    )


def _length(joint: JointComparison) -> float:
    """How long a stretch of both is drawn [s]."""
    periods = [cycle.period for one in (joint.before, joint.after) for cycle in one.cycles]
    return _PERIODS * float(np.median(periods)) if periods else _SECONDS


def _motions(analysis: BagAnalysis, lengths: dict[str, float], options: AnalysisOptions) -> dict[str, FloatArray]:
    """Times and positions of each joint from the beginning of the plot; forward motion is up."""
    windows = {name: (begin, begin + length) for name, length in lengths.items()
               if math.isfinite(begin := _begin(analysis.joints[name], length))}  # fmt: skip
    found = read_windows(Path(analysis.path), windows, options.topics, options.unpacking)
    motions = {}
    for name, motion in found.items():
        if len(motion) > 1:
            time, way = (motion[:: max(1, math.ceil(len(motion) / _MOST_POINTS))] - motion[0]).T
            motions[name] = np.stack([time, np.copysign(1.0, way[-1]) * way])
    return motions


def _begin(joint: JointAnalysis, length: float) -> float:
    """Where to begin [s]: some cycles in the middle of all; without any, the longest stretch of judged motion."""
    if joint.cycles:
        middle = joint.cycles[max(len(joint.cycles) // 2 - int(_PERIODS) // 2, 0)]
        return middle.breakaway - middle.dwell
    moving = [one for one in joint.segments if one.status in JUDGED]
    if not moving:
        return math.nan
    longest = max(moving, key=lambda one: one.end - one.start)
    return max(longest.start, 0.5 * (longest.start + longest.end - length))


def _overlay(joint: JointComparison, before: FloatArray, after: FloatArray) -> Plot:
    from stickslip_ros.analysis.report.plots import BLUE, RED, finish, new_figure

    plot: Any = new_figure("time [s]", "distance moved [rad]")
    for label, motion, colour in (("before", before, RED), ("after", after, BLUE)):
        time, way = motion.astype(np.float32)
        plot.line(time, way, color=colour, line_width=2, legend_label=label)
    finish(plot)
    end = max(before[0, -1], after[0, -1])
    speeds = f"{before[1, -1] / before[0, -1]:.3g} rad/s before, {after[1, -1] / after[0, -1]:.3g} rad/s after"
    return Plot(
        plot,
        "Both motions",
        f"{end:.3g} s of {joint.name} from each recording, each from its own beginning; forward motion is up: "
        "stairs are stick-slip, a straight line is smooth motion, a wavy one swings without a stop. "
        f"Mean speeds here: {speeds}.",
    )
