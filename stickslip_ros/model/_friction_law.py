# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The one place of the friction law's formulas: Ψ of Eq. (5) for each law known, its slope, and Eq. (6).

Plain functions of floats, which numpy takes arrays through, and which the kernels have compiled by ``inlined`` of
:mod:`stickslip_ros.compilation`; they call each other nowhere, since compiled code could not. A further law is a number
and a name here, and a branch in each of the first three. :mod:`stickslip_ros.model.friction` is the face of it.

Velocities are in units of the Stribeck velocity. ``law`` is one of the numbers below, for compiled code knows no names.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import TINY

Real = float | NDArray[np.float64]

HESS_SOOM, EXPONENTIAL = range(2)
LAWS = {"hess_soom": HESS_SOOM, "exponential": EXPONENTIAL}
PAPERS_LAW = "hess_soom"
ELASTO_PLASTIC = "elasto_plastic"
RIGID, YIELDING, CREEPING = range(3)
LUGRE = "lugre"
CONTACTS = {ELASTO_PLASTIC: YIELDING, LUGRE: CREEPING}  # where they are not rigid


def stribeck_friction(law: float, level: Real, velocity: Real) -> Real:
    """Stribeck friction at a lagged velocity where static friction stood at ``level``: the level times Ψ of Eq. (5).

    Ψ is 1/(1 + v²) after Hess and Soom, exp(−v²) after Bo and Pavelescu, with the exponent 2; at level 1 it is Ψ.
    """
    if law == EXPONENTIAL:
        return level * np.exp(-(velocity * velocity))
    return level / (1.0 + velocity * velocity)


def stribeck_slope(law: float, level: Real, velocity: Real) -> Real:
    """Slope of :func:`stribeck_friction` by the velocity: not positive where that is not negative."""
    if law == EXPONENTIAL:
        return -2.0 * level * velocity * np.exp(-(velocity * velocity))
    return -2.0 * level * velocity / (1.0 + velocity * velocity) ** 2


def fallen_share(law: float, velocity: Real) -> Real:
    """1 − Ψ, with all its digits where Ψ is close to 1."""
    square = velocity * velocity
    if law == EXPONENTIAL:
        return -np.expm1(-square)
    return square / (1.0 + square)


def risen_level(level: Real, stribeck: Real, dwell: Real, rise_time: Real) -> Real:
    """F_s,b of Eq. (6): what F_s,a = ``level`` has become after a dwell t₂ on its way to F_s∞ = ``stribeck``.

    F_s,a + (F_s∞ − F_s,a) t₂/(t₂ + γ), all of it at once without a rise time. From 0 to 1 it is the share of the rise.
    """
    at_once = TINY * (rise_time == 0.0)
    return level + (stribeck - level) * (dwell + at_once) / (dwell + rise_time + TINY)


def rising_rate(dwell: Real, rise_time: Real) -> Real:
    """Slope of the share of the rise of Eq. (6) by the dwell; by the logarithm of γ it is −t₂ times this."""
    return rise_time / (dwell + rise_time) ** 2


def dwell_until_met(deficit: float, missing: float, rate: float, rise_time: float) -> float:
    """Dwell after which a force that grows at ``rate`` meets the level of Eq. (6): a quadratic equation.

    Parameters
    ----------
    deficit : the force at arrest less the level then, not positive. missing : F_s∞ less that level.
    """
    if np.isinf(rise_time):
        return -deficit / rate
    half = 0.5 * (deficit + rate * rise_time - missing)
    product = -deficit * rise_time * rate
    root = np.sqrt(half * half + product)
    dwell: float = -deficit * rise_time / (half + root) if half > 0.0 else (root - half) / rate
    return dwell
