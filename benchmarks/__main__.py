# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Speed, as ratios against a named alternative measured in the same run: python -m benchmarks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import quad

from stickslip_ros.known_joints import load_joint
from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.extinction import energy_margin
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

_REPEATS = 7


def best(work: Callable[[], object]) -> float:
    """Shortest of several runs after a warm-up [s]: machines are shared, and noise only ever adds."""
    work()
    times = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def margin_on_arrays() -> None:
    """Eq. (43) on arrays against adaptive quadrature of Eq. (27), point by point."""
    generator = np.random.default_rng(1)
    count = 200_000
    groups = DimensionlessGroups(
        natural_frequency=np.ones(count),
        damping_ratio=generator.uniform(0.0, 1.0, count),
        stribeck=generator.uniform(0.1, 10.0, count),
        velocity=10.0 ** generator.uniform(-1.3, 2.0, count),
        lag=generator.uniform(0.0, 2.0 * math.pi, count),
        rise_time=generator.uniform(0.0, 10.0, count),
    )
    closed = best(lambda: energy_margin(groups)) / count
    few = 200

    def quadrature() -> None:
        for velocity, lag in zip(groups.velocity[:few], groups.lag[:few], strict=True):
            quad(lambda t, v=velocity, d=lag: math.cos(t) / (v * v * (1 - math.cos(t - d)) ** 2 + 1), lag, 2 * math.pi)

    by_quadrature = best(quadrature) / few
    print(
        f"margin of Eq. (43), arrays     {1e-6 / closed:8.2f} million points a second, "
        f"{by_quadrature / closed:6.0f} x scipy.integrate.quad"
    )


def detection() -> None:
    """Detection and simulation of one joint at 1 kHz against the recording's own duration."""
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
    print(f"JointMonitor, 1 joint at 1 kHz {duration / taken:8.0f} x real time, {1e6 * taken / count:.2f} us a sample")
    print(f"simulation, 1 joint at 1 kHz   {duration / simulated:8.0f} x real time")


if __name__ == "__main__":
    margin_on_arrays()
    detection()
