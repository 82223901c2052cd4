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
from stickslip_ros.output.plotting import BLUE, GREEN, ORANGE, RED, Curve, Figure, Panel, Region, boundary, png

_FEW_POINTS = 600  # a second's work
_SAME_DAMPING = 1e-3  # of the total; below it the advised boundary would lie on the other one


@dataclass(frozen=True, kw_only=True)
class MapSubject:
    """What a map is about.

    Attributes
    ----------
    name : of the joint. velocity : commanded [rad/s]; 0 if there is none.
    advised : gains that would make it smooth, or None.
    per_inertia : whether joint and gains are known but for the inertia, which then is 1.
    """

    name: str
    joint: Joint
    gains: Gains
    velocity: float
    advised: Gains | None = None
    per_inertia: bool = False

    @property
    def on_the_map(self) -> bool:
        """Whether there is an operating point: it needs a speed and a stiffness."""
        return self.velocity != 0 and float(self.gains.stiffness) > 0

    @property
    def advised_damping(self) -> float | None:
        """Advised damping k_v [N·m·s/rad], None if it is the present one or there is no advice."""
        if self.advised is None:
            return None
        advised, present = float(self.advised.damping), float(self.gains.damping)
        return advised if abs(advised - present) > _SAME_DAMPING * float(self.joint.total_damping(self.gains)) else None


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
    """The map at the gains' damping: three regions, the operating point, and where the advice would put it."""
    total = computed.total_damping(float(subject.gains.damping))
    x, y = 1e3 * computed.velocity, computed.stiffness
    stiffness_unit, damping_unit = ("1/s²", "1/s") if subject.per_inertia else ("N·m/rad", "N·m·s/rad")
    exact_inside = computed.exact_damping - total
    steady_inside = computed.steady_damping - total
    curves = [
        boundary("stick slip ends (integrated)", x, y, exact_inside, RED, "-"),
        boundary("moves steadily from here on", x, y, steady_inside, GREEN, "-"),
    ]
    said = f"(4)-(6) integrated at {computed.exact_damping.size} points; "
    if subject.joint.friction.of_the_paper:
        curves.append(boundary("stick slip ends by Eq. (43)", x, y, computed.paper_damping - total, BLUE, ":"))
        share = 100 * computed.conservative
        said += f"the damping that Eq. (43) asks for is enough at {share:.1f} % of them."
    else:
        said += f"Eq. (43) is not applicable to the friction law of the joint, {subject.joint.friction.law_in_words}."
        if not subject.joint.friction.rigid:
            said += " The map is of the same joint without presliding."
    if subject.advised_damping is not None:
        inside = computed.steady_damping - computed.total_damping(subject.advised_damping)
        curves.append(boundary("with the advised damping: steadily outside", x, y, inside, GREEN, "--"))
    note = "There is no operating point: it needs a speed and a stiffness."
    if subject.on_the_map:
        speed = 1e3 * abs(subject.velocity)
        note = "Drawn without the integral action, which has no place in Eq. (43)." if subject.gains.integral else ""

        def point(label: str, gains: Gains, colour: str, style: str) -> Curve:
            return Curve(
                label=label, x=np.array([speed]), y=np.array([float(gains.stiffness)]), colour=colour, style=style
            )

        now = f"now: {speed:.3g} mrad/s, {float(subject.gains.stiffness):.4g} {stiffness_unit}"
        if subject.advised is not None:
            stiffness, damping = float(subject.advised.stiffness), float(subject.advised.damping)
            advised = f"advised: {stiffness:.4g} {stiffness_unit}, {damping:.3g} {damping_unit}"
            curves.append(point(advised, subject.advised, GREEN, "*"))
        curves.append(point(now, subject.gains, RED, "o"))
    panel = Panel(
        x_label="commanded velocity [mrad/s]",
        y_label=f"stiffness $k_p$ [{stiffness_unit}{', per inertia' if subject.per_inertia else ''}]",
        curves=tuple(curves),
        regions=(
            Region(x=x, y=y, inside=steady_inside, colour=ORANGE),
            Region(x=x, y=y, inside=exact_inside, colour=RED),
        ),
        logarithmic=True,
        legend="below",
        words=((0.03, 0.04, "at the present damping; red: sticks, orange: swings, white: moves steadily"),),
        right=None if subject.per_inertia else ("$k_p/M$ [1/s²]", 1.0 / float(subject.joint.inertia)),
    )
    return Figure(
        name=name,
        title=f"What {subject.name} does at $k_v$ = {float(subject.gains.damping):.3g} {damping_unit}",
        note=f"{said}\n{note}",
        panels=(panel,),
    )


def picture(subject: MapSubject) -> bytes:
    """A small map as a PNG image; takes a second."""
    return png(map_figure(subject, map_of(subject, _FEW_POINTS)))
