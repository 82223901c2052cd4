# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The exact boundary: cycles against scipy's solve_ivp, one joint's verdict, the map of Fig. 13."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import numpy as np

from benchmarks.timing import best, once
from stickslip_ros.cli.figures import figure_13_axes
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction_map import ExtinctionMap, extinction_map
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.simulation import simulate_cycles
from stickslip_ros.model.verdict import verdict
from stickslip_ros.settings.known_joints import load_joint

# The tests' independent solution is also what a user would write with scipy.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "model"))
import dop853_reference

_WORKERS = 2


def run() -> None:
    """All of it."""
    joint = load_joint("puma560_joint1").joint
    _cycles(dimensionless_groups(joint, Gains(stiffness=2016.0), 0.00493))
    gains = Gains(stiffness=2016.0, damping=20.0)
    groups = dimensionless_groups(joint, gains, 0.00493)
    boundary = best(lambda: (cycle_persists(groups), exact_critical_damping_ratio(groups)))
    limits = best(lambda: verdict(joint, gains, 0.00493))
    print(
        f"exact verdict and rho_c, 1 joint  {1e3 * boundary:8.2f} ms; "
        f"with lowest speed and least stiffness {1e3 * limits:.1f} ms"
    )
    _map()


def _cycles(groups: object) -> None:
    count, few = 100, 5
    ours = best(lambda: simulate_cycles(groups, count))
    point = np.array([getattr(groups, name) for name in dop853_reference.POINT], dtype=float)
    by_solve_ivp: list[np.ndarray] = []
    theirs = once(lambda: by_solve_ivp.append(dop853_reference.cycles(point, few, 1e-8))) * count / few
    exact = dop853_reference.cycles(point, few, 1e-12)
    found = simulate_cycles(groups, few)
    error = np.abs(found.breakaway_level / exact[:, 2] - 1).max()
    error_theirs = np.abs(by_solve_ivp[0][:, 2] / exact[:, 2] - 1).max()
    print(
        f"100 cycles of 1 joint             {1e3 * ours:8.2f} ms (error {error:.0e}), "
        f"{theirs / ours:6.0f} x solve_ivp with events (error {error_theirs:.0e})"
    )


def _map() -> None:
    joint = load_joint("puma560_joint1").joint
    velocity, stiffness = figure_13_axes(joint)
    maps: list[ExtinctionMap] = []
    taken = once(lambda: maps.append(extinction_map(joint, velocity, stiffness, workers=_WORKERS)))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    computed = maps[0]
    print(
        f"map of Fig. 13, {computed.exact_damping.size} points        {taken:8.2f} s on {_WORKERS} threads, "
        f"rho_c to 1 %; peak memory of the whole run {peak / 1024:.0f} MB"
    )
    needed = computed.paper_damping > 0
    enough = np.mean(computed.paper_damping[needed] >= 0.99 * computed.exact_damping[needed])
    print(
        f"Eq. (43) is conservative at       {100 * computed.conservative:8.1f} % of the map's points (its k_v is "
        f"enough); its rho_c, where > 0, is at least the exact one at {100 * enough:.1f} %"
    )


if __name__ == "__main__":
    run()
