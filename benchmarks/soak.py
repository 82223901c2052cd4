# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Memory of monitors over hours: python -m benchmarks.soak [MINUTES] [--plot FILE].

Two monitors run beside each other on ROS domains of their own: one of an arm's seven joints at 1 kHz, ten times what a
joint_state_broadcaster publishes by default, one of fifty joints at 100 Hz. All joints stick and slip.
"""

from __future__ import annotations

import argparse
import os
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.node import resident, stream
from stickslip_ros.cli.processes import NodeProcess, free_domains, isolate
from stickslip_ros.output.plotting import COLOURS, Curve, Figure, Panel, png

_EVERY = 60.0  # [s]
_SETTLED = 5  # minutes, after which it is to grow no more
_STREAM_BEGINS = 8.0  # [s], for the publisher works its motion out first


@dataclass
class _Case:
    """Some joints; ``sizes`` : resident memory at each minute [MB]."""

    joints: int
    rate: float
    sizes: list[float] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.joints} joints at {self.rate:g} Hz"

    @property
    def grown(self) -> float:
        """After it has settled [MB]."""
        return self.sizes[-1] - self.sizes[min(_SETTLED, len(self.sizes) - 1)]


def run(minutes: int, plot: Path | None = None) -> None:
    """Print the resident memory every minute, and by how much it grew after the fifth; write a picture if wanted."""
    isolate()
    cases = [_Case(7, 1000.0), _Case(50, 100.0)]
    with ExitStack() as running:
        monitors = []
        for case, domain in zip(cases, free_domains(), strict=False):
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            monitors.append(running.enter_context(NodeProcess("monitor", {"joints": "['']", "state_file": "none"})))
            time.sleep(4.0)
            running.enter_context(stream(case.joints, case.rate, 60.0 * minutes + 60.0, case.joints))
        time.sleep(_STREAM_BEGINS)
        print(f"minute  {'  '.join(map(str, cases))}")
        begin = time.monotonic()
        for minute in range(minutes + 1):
            time.sleep(max(begin + _EVERY * minute - time.monotonic(), 0.0))
            for case, monitor in zip(cases, monitors, strict=True):
                case.sizes.append(resident(monitor.pid))
            sizes = "  ".join(f"{case.sizes[-1]:{len(str(case)) - 3}.1f} MB" for case in cases)
            print(f"{minute:6d}  {sizes}", flush=True)
    for case in cases:
        print(f"{case}: grown after the first {_SETTLED} minutes: {case.grown:+.1f} MB")
    if plot is not None:
        _draw(cases, plot)


def _draw(cases: list[_Case], path: Path) -> None:
    curves = tuple(
        Curve(label=f"{case}, all sticking", x=np.arange(len(case.sizes)), y=np.array(case.sizes), colour=colour)
        for case, colour in zip(cases, COLOURS, strict=False)
    )
    panel = Panel(x_label="minutes", y_label="memory of the monitor [MB]", curves=curves)
    figure = Figure(name=path.stem, title="Memory of two monitors that learn all the time", note="", panels=(panel,))
    path.write_bytes(png(figure))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("minutes", type=int, nargs="?", default=60)
    parser.add_argument("--plot", type=Path, help="picture to write (.png)")
    given = parser.parse_args()
    run(given.minutes, given.plot)
