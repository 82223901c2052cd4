# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled stability of steady sliding, Eq. (14) made linear about the commanded speed: one equation with a delay.

With c the slope at which Stribeck friction falls with speed, a disturbance obeys ξ¨ + 2ρ ξ˙ − c ξ˙(T − τ*) + ξ = 0. It
neither grows nor decays at the frequencies ν with 1 − ν² = c ν sin(ν τ*), where 2ρ = c cos(ν τ*): the largest such ρ
is the least damping ratio with which every disturbance decays. Without lag it is ½ c.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, kernel

# Parts of the range of frequencies that are scanned, 1; parts for each radian of ν τ*.
_LOOKS, _LOOKS_A_RADIAN = 200.0, 20.0
_MOST_LOOKS = 1e6  # parts, 1: with more there is no answer
_BISECTIONS = 50  # bisections of a frequency, 1: to about the precision of a float


@helper()
def stable_ratio(slope, lag):
    """Damping ratio above which steady sliding is stable; ``slope`` by which friction falls with speed, not negative.

    NaN where an argument is not finite, or a lag so long that its frequencies are too many to be looked at.
    """
    if not (np.isfinite(slope) and np.isfinite(lag)):
        return np.nan
    if slope <= 0.0:
        return 0.0
    if lag == 0.0:
        return 0.5 * slope
    # |ν² − 1| <= c ν: every such frequency is within.
    fastest = 0.5 * (slope + np.sqrt(slope * slope + 4.0))
    slowest = 1.0 / fastest
    parts = np.ceil(_LOOKS + _LOOKS_A_RADIAN * (fastest - slowest) * lag)
    if parts > _MOST_LOOKS:
        return np.nan
    step = (fastest - slowest) / parts
    largest = 0.0
    low = slowest
    balance_low = low * low - 1.0 + slope * low * np.sin(low * lag)
    for part in range(int(parts)):
        high = slowest + (part + 1) * step
        balance_high = high * high - 1.0 + slope * high * np.sin(high * lag)
        if balance_low * balance_high <= 0.0:
            largest = max(largest, 0.5 * slope * np.cos(_crossing(low, high, balance_low, slope, lag) * lag))
        low, balance_low = high, balance_high
    return largest


@helper()
def _crossing(low, high, balance_low, slope, lag):
    """Frequency between two at which the balance changes its sign."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        balance = middle * middle - 1.0 + slope * middle * np.sin(middle * lag)
        if balance * balance_low > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel(nogil=True)
def stable_ratios(slopes, lags, found):
    """Fill ``found`` with :func:`stable_ratio` of every slope and lag."""
    for i in range(slopes.shape[0]):
        found[i] = stable_ratio(slopes[i], lags[i])
