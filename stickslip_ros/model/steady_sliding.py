# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether steady sliding is stable against small disturbances, in closed form but for one equation of frequency.

It is a necessary condition, for a joint that has stood for long; :mod:`stickslip_ros.model.outcome` has the exact one.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.model import _stability_kernel as kernel
from stickslip_ros.model._friction_law import LAWS, stribeck_slope
from stickslip_ros.model.dimensionless import DimensionlessGroups, unwrapped
from stickslip_ros.model.friction import Real


def sliding_damping_ratio(groups: DimensionlessGroups) -> Real:
    """Damping ratio above which steady sliding is stable against small disturbances.

    Eq. (14) linearised about the commanded speed, with the Stribeck friction of a long rest, is a linear equation with
    one delay; with c the slope at which friction falls with speed, by the paper's law 2 F*_s∞ ξ˙_d / (1 + ξ˙_d²)², the
    answer is the largest ρ = ½ c cos(ν τ*) at the frequencies with 1 − ν² = c ν sin(ν τ*), and ½ c without lag. A slip
    after a short rest has less Stribeck friction, and needs less.

    Parameters
    ----------
    groups : scalars or arrays that broadcast; the damping ratio is not used.

    Returns
    -------
    The damping ratio, not negative; NaN where a group is not finite. Of the groups' common shape.
    """
    slopes, lags = np.broadcast_arrays(
        -np.asarray(stribeck_slope(LAWS[groups.law], groups.stribeck, groups.velocity), dtype=float),
        np.asarray(groups.lag, dtype=float),
    )
    found = np.empty(slopes.size)
    kernel.stable_ratios(slopes.ravel().astype(float), lags.ravel().astype(float), found)
    return unwrapped(found.reshape(slopes.shape))
