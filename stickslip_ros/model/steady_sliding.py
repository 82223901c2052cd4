# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether steady sliding is stable: a joint that does not stick may still swing about its speed for ever.

Neither Eq. (43) nor the exact boundary covers it: both ask whether the joint comes to a stop. Linearised about the
desired speed, Eq. (14) with the Stribeck friction of a long rest is a linear equation with one delay.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.model._friction_law import LAWS, stribeck_slope
from stickslip_ros.model.dimensionless import DimensionlessGroups

_POINTS = 2000


def sliding_damping_ratio(groups: DimensionlessGroups) -> float:
    """Damping ratio above which steady sliding is stable against small disturbances; scalars only.

    With c the slope at which friction falls with speed, by the paper's law 2 F*_s∞ ξ˙_d / (1 + ξ˙_d²)², a disturbance
    obeys ξ¨ + 2ρ ξ˙ − c ξ˙(t − τ*) + ξ = 0. It neither grows nor decays at the frequencies ν with
    1 − ν² = c ν sin(ν τ*), where ρ = ½ c cos(ν τ*): the largest of these is the answer, without lag ½ c. A slip after a
    short rest has less Stribeck friction, and needs less.

    Returns
    -------
    The damping ratio, not negative; NaN where a group is not finite.
    """
    speed, lag = float(groups.velocity), float(groups.lag)
    slope = -float(stribeck_slope(LAWS[groups.law], float(groups.stribeck), speed))
    if not (math.isfinite(slope) and math.isfinite(lag)):
        return math.nan
    fastest = 0.5 * (slope + math.sqrt(slope * slope + 4.0))
    count = _POINTS + math.ceil(20.0 * fastest * lag)
    # |ν² − 1| <= c ν, within which every such frequency lies.
    frequencies = np.linspace(1.0 / fastest, fastest, count) if slope > 0 else np.ones(1)
    balance = frequencies**2 - 1.0 + slope * frequencies * np.sin(frequencies * lag)
    crossings = np.flatnonzero(balance[:-1] * balance[1:] <= 0)
    if len(crossings) == 0:
        crossings = np.array([int(np.argmin(np.abs(balance)))])
        shares = np.zeros(1)
    else:
        steps = balance[crossings + 1] - balance[crossings]
        shares = np.where(steps != 0, -balance[crossings] / np.where(steps != 0, steps, 1.0), 0.0)
    at = frequencies[crossings] + shares * (
        frequencies[np.minimum(crossings + 1, len(frequencies) - 1)] - frequencies[crossings]
    )
    return max(0.0, float(np.max(0.5 * slope * np.cos(at * lag))))
