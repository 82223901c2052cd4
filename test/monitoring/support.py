# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Simulated recordings with the truth beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, Trajectory, simulate
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch


@dataclass(frozen=True)
class TrueStick:
    """A rest between two slips, as the integration met it."""

    arrest: float
    breakaway: float

    @property
    def dwell(self) -> float:
        """Time at rest [s]."""
        return self.breakaway - self.arrest


@dataclass(frozen=True)
class SimulatedRecording:
    """What an encoder saw, and what was."""

    batch: Batch
    sticks: list[TrueStick]
    trajectory: Trajectory


def record(
    joint: Joint,
    gains: Gains,
    velocity: float,
    *,
    duration: float = 30.0,
    resolution: float = 2.5e-5,
    offset: float = 0.0,
    every: int = 1,
    with_velocity: bool = False,
    with_reference: bool = True,
    hold: float = 0.5,
) -> SimulatedRecording:
    """Hold, then constant velocity from rest, sampled at 1 kHz (or every so many milliseconds) by an encoder."""
    period = 1e-3
    time = period * np.arange(round(duration / period))
    references = velocity * np.maximum(time - hold, 0.0) + offset
    velocities = np.where(time >= hold, velocity, 0.0)
    trajectory = simulate(joint, gains, references, velocities, period=period)
    pick = slice(None, None, every)
    batch = Batch(
        time=trajectory.time[pick],
        position=resolution * np.round(trajectory.position[pick] / resolution),
        velocity=trajectory.velocity[pick] if with_velocity else np.zeros(0),
        effort=trajectory.effort[pick],
        reference_position=(references + period * velocities)[pick] if with_reference else np.zeros(0),
        reference_velocity=velocities[pick] if with_reference else np.zeros(0),
    )
    sticks = [
        TrueStick(one.time, other.time)
        for one, other in zip(trajectory.events[:-1], trajectory.events[1:], strict=True)
        if one.kind is EventKind.ARREST
    ]
    return SimulatedRecording(batch, sticks, trajectory)


def cycles_of(batch: Batch, *, pieces: int = 1) -> list[Cycle]:
    """Cycles that a monitor finds that knows nothing of the joint."""
    monitor = JointMonitor()
    found: list[Cycle] = []
    for indices in np.array_split(np.arange(len(batch)), pieces):
        found += monitor.process(batch.where(slice(int(indices[0]), int(indices[-1]) + 1)))
    return found + monitor.finish()
