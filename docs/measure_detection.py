# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Measures the figures of docs/detection.md: detection against the simulation's own events.

Run from the repository: python docs/measure_detection.py
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import EventKind, simulate
from stickslip_ros.monitoring.detection.rests import RestDetector
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.settings.known_joints import load_joint

PUMA = load_joint("puma560_joint1").joint
COUNT = 2.5e-5


def measure(damping: float, resolution: float, *, with_velocity: bool = False) -> str:
    """One row of the table: all stiffnesses, speeds and directions at one damping and resolution."""
    arrests, breakaways, sticks, missed, invented = [], [], 0, 0, 0
    generator = np.random.default_rng(1)
    for stiffness, speed, sign in itertools.product((50, 100, 200, 350, 500), (0.5, 0.7, 1, 2, 3.5, 5), (1, -1)):
        velocity, period = sign * speed * 0.0058, 2 * math.pi / math.sqrt(stiffness)
        time = 1e-3 * np.arange(30_000)
        references = velocity * np.maximum(time - 0.5, 0.0) + generator.uniform(0, COUNT)
        gains = Gains(stiffness=stiffness * 6.3, damping=damping)
        trajectory = simulate(PUMA, gains, references, np.where(time >= 0.5, velocity, 0.0))
        velocities = trajectory.velocity if with_velocity else ()
        positions = resolution * np.round(trajectory.position / resolution)
        detector = RestDetector()
        batch = Batch(time=trajectory.time, position=positions, velocity=velocities)
        found = (detector.rest_at(complete=True) for _ in detector.motion.follow(batch))
        rests = [rest for rest in found if rest is not None and rest.direction_before]
        true = [
            (one.time, other.time)
            for one, other in itertools.pairwise(trajectory.events)
            if one.kind is EventKind.ARREST and other.time < 30.0 - 0.6 * period
        ]
        for arrest, breakaway in true:
            near = [rest for rest in rests if rest.arrest < breakaway + 0.03 and rest.breakaway > arrest - 0.03]
            sticks += breakaway - arrest >= 0.01
            missed += not near and breakaway - arrest >= 0.01
            if near:
                arrests.append(near[0].arrest - arrest)
                breakaways.append((near[0].breakaway - breakaway) / period)
        invented += sum(
            not any(a < r.breakaway + 0.05 and b > r.arrest - 0.05 for a, b in true) for r in rests if r.breakaway < 29
        )
    low, high = 1e3 * np.percentile(arrests, [0, 100])
    early, late = 100 * np.percentile(breakaways, [0, 100])
    return (
        f"| {damping:g} | {resolution:g}{' and velocity' if with_velocity else ''} | {sticks} | {missed} | {invented} "
        f"| {low:+.0f} to {high:+.0f} | {early:+.1f} to {late:+.1f} |"
    )


if __name__ == "__main__":
    print(
        "| damping k_v [N·m·s/rad] | encoder [rad] | sticks | missed | false | error of the arrest [ms] "
        "| error of the breakaway [% of 2π/ω] |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for damping, resolution in ((0.0, COUNT), (20.0, COUNT), (60.0, COUNT), (0.0, 1e-4), (0.0, 1e-6)):
        print(measure(damping, resolution))
    for damping, resolution in ((20.0, COUNT), (0.0, 1e-6)):
        print(measure(damping, resolution, with_velocity=True))
