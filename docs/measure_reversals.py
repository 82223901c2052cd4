# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Measures the table of docs/friction.md on reversals of a real arm: predicted from what was learnt before, and seen.

Friction is learnt from the first half of the recording. The second half is simulated with it, from the recording's own
reference, seen through the recording's encoder at its stamps, and measured as the recording is.

Run from the repository: python docs/measure_reversals.py FOLDER_OF_RECORDINGS
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from stickslip_ros.bags.table import load_recording
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.reversal import ReferenceMotion, Reversal, followed
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.identification import identify
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

RECORDING, GAINS = "openarm_joint3_tracking.csv", Gains(stiffness=7.0, damping=0.44)
PERIOD = 1e-3  # [s] of the simulation


def measured(batch: Batch) -> tuple[list[Reversal], int]:
    """Each reversal that the monitor sees, and how many cycles."""
    monitor = JointMonitor(options=MonitorOptions(learn=False))
    found: list[Reversal] = []

    def note() -> None:
        record = monitor.assessment().reversals
        if record is not None and (not found or record.last != found[-1]):
            found.append(record.last)

    for index in range(len(batch)):
        monitor.process(batch.where(slice(index, index + 1)))
        note()
    monitor.finish()
    note()
    return found, monitor.cycle_count


def simulated(joint: Joint, batch: Batch, resolution: float) -> Batch:
    """What the recording would be of another joint."""
    times = np.arange(batch.time[0], batch.time[-1] + PERIOD, PERIOD)
    reference = np.interp(times, batch.time, batch.reference_position)
    motion = followed(joint, GAINS, ReferenceMotion(period=PERIOD, position=reference))
    position = np.interp(batch.time, times[1:], motion.position)
    return Batch(
        time=batch.time,
        position=resolution * np.round(position / resolution),
        reference_position=batch.reference_position,
        reference_velocity=batch.reference_velocity,
    )


def main(folder: Path) -> None:
    """Print both, reversal by reversal."""
    batch = load_recording(folder / RECORDING).batch
    middle = len(batch) // 2
    found = identify(batch.where(slice(0, middle)), GAINS)
    joint, rest = found.joint(), batch.where(slice(middle, None))
    seen, cycles = measured(rest)
    predicted, predicted_cycles = measured(simulated(joint, rest, found.resolution))
    print(f"{RECORDING}: learnt from {len(found.cycles)} cycles; {found.slips.mismatch if found.slips else ''}")
    print(joint)
    print(f"cycles {cycles}, predicted {predicted_cycles}")
    for what, ones in (("seen", seen), ("predicted", predicted)):
        for one in ones:
            errors = f"lost motion {1e3 * one.lost_motion:5.1f} mrad, peak error {1e3 * one.peak_error:5.1f} mrad"
            print(f"{what:9s} at {one.time:6.1f} s: stands {one.standing:5.2f} s, {errors}, stops again {one.stops}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
