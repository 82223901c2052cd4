# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The report's plots: what they show as arrays, and as figures that can be zoomed.

Bokeh draws them: its script is a quarter of plotly's, so that a page of one file stays small, and unlike a picture
its axes follow the zoom.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from bokeh.models import BoxAnnotation, ColumnDataSource, FixedTicker, HoverTool, Label, Range1d, Span, Whisker
from bokeh.plotting import figure
from scipy.ndimage import distance_transform_edt

from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.analysis.report.page import Plot
from stickslip_ros.model.extinction_map import ExtinctionMap
from stickslip_ros.model.friction import Gains, steady_friction
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.friction.dry_friction import DryFriction
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.output.plotting import boundary
from stickslip_ros.output.stability_map import MapSubject, map_of, subject_of
from stickslip_ros.output.wording import angle_text

RED, AMBER, BLUE, GREEN, ORANGE, GREY = "#d1242f", "#bf8700", "#218bff", "#2da44e", "#e16f24", "#8c959f"
INK = "#1b1f24"  # of what the page paints in the colour of its text
_ROOM = 3.0  # points of the map from a region's edge, for a word in it
_MARKED, _FEW_MARKS = 3000, 150  # cycles at most; from which on their marks are small
_MAP_POINTS = 900
_BAND = (5.0, 95.0)  # per cent
_CURVE = 300
_FEW_DECADES = 2.5
# Of dry friction, slip by slip.
_LEAST_SLIPS = 8
_LEAST_SPAN = 0.1  # of the largest value, that an axis covers
_PER_PERIOD, _MOST_CURVE = 24, 3000  # points of a ripple
_WAYS = ((1, BLUE, "forward"), (-1, ORANGE, "back"))
_SMOOTHED = 5  # samples on either side, where a velocity has to be derived
_LEAST_STEP = 1e-9  # [s] of them, where stamps hardly differ


def new_figure(x: str, y: str | None, *, height: int = 320, log: bool = False, **more: Any) -> Any:
    """An empty figure that can be zoomed, as wide as there is room."""
    kinds = {"x_axis_type": "log", "y_axis_type": "log"} if log else {}
    plot = figure(
        height=height, sizing_mode="stretch_width", x_axis_label=x, y_axis_label=y, min_width=240,
        tools="pan,box_zoom,wheel_zoom,reset,save", active_drag="box_zoom", active_scroll=None, **kinds, **more,
    )  # fmt: skip
    plot.toolbar.logo = None
    plot.toolbar.autohide = False
    return plot


def finish(plot: Any) -> None:
    """Put the legend below, where it hides nothing."""
    if plot.legend:
        plot.legend.click_policy = "hide"
        plot.legend.label_text_font_size = "9pt"
        plot.legend.border_line_alpha = 0.0
        plot.legend.ncols, plot.legend.location = 2, "left"
        plot.legend.padding, plot.legend.spacing, plot.legend.margin = 0, 12, 4
        plot.add_layout(plot.legend[0], "below")


def _shade(plot: Any, begin: float, end: float, colour: str, alpha: float) -> None:
    """Shade a stretch of time."""
    plot.add_layout(BoxAnnotation(left=begin, right=end, fill_color=colour, fill_alpha=alpha, line_color=None))


def _small(values: FloatArray) -> Any:
    """Half the size in the page; enough for a screen."""
    return np.asarray(values, dtype=np.float32)


