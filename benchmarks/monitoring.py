# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Detection, and the simulation of one sampled joint, against the recording's own duration."""

from __future__ import annotations

import numpy as np

from benchmarks.timing import best
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.settings.known_joints import load_joint


def run() -> None:
    """One joint at 1 kHz for two minutes."""
    joint = load_joint("puma560_joint1").joint
    count = 120_000
    references = 5.8e-6 * np.arange(count)
    trajectory = simulate(joint, Gains(stiffness=630.0), references, np.full(count, 0.0058))
    batch = Batch(
        time=trajectory.time, position=2.5e-5 * np.round(trajectory.position / 2.5e-5), reference_position=references
    )
    duration = float(batch.time[-1])
    taken = best(lambda: JointMonitor().process(batch))
    simulated = best(lambda: simulate(joint, Gains(stiffness=630.0), references, np.full(count, 0.0058)))
    print(
        f"JointMonitor, 1 joint at 1 kHz    {duration / taken:8.0f} x real time, {1e6 * taken / count:.2f} us a sample"
    )
    print(f"simulation, 1 joint at 1 kHz      {duration / simulated:8.0f} x real time")


if __name__ == "__main__":
    run()
