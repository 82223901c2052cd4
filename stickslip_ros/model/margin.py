# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Verdict of Eq. (43) on a joint: margin, what would change the verdict, or why there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.bisection import bisected
from stickslip_ros.model.dimensionless import (
    STIFFNESS_DECADES,
    VELOCITY_DECADES,
    DimensionlessGroups,
    damping_for_ratio,
    damping_reserve,
    dimensionless_groups,
    stiffness_of_lag,
    stiffness_scale,
    unwrapped,
)
from stickslip_ros.model.extinction import critical_damping_ratio, energy_margin, reduction_factor, steady_stribeck
from stickslip_ros.model.friction import Gains, Joint, Real

_SCAN_POINTS = 400  # points of the scan, 1
_BISECTIONS = 52  # bisections, 1: to machine precision, as a float has 53 bits
_STIFF_CONTACT = 1000.0  # presliding stiffness, of k_p: above it presliding changes verdicts by 1 % or less


@dataclass(frozen=True, kw_only=True)
class StabilityMargin:
    """How far a joint is from smooth motion by Eq. (43).

    Every number is NaN where the equation does not apply, and ``reason`` then says why; scalars for
    scalar input, arrays (``reason`` an object array) for arrays.

    Attributes
    ----------
    applicable : whether Eq. (43) covers the case.
    reason : "not applicable, because …", or None.
    smooth : the verdict; False where not applicable.
    energy_margin : minus the left side of Eq. (43) [M x˙_s²]; positive means smooth.
    damping_ratio, critical_damping_ratio : ρ and the ρ_c at which the margin is zero.
    reduction_factor : h of Eq. (32).
    steady_stribeck : F_s,ss of Eq. (39) [N·m].
    natural_frequency : ω [rad/s].
    """

    applicable: bool | NDArray[np.bool_]
    reason: str | NDArray[np.object_] | None
    smooth: bool | NDArray[np.bool_]
    energy_margin: Real
    damping_ratio: Real
    critical_damping_ratio: Real
    reduction_factor: Real
    steady_stribeck: Real
    natural_frequency: Real

    @property
    def damping_reserve(self) -> Real:
        """ρ/ρ_c − 1: damping in excess of what Eq. (43) asks for; ∞ where it asks for none, NaN as the others."""
        return damping_reserve(self.damping_ratio, self.critical_damping_ratio)


def _reasons(joint: Joint, groups: DimensionlessGroups, gains: Gains, velocity: Real) -> NDArray[np.object_]:
    """Why Eq. (43) does not apply, element by element; None where it does. The last check listed wins."""
    shape = np.broadcast_shapes(
        *(np.shape(value) for value in groups.numbers),
        *(np.shape(value) for value in vars(gains).values()),
        np.shape(velocity),
    )
    reasons = np.full(shape, None, dtype=object)

    def mark(condition: bool | NDArray[np.bool_], text: str) -> None:
        reasons[np.broadcast_to(np.asarray(condition), shape)] = f"not applicable, because {text}"

    numbers = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in groups.numbers))
    mark(~np.all(np.isfinite(numbers), axis=0), "a gain is too small or too large to compute with")
    mark(np.asarray(groups.lag) > 2 * np.pi, "the lag is longer than one natural period (τ* > 2π)")
    mark(np.asarray(groups.damping_ratio) < 0, "the total damping is negative: the joint is unstable by itself")
    mark(np.asarray(gains.integral) != 0, "the controller has integral action")
    mark(np.asarray(velocity) == 0, "the commanded velocity is zero: the equation is about steady motion")
    mark(
        ~(np.asarray(gains.stiffness) > 0),
        "the stiffness is not positive: without stiffness (velocity control) there is no natural period",
    )
    if groups.law != PAPERS_LAW:
        mark(True, f"it is of the paper's friction law ({PAPERS_LAW}), and this joint's is {groups.law}")
    if joint.transmission is not None:
        mark(True, f"it is of a rigid joint, and this one has a resonance at {joint.transmission.resonance:.4g} Hz")
    soft = ~(np.asarray(joint.friction.presliding_stiffness) >= _STIFF_CONTACT * np.abs(np.asarray(gains.stiffness)))
    mark(
        soft, f"the contact gives way before it breaks: its presliding stiffness is below {_STIFF_CONTACT:g} times k_p"
    )
    finite = (
        np.isfinite(velocity) & np.isfinite(gains.stiffness) & np.isfinite(gains.damping) & np.isfinite(gains.integral)
    )
    mark(~np.asarray(finite), "a gain or the commanded velocity is not a finite number")
    return reasons