def position_plot(joint: JointAnalysis) -> Plot | None:
    """The whole recording: position in outline, reference, stretches of stick-slip, breakaways."""
    if joint.traces is None:
        return None
    time, low, high = joint.traces.position.points()
    if not len(time):
        return None
    plot = new_figure("time [s]", "position [rad]")
    time = time - joint.start
    for segment in joint.segments:
        colour = {Status.STICK_SLIP: RED, Status.AT_RISK: AMBER}.get(segment.status)
        if colour and segment.end > segment.start:
            _shade(plot, segment.start - joint.start, segment.end - joint.start, colour, 0.09)
    desired_time, desired_low, desired_high = joint.traces.reference.points()
    if len(desired_time):
        desired = 0.5 * (desired_low + desired_high)
        plot.line(
            _small(desired_time - joint.start), _small(desired), color=ORANGE, line_width=1.5, legend_label="reference"
        )
    plot.varea(_small(time), _small(low), _small(high), color=BLUE, alpha=0.4)
    plot.line(_small(time), _small(0.5 * (low + high)), color=BLUE, line_width=1.5, legend_label="position")
    if joint.cycles:
        chosen = joint.cycles[:: max(1, math.ceil(len(joint.cycles) / _MARKED))]
        source = ColumnDataSource(
            {
                "time": _small(np.array([one.breakaway for one in chosen]) - joint.start),
                "position": _small(np.array([one.position for one in chosen])),
                "slip": _small(np.array([one.slip_distance for one in chosen])),
                "dwell": _small(np.array([one.dwell for one in chosen])),
            }
        )
        marks = plot.scatter(
            "time", "position", source=source, size=6 if len(chosen) <= _FEW_MARKS else 3, color=RED, marker="triangle",
            alpha=1.0 if len(chosen) <= _FEW_MARKS else 0.5, legend_label="breakaway",
        )  # fmt: skip
        tips = [("breakaway", "@time{0.000} s"), ("slip", "@slip{0.0000} rad"), ("dwell", "@dwell{0.000} s")]
        plot.add_tools(HoverTool(renderers=[marks], tooltips=tips))
    finish(plot)
    sticking = joint.time_in(Status.STICK_SLIP)
    return Plot(
        plot,
        "Position and reference",
        f"Position of {joint.name} over {joint.duration:.4g} s; {len(joint.cycles)} breakaways marked by triangles, "
        f"{sticking:.3g} s of stick-slip shaded red. Drag a box to zoom, the round arrow shows everything again.",
        wide=True,
    )


def error_plot(joint: JointAnalysis) -> Plot | None:
    """Position less its reference over the whole recording, at its own scale: there the steps are seen."""
    if joint.traces is None:
        return None
    time, low, high = joint.traces.error.points()
    if not len(time):
        return None
    plot = new_figure("time [s]", "position − reference [mrad]", height=240)
    time, low, high = time - joint.start, 1e3 * low, 1e3 * high
    for segment in joint.segments:
        if segment.status is Status.STICK_SLIP and segment.end > segment.start:
            _shade(plot, segment.start - joint.start, segment.end - joint.start, RED, 0.09)
    plot.varea(_small(time), _small(low), _small(high), color=BLUE, alpha=0.4)
    plot.line(_small(time), _small(0.5 * (low + high)), color=BLUE, line_width=1.5)
    most = angle_text(1e-3 * float(np.nanmax(np.abs([low, high]))))
    caption = f"{joint.name} is at most {most} from its reference."
    if joint.cycles:
        caption += (
            " Each jump is a slip, as a rule of "
            f"{angle_text(joint.usual_slip)}; between them the joint stands while its reference goes on."
        )
    return Plot(plot, "Steps: position minus reference", caption, wide=True)


def close_up_plot(joint: JointAnalysis) -> Plot | None:
    """A few cycles, every sample."""
    close_up = joint.traces.close_up() if joint.traces else None
    if close_up is None:
        return None
    samples, cycle = close_up.samples, close_up.cycle
    time = samples.time - joint.start
    plot = new_figure("time [s]", "position [rad]")
    _shade(plot, cycle.breakaway - cycle.dwell - joint.start, cycle.breakaway - joint.start, RED, 0.12)
    if np.isfinite(samples.reference_position).any():
        plot.line(time, _small(samples.reference_position), color=ORANGE, line_width=1.5, legend_label="reference")
    plot.line(time, _small(samples.position), color=BLUE, line_width=2, legend_label="position")
    finish(plot)
    return Plot(
        plot,
        "A usual cycle, as recorded",
        f"At rest for {cycle.dwell:.3g} s (shaded), then a slip of {cycle.slip_distance:.3g} rad in "
        f"{cycle.slip_duration:.3g} s, from {cycle.breakaway - joint.start:.4g} s on.",
    )


