# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip warm-up`: compile everything ahead, on all cores.

Run it once after installation and after each update, on each kind of processor; otherwise the first command or node
compiles. The result is kept beside the package, or in NUMBA_CACHE_DIR if that is set.

Examples:
    stickslip warm-up
    stickslip warm-up --jobs 2
"""

from __future__ import annotations

import argparse
import time

from stickslip_ros.cli.options import add_option
from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.compilation import NOT_KEPT, cache_folder
from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.warm_up import compile_ahead, is_warm


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_option(parser, "--jobs", "N", "number of parts compiled at once (default: one for each core)", type=int)


def run(options: argparse.Namespace) -> int:
    """Compile, unless that is done already."""
    if options.jobs is not None and options.jobs < 1:
        raise InvalidParameterError("--jobs", ">= 1", options.jobs)
    folder = cache_folder()
    if not folder.permanent:
        raise StickSlipError(NOT_KEPT)
    if is_warm():
        print(f"compiled already: {folder.path}")
        return 0
    began = time.monotonic()
    failure = compile_and_say(options.jobs)
    if failure:
        raise StickSlipError(failure)
    print(f"compiled in {time.monotonic() - began:.0f} s: {folder.path}")
    return 0


def compile_and_say(jobs: int | None = None) -> str:
    """Compile what is not compiled yet, with a line about it where stderr is a terminal; returns why not, or ""."""
    with Terminal(stderr=True).status("") as status:
        return compile_ahead(status.update, jobs)
