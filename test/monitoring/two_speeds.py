# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What an encoder sees of a machine that moves at two speeds, and a monitor that learns from it."""

from __future__ import annotations

import numpy as np
from machines import Machine, drawn, simulate

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

SECONDS = 60.0
_RATE, _SPEEDS = 1000.0, (0.005, 0.003)


def recording(machine: Machine, gains: Gains, resolution: float) -> Batch:
    """Half a minute at either speed."""
    times = np.arange(int(SECONDS * _RATE)) / _RATE
    velocities = np.where(times < SECONDS / 2, *_SPEEDS)
    references = drawn(machine, gains) + np.append(0.0, np.cumsum(velocities)[:-1]) / _RATE
    motion = simulate(machine, gains, references, velocities, 1.0 / _RATE)
    return Batch(
        time=times,
        position=resolution * np.round(motion.position / resolution),
        effort=motion.effort,
        reference_position=references,
        reference_velocity=velocities,
    )


def monitor_of(batch: Batch, gains: Gains | None) -> JointMonitor:
    """A monitor that has learnt from a recording."""
    monitor = JointMonitor(None, gains, studies_at_once=True, at_arrest=True)
    monitor.process(batch)
    monitor.finish()
    return monitor