@np.errstate(all="ignore")  # controllers may hold any gains; what overflows comes out as not applicable
def stability_margin(joint: Joint, gains: Gains, velocity: Real) -> StabilityMargin:
    """Verdict of Eq. (43) on a joint under PD control moving at a commanded velocity.

    Parameters
    ----------
    joint, gains : the joint and its controller; their fields may be arrays.
    velocity : x˙_d [rad/s], scalar or array; the sign does not matter.

    Returns
    -------
    StabilityMargin, of the broadcast shape.
    """
    groups = dimensionless_groups(joint, gains, velocity)
    reasons = _reasons(joint, groups, gains, velocity)
    applicable: NDArray[np.bool_] = np.array([reason is None for reason in reasons.flat], dtype=np.bool_)
    applicable = applicable.reshape(reasons.shape)

    def where_applicable(value: Real) -> NDArray[np.float64]:
        return np.where(applicable, value, np.nan)

    margin = where_applicable(energy_margin(groups))
    force_unit = joint.inertia * groups.natural_frequency * joint.friction.stribeck_velocity
    fields = {
        "energy_margin": margin,
        "damping_ratio": where_applicable(groups.damping_ratio),
        "critical_damping_ratio": where_applicable(critical_damping_ratio(groups)),
        "reduction_factor": where_applicable(reduction_factor(groups.velocity, groups.lag)),
        "steady_stribeck": where_applicable(steady_stribeck(groups) * force_unit),
        "natural_frequency": where_applicable(groups.natural_frequency),
    }
    smooth = margin > 0
    if applicable.ndim == 0:
        return StabilityMargin(
            applicable=bool(applicable),
            reason=reasons.item(),
            smooth=bool(smooth),
            **{name: float(value) for name, value in fields.items()},
        )
    return StabilityMargin(applicable=applicable, reason=reasons, smooth=smooth, **fields)


def lowest_smooth_velocity(joint: Joint, gains: Gains) -> Real:
    """Speed [rad/s] from which on Eq. (43) predicts smooth motion at this and every higher speed.

    0 if every speed is smooth, infinite if no speed up to 1000 x˙_s is, NaN where the equation does
    not apply. Slower speeds may be smooth again: the boundary is not monotonic in velocity.
    """
    stribeck_velocity = np.asarray(joint.friction.stribeck_velocity, dtype=float)

    def margin_at(velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(stability_margin(joint, gains, velocity).energy_margin, dtype=float)

    shape = np.shape(dimensionless_groups(joint, gains, 1.0).stribeck)
    low, high = (np.broadcast_to(stribeck_velocity * 10.0**decade, shape) for decade in VELOCITY_DECADES)
    return _last_unsmooth(margin_at, low, high)


def least_smooth_stiffness(joint: Joint, velocity: Real, *, damping: Real = 0.0) -> Real:
    """Stiffness k_p [N·m/rad] from which on Eq. (43) predicts smooth motion, at a fixed damping k_v.

    0 if every stiffness is smooth; infinite if none is up to the end of the domain (τ* = 2π, or
    without lag eight decades above the stiffness M (F_s∞/(M x˙_s))²); NaN where not applicable.
    """
    own = stiffness_scale(joint)
    shape = np.broadcast_shapes(np.shape(own), np.shape(velocity), np.shape(damping), np.shape(joint.friction.lag))
    centre = np.broadcast_to(own, shape)
    limit = stiffness_of_lag(joint) * (1 - 1e-12)
    high = np.minimum(centre * 10.0**STIFFNESS_DECADES, limit)
    low = high * 10.0 ** (-2 * STIFFNESS_DECADES)

    def margin_at(stiffness: NDArray[np.float64]) -> NDArray[np.float64]:
        gains = Gains(stiffness=stiffness, damping=damping)
        return np.asarray(stability_margin(joint, gains, velocity).energy_margin, dtype=float)

    return _last_unsmooth(margin_at, low, high)


def change_factors(joint: Joint, gains: Gains, velocity: Real) -> dict[str, Real]:
    """Factors on k_p, k_v and x˙_d that bring the joint to the boundary of Eq. (43), each alone.

    Below 1 for a quantity that may still shrink. ``damping`` is NaN where k_v is zero (no factor
    helps) and negative where even k_v = 0 is smooth.
    """
    margin = stability_margin(joint, gains, velocity)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        needed = damping_for_ratio(joint, gains.stiffness, margin.critical_damping_ratio)
        damping = np.where(np.asarray(gains.damping) > 0, needed / np.asarray(gains.damping, dtype=float), np.nan)
        return {
            "stiffness": least_smooth_stiffness(joint, velocity, damping=gains.damping) / np.asarray(gains.stiffness),
            "damping": damping,
            "velocity": lowest_smooth_velocity(joint, gains) / np.abs(velocity),
        }


def _last_unsmooth(
    margin_at: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> Real:
    """Largest argument in [low, high] at which the margin is not positive, to machine precision.

    Scanned on a logarithmic grid first, because the margin may change sign several times, then
    bisected. 0 if the margin is positive throughout, infinite if it is not positive at ``high``.
    """
    fraction = np.linspace(0.0, 1.0, _SCAN_POINTS).reshape((-1,) + (1,) * np.ndim(low))
    grid = np.exp(np.log(low) + fraction * (np.log(high) - np.log(low)))
    margin = margin_at(grid)
    unsmooth = margin <= 0
    last = _SCAN_POINTS - 1 - np.argmax(unsmooth[::-1], axis=0)
    left = np.take_along_axis(grid, last[None], axis=0)[0]
    right = np.take_along_axis(grid, np.minimum(last + 1, _SCAN_POINTS - 1)[None], axis=0)[0]
    left, right = bisected(lambda middle: margin_at(middle) <= 0, left, right, _BISECTIONS)
    result = np.where(unsmooth.any(axis=0), right, 0.0)
    result = np.where(unsmooth[-1], np.inf, result)
    result = np.where(np.isnan(margin).any(axis=0), np.nan, result)
    return unwrapped(result)
