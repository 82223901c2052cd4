# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Eq. (43) on arrays."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad

from benchmarks.timing import best
from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.extinction import energy_margin


def run() -> None:
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
        f"margin of Eq. (43), arrays        {1e-6 / closed:8.2f} million points a second, "
        f"{by_quadrature / closed:6.0f} x scipy.integrate.quad"
    )


if __name__ == "__main__":
    run()
