# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Draws the pictures of docs/detection.md: real recordings with the cycles that are found in them.

Run from the repository: python docs/draw_recordings.py FOLDER_OF_RECORDINGS
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot

from stickslip_ros.bags.table import load_recording
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

PICTURES = Path(__file__).parent / "pictures"
# Name of the picture, file, rows, and the unit's factor and name.
DRAWN = (
    ("kinova", "kinova_gen3_joint7_0.03rad_s.csv", 1, 1e3, "mrad"),
    ("openarm", "openarm_joint3_tracking.csv", 4, 1e3, "mrad"),
    ("slider", "slider_1100um_per_s.npz", 4, 1e3, "mm"),
    ("finger", "tendon_finger_p6200.npz", 3, 1e3, "mrad"),
    ("servo", "bus_servo_pendulum_225108.npz", 2, 1e3, "mrad"),
)


def draw(name: str, batch: Batch, rows: int, factor: float, unit: str) -> int:
    """One recording in rows of equal duration; returns how many cycles were found."""
    monitor = JointMonitor()
    cycles = monitor.process(batch) + monitor.finish()
    figure, axes = pyplot.subplots(rows, 1, figsize=(14, 2.6 * rows), squeeze=False, layout="constrained")
    edges = np.linspace(batch.time[0], batch.time[-1], rows + 1)
    for number, panel in enumerate(axes[:, 0]):
        inside = (batch.time >= edges[number]) & (batch.time <= edges[number + 1])
        panel.plot(
            batch.time[inside], factor * batch.position[inside], color="#1f5fa8", linewidth=1.2, label="position"
        )
        panel.plot(
            batch.time[inside],
            factor * batch.reference_position[inside],
            color="#999999",
            linewidth=0.8,
            label="reference",
        )
        for count, cycle in enumerate(cycles, 1):
            if edges[number] <= cycle.breakaway <= edges[number + 1]:
                panel.axvspan(cycle.breakaway, cycle.arrest, color="#c0392b", alpha=0.2, linewidth=0)
                panel.text(
                    0.5 * (cycle.breakaway + cycle.arrest), 1.0, str(count),
                    transform=panel.get_xaxis_transform(), ha="center", va="bottom", fontsize=7,
                )  # fmt: skip
        panel.set_xlim(edges[number], edges[number + 1])
        panel.set_ylabel(f"position [{unit}]")
        panel.spines[["top", "right"]].set_visible(False)
    axes[0, 0].legend(loc="upper left", frameon=False)
    axes[-1, 0].set_xlabel("time [s]; red: a slip that was found, with its number")
    figure.savefig(PICTURES / f"recording_{name}.png", dpi=80)
    pyplot.close(figure)
    return len(cycles)


def main(folder: Path) -> None:
    """Draw every recording that is there."""
    own = Path(__file__).parents[1] / "examples" / "recordings"
    for name, file, rows, factor, unit in DRAWN:
        path = own / file if (own / file).exists() else folder / file
        if path.exists():
            print(f"{name}: {draw(name, load_recording(path).batch, rows, factor, unit)} cycles")
        else:
            print(f"{name}: {path} is not there; left out")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
