# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stability of steady sliding, against the joint simulated from a small disturbance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.steady_sliding import sliding_damping_ratio


def groups(stribeck: float, velocity: float, lag: float) -> DimensionlessGroups:
    return DimensionlessGroups(
        natural_frequency=1.0, damping_ratio=math.nan, stribeck=stribeck, velocity=velocity, lag=lag, rise_time=1.0
    )


def growth(ratio: float, stribeck: float, velocity: float, lag: float) -> float:
    """Amplitude of a small disturbance late over that before, Eq. (14) integrated by Heun's method."""
    step = min(0.01, lag / 8.0) if lag > 0 else 0.01
    delay = round(lag / step)
    level = stribeck / (1.0 + velocity**2)
    count = round(120.0 / step)
    speed = np.full(count + delay + 1, velocity)
    # At rest relative to the reference the spring carries the friction; a push of a thousandth disturbs it.
    place, speed[delay] = -level, velocity * 1.001

    def pull(position: float, velocity_now: float, lagged: float) -> float:
        return -position - 2.0 * ratio * (velocity_now - velocity) - stribeck / (1.0 + lagged**2)

    for index in range(delay, delay + count):
        now, lagged, following = speed[index], speed[index - delay], speed[index - delay + 1]
        first = pull(place, now, lagged)
        guess = now + step * first
        second = pull(place + step * (now - velocity), guess, following if delay else guess)
        place += 0.5 * step * ((now - velocity) + (guess - velocity))
        speed[index + 1] = now + 0.5 * step * (first + second)
    swings = np.abs(speed[delay:] - velocity)
    half = count // 2
    return float(swings[-half // 2 :].max() / swings[half // 4 : half].max())


@pytest.mark.parametrize(
    ("stribeck", "velocity", "lag"),
    [(1.0, 1.0, 0.0), (0.5, 0.5, 0.4), (1.5, 1.3, 0.9), (2.0, 2.0, 0.3), (0.6, 0.7, 2.5), (0.8, 1.0, 5.0)],
)
def test_disturbances_grow_below_and_decay_above(stribeck: float, velocity: float, lag: float) -> None:
    """Issue 5, item 1: above this damping ratio steady sliding is stable, below it is not."""
    critical = sliding_damping_ratio(groups(stribeck, velocity, lag))
    assert growth(critical + 0.03, stribeck, velocity, lag) < 0.9
    if critical > 0.03:
        assert growth(critical - 0.03, stribeck, velocity, lag) > 1.1


def test_limits() -> None:
    """Issue 5, item 1: half the slope without lag; nothing is needed without Stribeck friction; NaN out of range."""
    assert sliding_damping_ratio(groups(2.0, 1.5, 0.0)) == pytest.approx(3.0 / (1 + 2.25) ** 2)
    assert sliding_damping_ratio(groups(0.0, 1.5, 0.3)) == 0.0
    assert math.isnan(sliding_damping_ratio(groups(math.inf, 1.5, 0.3)))
