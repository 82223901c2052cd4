# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip map`: where a joint sticks, over speed and stiffness, and where it is now."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.cli.margin import add_joint_arguments, joint_from
from stickslip_ros.cli.plotting import BLUE, GREEN, RED, Curve, Figure, Panel, Region, boundary, save
from stickslip_ros.cli.progress import progress_bar
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.extinction_map import ExtinctionMap, extinction_map, map_axes
from stickslip_ros.model.friction import Gains, Joint

_LEAST_POINTS = 100


def add_parser(commands: Any) -> None:
    """Add the command's parser."""
    parser = commands.add_parser(
        "map", help="draw where a joint sticks, by Eq. (43) and exactly, and where it is", description=__doc__
    )
    add_joint_arguments(parser)
    parser.add_argument("--points", type=int, default=4000, metavar="N", help="points to integrate (default 4000)")
    parser.add_argument(
        "--out", type=Path, default=Path("extinction_map.png"), metavar="FILE.png", help="default: extinction_map.png"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the map as PNG, SVG and CSV and print the paths."""
    if options.out.suffix != ".png":
        raise InvalidParameterError("--out", "a file that ends in .png", str(options.out))
    if options.points < _LEAST_POINTS:
        raise InvalidParameterError("--points", f">= {_LEAST_POINTS}", options.points)
    joint, gains, velocity = joint_from(options)
    velocities, stiffnesses = map_axes(
        joint,
        velocity=velocity,
        stiffness=float(gains.stiffness) if gains.stiffness > 0 else None,
        points=options.points,
    )
    with progress_bar("integrating") as progress:
        computed = extinction_map(joint, velocities, stiffnesses, workers=os.cpu_count() or 1, progress=progress)
    figure = map_figure(options.out.stem, options.joint or "joint", joint, gains, velocity, computed)
    for path in save(figure, options.out.parent):
        print(path)
    return 0


def map_figure(
    name: str, joint_name: str, joint: Joint, gains: Gains, velocity: float, computed: ExtinctionMap
) -> Figure:
    """The map at the gains' damping, with both boundaries and the operating point."""
    total = float(gains.damping) + float(joint.friction.viscous)
    x, y = 1e3 * computed.velocity, computed.stiffness
    exact_inside = computed.exact_damping - total
    curves = [
        boundary("boundary of Eq. (43)", x, y, computed.paper_damping - total, BLUE, "-"),
        boundary("exact boundary", x, y, exact_inside, GREEN, "--"),
    ]
    note = "There is no operating point: it needs a speed and a stiffness."
    if velocity != 0 and gains.stiffness > 0:
        speed, stiffness = 1e3 * abs(velocity), float(gains.stiffness)
        label = f"now: {speed:.3g} mrad/s, {stiffness:.4g} N·m/rad"
        curves.append(Curve(label=label, x=np.array([speed]), y=np.array([stiffness]), colour=RED, style="o"))
        note = ""
    panel = Panel(
        x_label="commanded velocity [mrad/s]",
        y_label="stiffness $k_p$ [N·m/rad]",
        curves=tuple(curves),
        regions=(Region(x=x, y=y, inside=exact_inside, colour=RED),),
        logarithmic=True,
        legend="upper right",
        words=((0.03, 0.04, "shaded: stick slip"),),
    )
    return Figure(
        name=name,
        title=f"Where {joint_name} sticks and slips at $k_v$ = {float(gains.damping):g} N·m·s/rad",
        note=(
            f"(4)-(6) integrated at {computed.exact_damping.size} points; the damping that Eq. (43) asks for is enough "
            f"at {100 * computed.conservative:.1f} % of them.\n{note}"
        ),
        panels=(panel,),
    )
