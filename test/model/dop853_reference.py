# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""An independent, slow and accurate solution of Eqs (14), (5), (6): scipy's DOP853 by the method of steps.

``python test/model/dop853_reference.py`` writes reference_cycles.csv anew (four minutes on two cores).
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

TABLE = Path(__file__).with_name("reference_cycles.csv")
POINT = ("damping_ratio", "stribeck", "velocity", "lag", "rise_time")
CYCLES = 2
_POINTS = 240
_LONGEST_SLIP = 40 * 2 * math.pi  # with a long lag swings may grow for long before the joint stops


def random_points(count: int, seed: int) -> np.ndarray:
    """Wide ranges, one in five of the points without lag; columns as POINT."""
    generator = np.random.default_rng(seed)
    lag_share = generator.choice([0.0, 0.01, 0.1, 0.3, 1.0], count)
    return np.column_stack(
        [
            10 ** generator.uniform(-2.5, 0.3, count),
            10 ** generator.uniform(-1.0, 1.7, count),
            10 ** generator.uniform(-1.5, 1.3, count),
            2 * math.pi * generator.uniform(0.0, 1.0, count) * lag_share,
            10 ** generator.uniform(-1.0, 1.5, count),
        ]
    )


def hess_soom(speed: float) -> float:
    """Ψ of the paper."""
    return 1 / (1 + speed**2)


def slip(level: float, damping_ratio: float, velocity: float, lag: float, rtol: float = 1e-10, falls=hess_soom):
    """Duration, position at arrest and Ψ there of one slip from breakaway; None if there is no arrest."""

    def arrests(_, state):
        return state[1] + velocity

    arrests.terminal = True
    arrests.direction = -1
    state = [2 * damping_ratio * velocity - level, -velocity]
    before = None
    begin = 0.0
    while begin < _LONGEST_SLIP:

        def shape(time, state, before=before):
            if lag == 0:
                return falls(velocity + state[1])
            return 1.0 if before is None else falls(velocity + before(time - lag)[1])

        def motion(time, state, shape=shape):
            return [state[1], -state[0] - 2 * damping_ratio * state[1] - level * shape(time, state)]

        solution = solve_ivp(
            motion, (begin, begin + (lag or 1.0)), state, method="DOP853", rtol=rtol, atol=1e-13 * max(1.0, level),
            dense_output=True, events=arrests if begin > 0 else None, max_step=0.5,
        )  # fmt: skip
        if solution.status == 1:
            time, end = solution.t_events[0][0], solution.y_events[0][0]
            return time, end[0], shape(time, end)
        before, state, begin = solution.sol, solution.y[:, -1], solution.t[-1]
    return None


def cycles(point: np.ndarray, count: int = CYCLES, rtol: float = 1e-10, falls=hess_soom) -> np.ndarray:
    """Slip duration, dwell, level at breakaway of each cycle, from full static friction; NaN once it has died out."""
    damping_ratio, stribeck, velocity, lag, rise_time = map(float, point)
    rows = np.full((count, 3), np.nan)
    level = stribeck
    for row in rows:
        found = slip(level, damping_ratio, velocity, lag, rtol, falls)
        if found is None:
            break
        duration, end, shape = found
        arrested, force = level * shape, 2 * damping_ratio * velocity - end

        def risen(dwell, arrested=arrested):
            return arrested + (stribeck - arrested) * dwell / (dwell + rise_time)

        def excess(dwell, force=force, risen=risen):
            return force + velocity * dwell - risen(dwell)

        dwell = brentq(excess, 0.0, 1.0 + (stribeck - force) / velocity, xtol=1e-15, rtol=1e-14)
        row[:] = duration, dwell, level
        level = risen(dwell)
    return rows


def main() -> None:
    """Write the table."""
    points = random_points(_POINTS, seed=20261121)
    with ProcessPoolExecutor() as pool:
        results = list(pool.map(cycles, points))
    header = [*POINT, *(f"{name}_{n}" for n in range(CYCLES) for name in ("slip_duration", "dwell", "level"))]
    rows = np.column_stack([points, np.array(results).reshape(len(points), -1)])
    np.savetxt(TABLE, rows, delimiter=",", header=",".join(header), comments="", fmt="%.17g")


if __name__ == "__main__":
    main()