def phase_plot(joint: JointAnalysis) -> Plot | None:
    """One cycle in the phase plane of the moving frame, with the unperturbed circle (Figs 5-7)."""
    close_up = joint.traces.close_up() if joint.traces else None
    state = joint.assessment
    if close_up is None or state.joint is None or state.margin_gains is None:
        return None
    stiffness = float(state.margin_gains.stiffness)
    if not stiffness > 0.0:
        return None
    frequency = math.sqrt(stiffness / float(state.joint.inertia))
    cycle = close_up.cycle
    samples = close_up.samples
    inside = (samples.time >= cycle.breakaway - cycle.dwell) & (samples.time <= cycle.arrest + 0.2 * cycle.dwell)
    part = samples.where(inside)
    if len(part) < 8:
        return None
    velocity = velocity_of(part.time, part.position, part.velocity)
    direction = 1.0 if cycle.slip_distance > 0 else -1.0
    speed = _speed_of(part, cycle.mean_speed)
    error = direction * (part.position - _reference(part, direction * speed))
    begin, end = (float(np.interp(time, part.time, error)) for time in (cycle.breakaway, cycle.arrest))
    across = frequency * (error - 0.5 * (begin + end))
    plot = new_figure("ω·(position − reference), about its middle [rad/s]", "velocity [rad/s]", match_aspect=True)
    angle = np.linspace(0.0, 2.0 * math.pi, 200)
    plot.line(
        _small(speed * np.sin(angle)), _small(speed * (1.0 - np.cos(angle))),
        color=GREEN, line_dash="dashed", line_width=2, legend_label="unperturbed",
    )  # fmt: skip
    plot.line(_small(across), _small(direction * velocity), color=BLUE, line_width=2, legend_label="this cycle")
    plot.scatter(
        [frequency * (begin - 0.5 * (begin + end)), frequency * (end - 0.5 * (begin + end))], [0.0, 0.0],
        size=8, color=RED, legend_label="breakaway, arrest",
    )  # fmt: skip
    finish(plot)
    return Plot(
        plot,
        "One cycle in the phase plane",
        "The slip as a loop about the moving equilibrium, and the circle that it would be if friction did not fall "
        f"with speed (ω = {frequency:.3g} 1/s). If the loop stays outside the circle, stick-slip continues; if it "
        "shrinks to the circle, it dies out.",
    )


def velocity_of(time: FloatArray, position: FloatArray, velocity: FloatArray) -> FloatArray:
    """The velocity as it was measured, else from the positions."""
    if np.isfinite(velocity).all():
        return velocity
    number = np.arange(len(time))
    ahead, behind = np.minimum(number + _SMOOTHED, len(time) - 1), np.maximum(number - _SMOOTHED, 0)
    return np.asarray((position[ahead] - position[behind]) / np.maximum(time[ahead] - time[behind], _LEAST_STEP))


def _speed_of(part: Batch, otherwise: float) -> float:
    """Of the reference, or of the cycle as a whole [rad/s]."""
    reference = part.reference_position
    if np.isfinite(reference).all():
        return abs(float(reference[-1] - reference[0]) / float(part.time[-1] - part.time[0])) or otherwise
    return otherwise


def _reference(part: Batch, velocity: float) -> FloatArray:
    if np.isfinite(part.reference_position).all():
        return part.reference_position
    return np.asarray(velocity * (part.time - part.time[0]))


