# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A joint that creeps before it slips: LuGre friction, with an integration and a law of its own.

Inertia and natural frequency, as the excess of static over kinetic friction, are units: a joint with other ones does
the same on other scales. The law has bristles (Canudas de Wit et al. 1995) and no memory but theirs, so that the
package's own law, which knows no creep, has no part in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

SUBSTEPS_PER_PERIOD = 40_000
LEAVES = 0.05  # of the slip's fastest motion: a joint that moves faster has left the creep


@dataclass(frozen=True)
class Creeping:
    """Samples of a joint on a spring that is drawn steadily, and its slips; times [s].

    Attributes
    ----------
    time, position, reference : the samples; lengths in what the spring stretches by the excess of static friction.
    breakaways, arrests : when the joint exceeds LEAVES of a slip's fastest motion, and when it falls below.
    slip : way from the one to the other, as a median; creep : way from there to the next breakaway.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    reference: NDArray[np.float64]
    breakaways: NDArray[np.float64]
    arrests: NDArray[np.float64]
    slip: float
    creep: float


@njit(cache=True)
def _integrate(bristle, speed, static, kinetic, stribeck_velocity, steps, step, turn):  # type: ignore[no-untyped-def]
    positions = np.empty(steps)
    position, velocity, bristles, drawn = -kinetic, 0.0, 0.0, 0.0
    bristle_damping = 1.5 * np.sqrt(bristle)
    for n in range(steps):
        level = kinetic + (static - kinetic) * np.exp(-((velocity / stribeck_velocity) ** 2))
        rate = velocity - bristle * abs(velocity) / level * bristles
        # Damping of the bristles fades with speed, or friction would not be passive.
        damping = bristle_damping * np.exp(-((velocity / stribeck_velocity) ** 2))
        friction = bristle * bristles + damping * rate
        velocity += step * (drawn - position - friction)
        bristles += step * rate
        position += step * velocity
        drawn += step * speed * (1.0 - 2.0 * (n // turn % 2))
        positions[n] = position
    return positions


def creeping(
    *,
    creep: float,
    speed: float = 0.3,
    interval: float = 0.002,
    period: float = 0.63,
    duration: float = 40.0,
    one_way: float = math.inf,
) -> Creeping:
    """Stick-slip of a joint that creeps by about a share ``creep`` of its slip before it slips.

    Parameters
    ----------
    speed : of the reference, over natural frequency times what the spring stretches by the excess of static friction.
    interval : between samples [s]; period : natural period [s]; duration : [s]. one_way : time before each turn [s].
    """
    step = 2 * np.pi / SUBSTEPS_PER_PERIOD
    second = 2 * np.pi / period
    steps = int(duration * second / step)
    turn = int(min(one_way, 2.0 * duration) * second / step)
    positions = _integrate(1.0 / creep, speed, 2.0, 1.0, 0.1, steps, step, turn)
    times = step * np.arange(1, steps + 1) / second
    velocities = np.gradient(positions, times)
    limit = LEAVES * float(velocities.max())
    moves = np.diff((velocities > limit).astype(int))
    breakaways, arrests = times[np.flatnonzero(moves > 0)], times[np.flatnonzero(moves < 0)]
    arrests = arrests[arrests > breakaways[0]]
    breakaways = breakaways[: len(arrests)]
    at_breakaway, at_arrest = np.interp(breakaways, times, positions), np.interp(arrests, times, positions)
    samples = np.arange(interval, duration, interval)
    return Creeping(
        time=samples,
        position=np.interp(samples, times, positions),
        reference=speed * second * (samples if turn > steps else one_way - np.abs(samples % (2.0 * one_way) - one_way)),
        breakaways=breakaways,
        arrests=arrests,
        slip=float(np.median(at_arrest - at_breakaway)),
        creep=float(np.median(at_breakaway[1:] - at_arrest[:-1])),
    )
