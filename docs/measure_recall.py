# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Measures the table of docs/detection.md on coarse encoders: slips found, by counts a slip and by rate.

Run from the repository: python docs/measure_recall.py
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, Trajectory, simulate
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

COUNTS = (5, 7, 10, 15, 20, 30)
RATES = (50, 100, 250, 1000)  # [Hz]
NOISES = (0.0, 0.3)  # counts
JOINTS_A_RATE = 8
LEAST_DWELL = 0.01  # [s]
OVERLAP = 0.3  # of a slip: so much of it a cycle must cover to be it
PERIOD = 1e-3  # [s] of the simulation


@dataclass(frozen=True)
class Slip:
    """A slip after a dwell, as the integration met it; times [s], distance [rad]."""

    begin: float
    end: float
    distance: float


@dataclass
class Tally:
    """Slips there were and found, cycles told, and the time [s] in which a sticking joint was called smooth."""

    slips: int = 0
    found: int = 0
    told: int = 0
    smooth: float = 0.0
    time: float = 0.0


@dataclass(frozen=True)
class Case:
    """One simulated joint."""

    trajectory: Trajectory
    references: NDArray[np.float64]
    velocities: NDArray[np.float64]
    slips: list[Slip] = field(default_factory=list)


def cases(generator: np.random.Generator, count: int) -> Iterator[Case]:
    """Random joints that stick, from undamped to heavily damped."""
    while count:
        inertia, frequency = 10 ** generator.uniform(-2, 1.5), generator.uniform(5, 25)
        stribeck_velocity, momentum = 10 ** generator.uniform(-3.5, -1.3), inertia * frequency
        friction = Friction(
            stribeck=generator.uniform(3, 10) * momentum * stribeck_velocity, stribeck_velocity=stribeck_velocity,
            lag=10 ** generator.uniform(-2.3, -1.5), rise_time=10 ** generator.uniform(-1.3, -0.3),
            viscous=0.04 * momentum, coulomb=momentum * stribeck_velocity,
        )  # fmt: skip
        velocity = stribeck_velocity * generator.uniform(0.3, 1.5)
        damping = momentum * float(generator.choice([0.0, generator.uniform(0.0, 0.6)]))
        time = PERIOD * np.arange(20_000)
        references, velocities = velocity * np.maximum(time - 0.5, 0.0), np.where(time >= 0.5, velocity, 0.0)
        gains = Gains(stiffness=momentum * frequency, damping=damping)
        trajectory = simulate(Joint(inertia=inertia, friction=friction), gains, references, velocities, period=PERIOD)
        events = trajectory.events
        slips = [
            Slip(breakaway.time, arrest.time, abs(arrest.position - breakaway.position))
            for stick, breakaway, arrest in zip(events[:-2], events[1:-1], events[2:], strict=True)
            if stick.kind is EventKind.ARREST and breakaway.time - stick.time >= LEAST_DWELL
        ]
        if len(slips) >= 8:
            count -= 1
            yield Case(trajectory, references + PERIOD * velocities, velocities, slips)


def is_found(slip: Slip, cycles: list[Cycle]) -> bool:
    """Whether one of the cycles covers a slip."""
    least = OVERLAP * (slip.end - slip.begin)
    return any(min(cycle.arrest, slip.end) - max(cycle.breakaway, slip.begin) > least for cycle in cycles)


def watch(case: Case, batch: Batch, tally: Tally) -> None:
    """Count what a monitor finds that knows nothing of the joint."""
    monitor = JointMonitor()
    cycles = monitor.process(batch) + monitor.finish()
    tally.slips += len(case.slips)
    tally.found += sum(is_found(slip, cycles) for slip in case.slips)
    tally.told += len(cycles)
    tally.time += batch.time[-1] - case.slips[0].begin
    tally.smooth += sum(one.end - one.start for one in monitor.segments if one.status is Status.SMOOTH)


def measure(rate: int) -> dict[tuple[bool, float, int], Tally]:
    """What is found at one rate [Hz], with and without the reference, by noise and counts a slip."""
    generator = np.random.default_rng(rate)
    tallies: dict[tuple[bool, float, int], Tally] = {}
    for case in cases(generator, JOINTS_A_RATE):
        pick = slice(None, None, round(1.0 / (rate * PERIOD)))
        distance = float(np.median([slip.distance for slip in case.slips]))
        for counts in COUNTS:
            readings = case.trajectory.position[pick] / distance * counts + generator.uniform()
            for noise in NOISES:
                noisy = readings + generator.normal(0.0, noise, len(readings))
                position = distance / counts * np.round(noisy)
                time = case.trajectory.time[pick]
                known = Batch(
                    time=time, position=position,
                    reference_position=case.references[pick], reference_velocity=case.velocities[pick],
                )  # fmt: skip
                for with_reference, batch in ((True, known), (False, Batch(time=time, position=position))):
                    watch(case, batch, tallies.setdefault((with_reference, noise, counts), Tally()))
    return tallies


if __name__ == "__main__":
    first, *others = COUNTS
    heads = [f"found, {first} counts a slip", *(f"{counts} counts" for counts in others)]
    print(f"| reference | noise [counts] | rate [Hz] | {' | '.join(heads)} |")
    print("|" + " --- |" * (3 + len(COUNTS)))
    measured = {rate: measure(rate) for rate in RATES}
    smooth = {noise: [0.0, 0.0] for noise in NOISES}
    for with_reference in (True, False):
        for noise in NOISES:
            for rate in RATES:
                row = [measured[rate][with_reference, noise, counts] for counts in COUNTS]
                cells = " | ".join(f"{100 * one.found / one.slips:.0f} %" for one in row)
                print(f"| {'yes' if with_reference else 'no'} | {noise:g} | {rate} | {cells} |")
                smooth[noise][0] += sum(one.smooth for one in row)
                smooth[noise][1] += sum(one.time for one in row)
    for noise, (called, lasted) in smooth.items():
        share = 100 * called / lasted
        print(f"\nNoise of {noise:g} counts: called smooth for {share:.1f} % of the time.")