def friction_plot(joint: JointAnalysis) -> Plot | None:
    """Friction against speed: efforts measured in sliding, the fitted curve and its band."""
    state = joint.assessment
    inertia = float(state.joint.inertia) if state.joint is not None and not state.per_inertia else 0.0
    nothing = (np.zeros(0), np.zeros(0))
    points = joint.traces.friction_points(state.resolution, inertia) if joint.traces else nothing
    estimate = state.estimate
    curve = state.joint.friction if state.joint is not None else None
    if not len(points[0]) and curve is None:
        return None
    unit = "rad/s²" if state.per_inertia else "N·m"
    label = "Stribeck and viscous friction per inertia" if state.per_inertia else "friction"
    plot = new_figure("speed [rad/s]", f"{label} [{unit}]")
    captions = []
    fastest = 3.0 * joint.velocity if math.isfinite(joint.velocity) else 0.0
    if curve is not None:
        fastest = max(fastest, 6.0 * float(curve.stribeck_velocity))
    if len(points[0]) and not state.per_inertia:
        speed, force = np.abs(points[0]), points[1] * np.sign(points[0])
        plot.scatter(_small(speed), _small(force), size=3, color=BLUE, alpha=0.35, legend_label="measured in sliding")
        fastest = max(fastest, 1.05 * float(speed.max()))
        less = ", less what accelerated the joint" if inertia > 0.0 else ""
        captions.append(f"the effort in {len(speed)} stretches of sliding{less}")
    if curve is not None:
        speeds = np.linspace(0.0, fastest, _CURVE)
        above = np.maximum(speeds, 1e-12 * max(fastest, 1e-300))  # at rest friction has no one value
        if estimate is not None and estimate.usable:
            draws = replace(estimate.draws()[0].friction, coulomb=float(curve.coulomb))
            low, high = np.percentile(np.asarray(steady_friction(draws, above[:, None])), _BAND, axis=1)
            plot.varea(_small(speeds), _small(low), _small(high), color=ORANGE, alpha=0.3, legend_label="5 % to 95 %")
            captions.append("the curve fitted to the slips with the band that 90 % of its errors span")
        else:
            captions.append("the curve configured")
        usual = np.asarray(steady_friction(curve, above), dtype=float)
        plot.line(_small(speeds), _small(usual), color=ORANGE, line_width=2, legend_label="curve used")
    if math.isfinite(joint.velocity):
        plot.add_layout(
            Span(location=joint.velocity, dimension="height", line_color=RED, line_dash="dotted", line_width=1.5)
        )
    finish(plot)
    caption = "; ".join(captions)
    return Plot(
        plot,
        "Friction against speed",
        f"{caption[:1].upper()}{caption[1:]}. The dotted line is at {joint.velocity:.3g} rad/s. "
        "Friction that falls with speed is what feeds stick-slip.",
    )


def map_plot(joint: JointAnalysis) -> Plot | None:
    """Where in the plane of speed and stiffness the joint sticks with its damping, and where it is."""
    subject = subject_of("joint", joint.assessment, joint.velocity)
    if subject is None:
        return None
    where = f"the joint now, at {subject.velocity:.3g} rad/s and stiffness {float(subject.gains.stiffness):.4g}"
    return _map_plot(subject, subject.gains, "Where it sticks", f"With the present damping. The dot is {where}.")


def advised_map_plot(joint: JointAnalysis) -> Plot | None:
    """The same with the advised gains."""
    subject = subject_of("joint", joint.assessment, joint.velocity)
    if subject is None or subject.advised is None:
        return None
    where = f"where the advice puts the joint, at stiffness {float(subject.advised.stiffness):.4g}"
    return _map_plot(
        subject, subject.advised, "Where it would stick", f"With the advised damping. The star is {where}."
    )


@lru_cache(maxsize=1)
def _map_of(subject: MapSubject) -> ExtinctionMap:
    return map_of(subject, _MAP_POINTS)


