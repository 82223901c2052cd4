# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The picture of where a joint sticks over speed and stiffness, where it is, and where advice would put it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.exact import Progress
from stickslip_ros.model.extinction_map import ExtinctionMap, extinction_map, map_axes
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.output.plotting import BLUE, GREEN, GREY, ORANGE, RED, Curve, Figure, Panel, Region, boundary, png

_FEW_POINTS = 600  # a second's work


@dataclass(frozen=True, kw_only=True)
class MapSubject:
    """What a map is about.

    Attributes
    ----------
    name : of the joint. velocity : commanded [rad/s]; 0 if there is none.
    advised : gains that would make it smooth, or None.
    per_inertia : whether joint and gains are known but for the inertia, which then is 1.
    """

    name: str = "joint"
    joint: Joint
    gains: Gains
    velocity: float
    advised: Gains | None = None
    per_inertia: bool = False

    @property
    def on_the_map(self) -> bool:
        """Whether there is an operating point: it needs a speed and a stiffness."""
        return self.velocity != 0 and float(self.gains.stiffness) > 0


def subject_of(name: str, assessment: Assessment, velocity: float) -> MapSubject | None:
    """The subject of a joint's map at a velocity [rad/s], None if its friction or its place on the map is unknown."""
    joint, gains = assessment.joint, assessment.margin_gains
    if joint is None or gains is None or not math.isfinite(velocity):
        return None
    advised, recommendation = assessment.recommended, assessment.recommendation
    wanted = advised is not None and advised.found and not (recommendation is not None and recommendation.keep)
    subject = MapSubject(
        name=name, joint=joint, gains=gains, velocity=velocity,
        advised=advised.gains if advised is not None and wanted else None, per_inertia=assessment.per_inertia,
    )  # fmt: skip
    return subject if subject.on_the_map else None


def map_of(subject: MapSubject, points: int, *, workers: int = 1, progress: Progress | None = None) -> ExtinctionMap:
    """The map about a joint's operating point and the advised one, with about so many points."""
    stiffnesses = [float(gains.stiffness) for gains in (subject.gains, subject.advised) if gains is not None]
    axes = map_axes(subject.joint, velocity=subject.velocity, stiffnesses=stiffnesses, points=points)
    return extinction_map(subject.joint, *axes, workers=workers, progress=progress)


def map_figure(subject: MapSubject, computed: ExtinctionMap, *, name: str = "stability_map") -> Figure:
    """The map at the present damping, with the operating point; beside it that at the advised one, with its gains."""
    notes = f"Eqs (4)-(6) integrated at {computed.exact_damping.size} points; "
    if subject.joint.friction.of_the_paper:
        share = 100 * computed.conservative
        notes += f"the damping that Eq. (43) asks for is enough at {share:.1f} % of them."
    else:
        notes += f"Eq. (43) is not applicable to the friction law of the joint, {subject.joint.friction.law_in_words}."
        if not subject.joint.friction.rigid:
            notes += " The map is of the same joint without presliding."
    if subject.joint.transmission is not None:
        notes += " The map is of a rigid joint, without the spring between motor and load."
    unknown = ", gives no answer (grey)" if computed.unknown.any() else ""
    note = "There is no operating point: it needs a speed and a stiffness."
    panels = [_panel(subject, computed, "now", subject.gains)]
    if subject.on_the_map:
        note = "Drawn without the integral action, which has no place in Eq. (43)." if subject.gains.integral else ""
        if subject.advised is not None:
            panels.append(_panel(subject, computed, "advised", subject.advised))
    return Figure(
        name=name,
        title=f"Where {subject.name} sticks (red), swings (orange), moves steadily (white){unknown}",
        note=f"{notes}\n{note}",
        panels=tuple(panels),
    )


def _panel(subject: MapSubject, computed: ExtinctionMap, when: str, gains: Gains) -> Panel:
    """The map at one damping: three regions, and the point of these gains."""
    x, y = 1e3 * computed.velocity, computed.stiffness
    stiffness_unit, damping_unit = ("1/s²", "1/s") if subject.per_inertia else ("N·m/rad", "N·m·s/rad")
    exact_inside, steady_inside = computed.missing_damping(float(gains.damping))
    curves = [
        boundary("stick-slip ends (integrated)", x, y, exact_inside, RED, "-"),
        boundary("moves steadily from here on", x, y, steady_inside, GREEN, "-"),
    ]
    if subject.joint.friction.of_the_paper:
        paper_inside = computed.paper_damping - computed.total_damping(float(gains.damping))
        curves.append(boundary("stick-slip ends by Eq. (43)", x, y, paper_inside, BLUE, ":"))
    title = f"{when}: $k_v$ = {float(gains.damping):.3g} {damping_unit}"
    if subject.on_the_map:
        speed, stiffness = 1e3 * abs(subject.velocity), float(gains.stiffness)
        label = f"{when}: {speed:.3g} mrad/s, {stiffness:.4g} {stiffness_unit}"
        colour, style = (RED, "o") if when == "now" else (GREEN, "*")
        curves.append(Curve(label=label, x=np.array([speed]), y=np.array([stiffness]), colour=colour, style=style))
    regions = [Region(x=x, y=y, inside=steady_inside, colour=ORANGE), Region(x=x, y=y, inside=exact_inside, colour=RED)]
    if computed.unknown.any():
        regions.append(Region(x=x, y=y, inside=np.where(computed.unknown, 1.0, -1.0), colour=GREY))
    return Panel(
        x_label="commanded velocity [mrad/s]",
        y_label=f"stiffness $k_p$ [{stiffness_unit}{', per inertia' if subject.per_inertia else ''}]",
        curves=tuple(curves),
        regions=tuple(regions),
        title=title,
        logarithmic=True,
        legend="below",
        right=None if subject.per_inertia else ("$k_p/M$ [1/s²]", 1.0 / float(subject.joint.inertia)),
    )


def picture(subject: MapSubject) -> bytes:
    """A small map as a PNG image; takes a second."""
    return png(map_figure(subject, map_of(subject, _FEW_POINTS)))
