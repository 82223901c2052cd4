# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The paper's condition for smooth motion, Eqs (19)-(43).

The condition integrates the work of friction along the unperturbed circle; it is an approximation.
Functions of dimensionless numbers take scalars or arrays that broadcast, and answer NaN outside
their domain, which is of the paper's friction law alone; :mod:`stickslip_ros.model.margin` gives the
verdict together with the reason.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.dimensionless import DimensionlessGroups, unwrapped
from stickslip_ros.model.friction import Friction, Joint, Real

# Below this velocity the closed form of Eq. (27) cancels digits (it divides by the velocity), and
# its power series in (2 ξ˙_d)² converges to machine precision in the terms below.
_SERIES_BELOW = 0.05
_SERIES_TERMS = 9  # terms of the power series, 1


def work_integral(velocity: Real, lag: Real) -> Real:
    """I(ξ˙_d, τ*) of Eq. (27), dimensionless, in closed form.

    I = sin τ* + ∫ from τ* to 2π of cos t / (ξ˙_d² (1 − cos(t − τ*))² + 1) dt: the work that the
    velocity-dependent friction does along one unperturbed cycle, per unit of Stribeck friction.

    Parameters
    ----------
    velocity : ξ˙_d >= 0; zero gives the limit, which is 0.
    lag : τ*, 0 <= τ* <= 2π.

    Returns
    -------
    float or array of the broadcast shape; NaN outside the domain.

    Notes
    -----
    The paper says that no closed form exists. With t = u + τ* and 1/(1 + a²w²) = Re 1/(1 + iaw),
    w = 1 − cos u, the integral is elementary; the branch of the arctangent changes at τ* = π.
    """
    velocity_array, lag_array = np.broadcast_arrays(np.asarray(velocity, float), np.asarray(lag, float))
    valid = (velocity_array >= 0) & np.isfinite(velocity_array) & (lag_array >= 0) & (lag_array <= 2 * np.pi)
    small = valid & (velocity_array < _SERIES_BELOW)
    if not small.any() and valid.all():
        return unwrapped(_closed_form(velocity_array, lag_array))
    result = np.full(velocity_array.shape, np.nan)
    large = valid & ~small
    result[large] = _closed_form(velocity_array[large], lag_array[large])
    result[small] = _series(velocity_array[small], lag_array[small])
    return unwrapped(result)


def _closed_form(velocity: NDArray[np.float64], lag: NDArray[np.float64]) -> NDArray[np.float64]:
    cosine, sine = np.cos(lag), np.sin(lag)
    root = np.sqrt(1.0 + 2j * velocity)
    # tan(π/2) is large and finite in floating point, so τ* = π needs no case of its own.
    angle = np.where(lag <= np.pi, np.pi, 0.0) - np.arctan(root * np.tan(0.5 * lag))
    integral = 2.0 * angle / root
    even = integral.real + integral.imag / velocity
    odd = np.arctan(velocity * (1.0 - cosine)) / velocity
    return np.asarray(sine + cosine * even - sine * odd)


def _series(velocity: NDArray[np.float64], lag: NDArray[np.float64]) -> NDArray[np.float64]:
    """Power series of Eq. (27) in velocity²: term n is (−a²)^n ∫ cos t · w^{2n} dt, exact by recursion."""
    half = np.pi - 0.5 * lag
    sine_half, cosine_half = np.sin(half), np.cos(half)
    versine = 1.0 - np.cos(lag)
    # ∫ w^k du = 2^{k+1} ∫ sin^{2k} over [0, φ/2], by the usual reduction of the power.
    powers = [2.0 * half]
    sine_power = half
    for k in range(1, 2 * _SERIES_TERMS + 2):
        sine_power = ((2 * k - 1) * sine_power - sine_half ** (2 * k - 1) * cosine_half) / (2 * k)
        powers.append(2.0 ** (k + 1) * sine_power)
    total = np.zeros_like(velocity)
    # n = 0 cancels sin τ* exactly.
    for n in range(1, _SERIES_TERMS + 1):
        even = np.cos(lag) * (powers[2 * n] - powers[2 * n + 1])
        odd = np.sin(lag) * versine ** (2 * n + 1) / (2 * n + 1)
        total += (-(velocity**2)) ** n * (even - odd)
    return total


