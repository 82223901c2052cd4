# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip figures`: the paper's figures, drawn from the equations, with their numbers.

Examples:
    stickslip figures
    stickslip figures 1 13 --out pictures
"""

from __future__ import annotations

import argparse
import os

from stickslip_ros.cli import paper_figures
from stickslip_ros.cli.outputs import OutputFolder
from stickslip_ros.cli.progress import progress_bar
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.extinction_map import extinction_map
from stickslip_ros.output.plotting import save
from stickslip_ros.settings.known_joints import load_joint

_JOINT = "puma560_joint1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    numbers = ", ".join(map(str, paper_figures.FIGURES))
    parser.add_argument(
        "numbers", nargs="*", type=int, metavar="N", help=f"figures to draw, of {numbers} (default: all)"
    )
    parser.add_argument("--out", type=OutputFolder(), default="figures", metavar="FOLDER", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Write PNG, SVG and CSV of each figure and print their paths."""
    for number in options.numbers:
        if number not in paper_figures.FIGURES:
            raise InvalidParameterError("figure", f"one of {', '.join(map(str, paper_figures.FIGURES))}", number)
    joint = load_joint(_JOINT).joint
    numbers = options.numbers or paper_figures.FIGURES
    computed = None
    if set(numbers) & set(paper_figures.WITH_MAP):
        with progress_bar("integrating the map of Fig. 13") as progress:
            axes = paper_figures.figure_13_axes(joint)
            computed = extinction_map(joint, *axes, workers=os.cpu_count() or 1, progress=progress)
    for number in numbers:
        for path in save(paper_figures.draw(joint, number, computed), options.out):
            print(path)
    return 0
