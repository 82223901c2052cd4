# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip map`: draw the speeds and stiffnesses at which a joint sticks, and its present ones.

Examples:
    stickslip map --model puma560_joint1 --points 400
    stickslip map --model puma560_joint1 --damping 20 --out map.png
"""

from __future__ import annotations

import argparse
import os

from stickslip_ros.cli.margin import add_joint_arguments, joint_from
from stickslip_ros.cli.options import PICTURE, add_option
from stickslip_ros.cli.terminal import progress_bar
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.output.plotting import save
from stickslip_ros.output.stability_map import MapSubject, map_figure, map_of

_LEAST_POINTS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_joint_arguments(parser)
    add_option(parser, "--points", "N", "number of points to integrate", 4000, type=int)
    add_option(parser, "--out", "FILE.png", "picture to write", "extinction_map.png", type=PICTURE)


def run(options: argparse.Namespace) -> int:
    """Write the map as PNG, SVG and CSV and print the paths."""
    if options.points < _LEAST_POINTS:
        raise InvalidParameterError("--points", f">= {_LEAST_POINTS}", options.points)
    given = joint_from(options)
    subject = MapSubject(name=given.name, joint=given.joint, gains=given.gains, velocity=given.velocity)
    with progress_bar("integrating") as progress:
        computed = map_of(subject, options.points, workers=os.cpu_count() or 1, progress=progress)
    for path in save(map_figure(subject, computed, name=options.out.stem), options.out.parent):
        print(path)
    return 0