def reduction_factor(velocity: Real, lag: Real) -> Real:
    """H of Eq. (32), between 0 and 1: the share of the Stribeck friction gone at the moment of arrest.

    h = ξ˙_d²(1 − cos τ*)² / (ξ˙_d²(1 − cos τ*)² + 1). Without lag it is 0: friction arrives at rest
    fully risen. (34) is its limit for small τ* and small velocity.
    """
    with np.errstate(invalid="ignore"):
        term = np.square(velocity * (1.0 - np.cos(lag)))
        return unwrapped(np.asarray(term / (term + 1.0)))


def approximate_reduction_factor(velocity: Real, lag: Real) -> Real:
    """H of Eq. (34), for short lag: ¼ ξ˙_d² τ*⁴, at most 1 (the print's constant is wrong)."""
    return unwrapped(np.asarray(np.minimum(0.25 * np.square(velocity) * np.power(lag, 4), 1.0)))


def steady_stribeck(groups: DimensionlessGroups, *, rises_from_coulomb: bool = False) -> Real:
    """F*_s,ss of Eq. (39), dimensionless: Stribeck friction at breakaway in a settled cycle.

    F_s,ss = F_s∞ − ½ h k_p x˙_d γ. May be negative: then static friction has no time to rise, Eq. (40).

    Parameters
    ----------
    groups : the joint's dimensionless numbers.
    rises_from_coulomb : take h = 1, static friction rising from the Coulomb level after every
        arrest whatever the lag; the assumption behind Fig. 12, where τ_L = 0.
    """
    factor = 1.0 if rises_from_coulomb else reduction_factor(groups.velocity, groups.lag)
    domain = 1.0 if groups.law == PAPERS_LAW else np.nan
    return unwrapped(np.asarray(groups.stribeck - 0.5 * factor * groups.velocity * groups.rise_time * domain))


def friction_work(groups: DimensionlessGroups, *, rises_from_coulomb: bool = False) -> Real:
    """Energy that friction feeds into the oscillation per cycle, in units of M x˙_s²; Eq. (43).

    F*_ss ξ˙_d I + ½ (F*_ss ξ˙_d²/(1 + ξ˙_d²))², zero where F*_ss <= 0, Eq. (40).
    """
    level = np.maximum(steady_stribeck(groups, rises_from_coulomb=rises_from_coulomb), 0.0)
    velocity_squared = np.square(groups.velocity)
    jump = level * velocity_squared / (1.0 + velocity_squared)
    # Of a spring that is next to none it may be larger than any number.
    with np.errstate(over="ignore"):
        work = level * groups.velocity * work_integral(groups.velocity, groups.lag) + 0.5 * jump * jump
    return unwrapped(np.asarray(work))


def energy_margin(groups: DimensionlessGroups, *, rises_from_coulomb: bool = False) -> Real:
    """Minus the left side of Eq. (43), in units of M x˙_s²; positive means smooth.

    2πρ ξ˙_d² is what damping takes out of a cycle, :func:`friction_work` what friction puts in.
    NaN outside the domain (zero velocity, no stiffness, τ* > 2π).
    """
    taken = 2.0 * np.pi * groups.damping_ratio * np.square(groups.velocity)
    margin = taken - friction_work(groups, rises_from_coulomb=rises_from_coulomb)
    return unwrapped(np.where(np.asarray(groups.velocity) > 0, margin, np.nan))


def critical_damping_ratio(groups: DimensionlessGroups) -> Real:
    """ρ_c at which the margin of Eq. (43) is zero; 0 where the motion is smooth without any damping."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = friction_work(groups) / (2.0 * np.pi * np.square(groups.velocity))
    return unwrapped(np.where(np.asarray(groups.velocity) > 0, np.maximum(ratio, 0.0), np.nan))


def stiffness_velocity_product(joint: Joint) -> Real:
    """Eq. (41): k_p x˙_d [N·m/s] from which on static friction has no time to rise (sufficient for smooth).

    2F_s∞/γ where h = 1, else the cube root that follows from (39) with (34), continuous with the first
    case. (Some printings show a square root.) Infinite without rise time or, where h = 1 is not
    reached, without lag.
    """
    friction: Friction = joint.friction
    with np.errstate(divide="ignore", invalid="ignore"):
        full = 2.0 * np.divide(friction.stribeck, friction.rise_time)
        saturation = 2.0 * joint.inertia * friction.stribeck_velocity / np.square(friction.lag)
        partial = np.cbrt(full * np.square(saturation))
    return unwrapped(np.where(full >= saturation, full, partial))