def _map_plot(subject: MapSubject, gains: Gains, title: str, caption: str) -> Plot:
    found, damping = _map_of(subject), float(gains.damping)
    velocities, stiffnesses = found.velocity, found.stiffness
    unit = "1/s², per inertia" if subject.per_inertia else "N·m/rad"
    plot = new_figure("commanded speed [rad/s]", f"stiffness [{unit}]", log=True)
    plot.x_range = Range1d(float(velocities[0]), float(velocities[-1]))
    plot.y_range = Range1d(float(stiffnesses[0]), float(stiffnesses[-1]))
    for axis, values in ((plot.xaxis[0], velocities), (plot.yaxis[0], stiffnesses)):
        ticks = _round_numbers(float(values[0]), float(values[-1]))
        axis.ticker = FixedTicker(ticks=ticks)
        axis.major_label_overrides = {tick: f"{tick:g}" for tick in ticks}
    _draw_regions(plot, found, damping)
    edge = boundary("", np.log(velocities), np.log(stiffnesses), found.missing_damping(damping)[1], INK, "-")
    plot.line(_small(np.exp(edge.x)), _small(np.exp(edge.y)), color=INK, line_width=2).glyph.tags = ["ink"]
    speed, stiffness = abs(subject.velocity), float(gains.stiffness)
    if gains is subject.gains:
        plot.scatter([speed], [stiffness], size=11, color=BLUE, marker="circle", legend_label="now")
    else:
        plot.scatter([speed], [stiffness], size=14, color=GREEN, marker="star", legend_label="advised")
    finish(plot)
    regions = "The joint sticks (red), swings about its speed (orange), moves steadily (green)."
    return Plot(plot, title, f"{caption} {regions}")


def _draw_regions(plot: Any, found: ExtinctionMap, damping: float) -> None:
    """Shade what becomes of the joint at a damping k_v, and write it into each region that has room for a word."""
    # Where there is no answer all three fields are 0: nothing is shaded.
    sticks, unsteady = map(np.nan_to_num, found.missing_damping(damping))
    for word, field, colour in (
        ("sticks", sticks, RED),
        ("swings", np.minimum(unsteady, -sticks), ORANGE),
        ("steady", -np.maximum(unsteady, sticks), GREEN),
    ):
        inside = field > 0.0
        if not inside.any():
            continue
        plot.contour(
            x=found.velocity, y=found.stiffness, z=field, levels=[0.0, 2.0 * float(field.max())],
            fill_color=[colour], fill_alpha=0.15, line_color=None,
        )  # fmt: skip
        # As far from the region's edges as can be; the frame is an edge too.
        depth = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        if depth[row, column] >= _ROOM:
            plot.add_layout(
                Label(
                    x=float(found.velocity[column]), y=float(found.stiffness[row]), text=word, text_align="center",
                    text_baseline="middle", text_font_size="9pt", text_font_style="bold", text_color=INK, tags=["ink"],
                )
            )  # fmt: skip


def _round_numbers(low: float, high: float) -> list[float]:
    """Numbers to write along a logarithmic axis: powers of ten, and between few of them 2 and 5 of each."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    mantissas = (1, 2, 5) if math.log10(high / low) < _FEW_DECADES else (1,)
    ticks = [mantissa * 10.0**exponent for exponent in exponents for mantissa in mantissas]
    return [float(f"{tick:g}") for tick in ticks if low <= tick <= high]


def _dry_friction(joint: JointAnalysis) -> DryFriction | None:
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
    dry = _dry_friction(joint)
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
    number = min(max(int(_PER_PERIOD * extent / period), 2), _MOST_CURVE)
    return np.asarray(np.linspace(float(position.min()), float(position.max()), number))


def time_dependence_plot(joint: JointAnalysis) -> Plot | None:
    """Kinetic friction over time, in both directions: each slip, and the drift."""
    dry = _dry_friction(joint)
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


PLOTS = (
    position_plot, error_plot, close_up_plot, phase_plot, friction_plot, map_plot, advised_map_plot,
    position_dependence_plot, time_dependence_plot,
)  # fmt: skip
