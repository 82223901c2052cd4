# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip figures`: the paper's figures, drawn from the equations, with their numbers.

Examples:
    stickslip figures
    stickslip figures 1 13 --out pictures
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.cli.options import output_folder
from stickslip_ros.cli.terminal import progress_bar
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.extinction import energy_margin, work_integral
from stickslip_ros.model.extinction_map import ExtinctionMap, extinction_map
from stickslip_ros.model.friction import Gains, Joint, steady_friction, stribeck_shape
from stickslip_ros.model.simulation import simulate_trajectory
from stickslip_ros.output.plotting import BLUE, COLOURS, GREEN, GREY, ORANGE, RED, Curve, Figure, Panel, boundary, save
from stickslip_ros.settings.known_joints import load_joint

_JOINT = "puma560_joint1"
FIGURES = (1, 5, 6, 8, 9, 11, 12, 13, 14)
_WITH_MAP = (13, 14)

_STIFFNESS_LABEL = "stiffness  $k_p/M$  [1/s²]"
_SPEED_LABEL = "commanded velocity  $\\dot x_d$  [mrad/s]"
_DAMPINGS = (0.0, 10.0, 30.0, 60.0)  # k_v [N·m·s/rad]
_MAP_POINTS = (100, 80)
_CYCLES = 12
_LEAST_STIFFNESS = 2.0  # of k_p/M [1/s²]
_LARGEST_STIFFNESS = 1200.0  # k_p/M [1/s²]
_SPEEDS = (0.05, 3.0)  # of the Stribeck velocity
_WIDE_SPEEDS = (0.02, 50.0)
_WIDE_STIFFNESS = 20_000.0
# Title, note and panels of a figure.
Drawn = tuple[str, str, tuple[Panel, ...]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    numbers = ", ".join(map(str, FIGURES))
    parser.add_argument(
        "numbers", nargs="*", type=int, metavar="N", help=f"figures to draw, of {numbers} (default: all)"
    )
    parser.add_argument("--out", type=output_folder, default="figures", metavar="FOLDER", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Write PNG, SVG and CSV of each figure and print their paths."""
    for number in options.numbers:
        if number not in FIGURES:
            raise InvalidParameterError("figure", f"one of {', '.join(map(str, FIGURES))}", number)
    joint = load_joint(_JOINT).joint
    numbers = options.numbers or FIGURES
    computed = None
    if set(numbers) & set(_WITH_MAP):
        with progress_bar("integrating the map of Fig. 13") as progress:
            axes = figure_13_axes(joint)
            computed = extinction_map(joint, *axes, workers=os.cpu_count() or 1, progress=progress)
    for number in numbers:
        for path in save(draw(joint, number, computed), options.out):
            print(path)
    return 0


def draw(joint: Joint, number: int, computed: ExtinctionMap | None = None) -> Figure:
    """One of the figures; Figs 13 and 14 need the map of :func:`figure_13_axes`."""
    makers: dict[int, Callable[[Joint], Drawn]] = {
        1: _figure_1, 5: _figure_5, 6: _figure_6, 8: _figure_8, 9: _figure_9, 11: _figure_11, 12: _figure_12
    }  # fmt: skip
    if computed is not None:
        makers |= {13: partial(_figure_13, computed=computed), 14: partial(_figure_14, computed=computed)}
    title, note, panels = makers[number](joint)
    return Figure(name=f"figure_{number:02d}", title=f"Fig. {number}  {title}", note=note, panels=panels)


def _figure_1(joint: Joint) -> Drawn:
    velocity = np.linspace(0.0, 0.06, 601)
    friction = joint.friction
    rising = replace(friction, stribeck=0.0)
    without = np.asarray(steady_friction(rising, velocity))
    curves = (
        Curve(label="friction in steady sliding", x=1e3 * velocity, y=np.asarray(steady_friction(friction, velocity))),
        Curve(
            label="without Stribeck friction", x=1e3 * velocity[1:], y=without[1:],
            colour=GREY, style="--",
        ),
        Curve(
            label="static friction after long contact", x=np.zeros(1),
            y=np.array([float(friction.coulomb) + float(friction.stribeck)]), colour=RED, style="o",
        ),
    )  # fmt: skip
    start = Curve(label="", x=np.zeros(2), y=np.array([0.0, curves[2].y[0]]), colour=RED, style=":")
    curves[0].y[0] = curves[2].y[0]
    panel = Panel(
        x_label="velocity  $\\dot x$  [mrad/s]",
        y_label="friction torque  [N·m]",
        curves=(start, *curves),
        legend="lower right",
    )
    return (
        "Friction falls with speed before it rises: the Stribeck curve",
        (
            "Eqs (1)-(5) in steady sliding; PUMA 560 joint 1. The paper gives no Coulomb friction; "
            "8.43 N·m is the value usually published."
        ),
        (panel,),
    )


def _slip_curves(groups: DimensionlessGroups, colour: str) -> list[Curve]:
    """The first slip and the last of several cycles."""
    motion = simulate_trajectory(groups, _CYCLES)
    starts = np.flatnonzero(np.diff(motion.time, prepend=-math.inf) > 0)
    leaves = [index for index in starts if motion.velocity[index] == 0.0 and motion.shape[index] == 1.0]
    ends = [*leaves[1:], len(motion.time)]
    curves = []
    for which, name, style in ((0, "first slip", "-"), (len(leaves) - 1, f"slip {len(leaves)}", "--")):
        part = slice(leaves[which], ends[which])
        curves.append(Curve(label=name, x=motion.position[part], y=motion.velocity[part], colour=colour, style=style))
    return curves


def _circle(groups: DimensionlessGroups) -> Curve:
    """The unperturbed first slip: no damping, friction constant at its breakaway level."""
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    velocity = float(groups.velocity)
    centre = 2.0 * float(groups.damping_ratio) * velocity - float(groups.stribeck)
    return Curve(
        label="unperturbed circle",
        x=centre + velocity * np.sin(angle + math.pi),
        y=velocity * (1.0 - np.cos(angle)),
        colour=GREY,
        style=":",
    )


def _slip_panel(groups: DimensionlessGroups, title: str, colour: str) -> Panel:
    return Panel(
        x_label="position  $\\xi$  (relative to steady motion)  [1]",
        y_label="velocity  $\\dot x/\\dot x_s$  [1]",
        curves=(_circle(groups), *_slip_curves(groups, colour)),
        title=title,
        legend="upper left",
        equal=True,
    )


def _figure_5(joint: Joint) -> Drawn:
    own = dimensionless_groups(joint, Gains(stiffness=400.0 * float(joint.inertia)), joint.friction.stribeck_velocity)
    panels = []
    for stribeck, words in ((float(own.stribeck), "joint 1"), (11.4, "the print's caption")):
        groups = replace(own, stribeck=stribeck)
        title = f"$F^*_{{s\\infty}}$ = {stribeck:.3g} ({words})"
        panels.append(_slip_panel(groups, title, BLUE))
    return (
        "A slip in the phase plane, and the circle it would be without friction's work",
        (
            "Eq. (14); k_p/M = 400 /s², k_v = 0, commanded at the Stribeck velocity (our choice).\n"
            "The caption's 11.4 is far from the boundary that the text claims; joint 1 has 2.19. Both are drawn."
        ),
        tuple(panels),
    )


def _figure_6(joint: Joint) -> Drawn:
    own = dimensionless_groups(joint, Gains(stiffness=400.0 * float(joint.inertia)), joint.friction.stribeck_velocity)
    without = replace(own, lag=0.0)
    return (
        "Frictional memory shrinks the slip",
        (
            "Eqs (14) and (5); joint 1, k_p/M = 400 /s², k_v = 0, commanded at the Stribeck velocity (our choice).\n"
            "Without lag friction is back at its full level when the joint stops."
        ),
        (
            _slip_panel(own, f"with the joint's lag, τ* = {float(own.lag):.3g}", BLUE),
            _slip_panel(without, "without lag, τ* = 0", ORANGE),
        ),
    )


def _figure_8(_: Joint) -> Drawn:
    time = np.linspace(0.0, 2.0 * math.pi, 721)
    curves = []
    for lag, colour in zip((0.0, 0.5, 1.0, 2.0, 3.0), COLOURS, strict=False):
        lagged = np.where(time > lag, 1.0 - np.cos(time - lag), 0.0)
        curves.append(Curve(label=f"τ* = {lag:g}", x=time, y=np.asarray(stribeck_shape(lagged, 1.0)), colour=colour))
    panel = Panel(
        x_label="time since breakaway  $\\omega t$  [1]",
        y_label="Stribeck friction over its breakaway level  Ψ  [1]",
        curves=tuple(curves),
    )
    return (
        "Stribeck friction along the unperturbed circle, later with more memory",
        "Eq. (5) with the velocity of the circle, commanded at the Stribeck velocity; its work is Eq. (27).",
        (panel,),
    )


def _figure_9(_: Joint) -> Drawn:
    velocity = np.geomspace(0.02, 50.0, 400)
    curves = tuple(
        Curve(label=f"τ* = {lag:g}", x=np.log10(velocity), y=np.asarray(work_integral(velocity, lag)), colour=colour)
        for lag, colour in zip((0.0, 0.5, 1.0, 1.5, 2.0, 3.0), COLOURS, strict=True)
    )
    panel = Panel(
        x_label="commanded over Stribeck velocity, its decimal logarithm  log₁₀ $\\dot\\xi_d$  [1]",
        y_label="work integral  $I(\\dot\\xi_d, \\tau^*)$  [1]",
        curves=curves,
    )
    return (
        "The work of friction in a cycle: with memory it feeds less, then takes",
        "Eq. (27), in the closed form that the paper does not give. Above 0 friction feeds the oscillation.",
        (panel,),
    )


def _axes(joint: Joint) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    velocity = float(joint.friction.stribeck_velocity) * np.linspace(*_SPEEDS, 400)
    return velocity, float(joint.inertia) * np.linspace(5.0, _LARGEST_STIFFNESS, 400)


def _wide_axes(joint: Joint) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    velocity = float(joint.friction.stribeck_velocity) * np.geomspace(*_WIDE_SPEEDS, 400)
    return velocity, float(joint.inertia) * np.geomspace(5.0, _WIDE_STIFFNESS, 400)


def _paper_boundary(
    joint: Joint,
    axes: tuple[NDArray[np.float64], NDArray[np.float64]],
    damping: float,
    label: str,
    colour: str,
    *,
    rises_from_coulomb: bool = False,
) -> Curve:
    velocity, stiffness = axes
    groups = dimensionless_groups(joint, Gains(stiffness=stiffness[:, None], damping=damping), velocity[None, :])
    margin = np.asarray(energy_margin(groups, rises_from_coulomb=rises_from_coulomb))
    return boundary(label, 1e3 * velocity, stiffness / float(joint.inertia), margin, colour, "-")


def _paper_boundaries(
    joint: Joint, axes: tuple[NDArray[np.float64], NDArray[np.float64]], *, rises_from_coulomb: bool = False
) -> tuple[Curve, ...]:
    return tuple(
        _paper_boundary(
            joint, axes, damping, f"$k_v$ = {damping:g} N·m·s/rad", colour, rises_from_coulomb=rises_from_coulomb
        )
        for damping, colour in zip(_DAMPINGS, COLOURS, strict=False)
    )


def _map_panel(curves: tuple[Curve, ...]) -> Panel:
    return Panel(
        x_label=_SPEED_LABEL,
        y_label=_STIFFNESS_LABEL,
        curves=curves,
        legend="upper right",
        title="stick-slip below the curve of the damping",
    )


def _figure_11(joint: Joint) -> Drawn:
    simple = replace(joint, friction=replace(joint.friction, lag=0.0, rise_time=0.0))
    return (
        "Where stick-slip ends: Stribeck friction alone",
        "Eq. (43) with τ_L = 0 and γ = 0; joint 1, F_v included in every curve.",
        (
            replace(
                _map_panel(_paper_boundaries(simple, _wide_axes(joint))),
                legend="center",
                logarithmic=True,
                title="stick-slip between the two branches of a damping's curve",
            ),
        ),
    )


def _figure_12(joint: Joint) -> Drawn:
    simple = replace(joint, friction=replace(joint.friction, lag=0.0))
    return (
        "Where stick-slip ends: with rising static friction, without memory",
        (
            "Eq. (43) with τ_L = 0 and h = 1: static friction is taken to rise from the Coulomb level (Fig. 10(b)),\n"
            "since by (32) h would be 0 and the rise without effect."
        ),
        (_map_panel(_paper_boundaries(simple, _axes(joint), rises_from_coulomb=True)),),
    )


def figure_13_axes(joint: Joint) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocity [rad/s] and stiffness [N·m/rad] of Fig. 13's map, 8,000 points."""
    columns, rows = _MAP_POINTS
    velocity = float(joint.friction.stribeck_velocity) * np.linspace(*_SPEEDS, columns)
    # Closer together where the joint is soft: there the boundaries turn back within little.
    roots = np.linspace(math.sqrt(_LEAST_STIFFNESS), math.sqrt(_LARGEST_STIFFNESS), rows)
    return velocity, float(joint.inertia) * roots**2


def _exact_boundary(joint: Joint, computed: ExtinctionMap, damping: float, label: str, colour: str) -> Curve:
    return boundary(
        label,
        1e3 * computed.velocity,
        computed.stiffness / float(joint.inertia),
        computed.total_damping(damping) - computed.exact_damping,
        colour,
        "--",
    )


def _figure_13(joint: Joint, computed: ExtinctionMap) -> Drawn:
    exact = tuple(
        _exact_boundary(joint, computed, damping, "exact" if damping == 0.0 else "", colour)
        for damping, colour in zip(_DAMPINGS, COLOURS, strict=False)
    )
    return (
        "Where stick-slip ends: with frictional memory and rising static friction",
        (
            "Eq. (43), solid, and (4)-(6) integrated, dashed, for the same dampings; joint 1.\n"
            f"At {100 * computed.conservative:.1f} % of the map's {computed.exact_damping.size} points the damping k_v "
            "that (43) asks for is enough. Dashed curves turn back: the softest joints need less damping again."
        ),
        (_map_panel((*_paper_boundaries(joint, _axes(joint)), *exact)),),
    )


def _figure_14(joint: Joint, computed: ExtinctionMap) -> Drawn:
    total = 4.9
    bare = replace(joint, friction=replace(joint.friction, viscous=total))
    curves = (
        _paper_boundary(bare, _axes(bare), 0.0, "Eq. (43)", BLUE),
        _exact_boundary(joint, computed, total, "integrated exactly", GREEN),
    )
    return (
        "Where stick-slip ends on the robot, $k_v'$ = 4.9 N·m·s/rad",
        "The paper's 17 trial points are not available as numbers and are left out.",
        (_map_panel(curves),),
    )
