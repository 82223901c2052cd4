# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Dimensionless form of the joint, Eqs (7)-(18): five numbers describe every such joint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import PAPERS_LAW
from stickslip_ros.model.friction import Gains, Joint, Real

VELOCITY_DECADES = (-3.0, 3.0)  # log10 of speed over x˙_s, 1: range in which the lowest smooth speed is searched
STIFFNESS_DECADES = 8.0  # log10 of stiffness over `stiffness_scale`, 1: to there the least smooth one is searched
_LEAST_STRIBECK = 1e-9  # Stribeck friction, N·m: without any there would be no scale


@dataclass(frozen=True, kw_only=True)
class DimensionlessGroups:
    """The five dimensionless numbers, the frequency that turns them back into SI units, and the friction law.

    Attributes
    ----------
    natural_frequency : ω = √(k_p/M) [rad/s], Eq. (9).
    damping_ratio : ρ = (k_v + F_v)/(2√(k_p M)), less what an actuation delay takes off. (The nomenclature prints
        ρ = k'_v/2ω, without the mass; Eq. (14) has it right.)
    stribeck : F*_s∞ = F_s∞/(M ω x˙_s).
    velocity : ξ˙_d = |x˙_d|/x˙_s; both directions are alike.
    lag : τ* = ω τ_L.
    rise_time : γ* = ω γ.
    law : one for all points, by its name in :class:`stickslip_ros.model.friction.Friction`.
    """

    natural_frequency: Real
    damping_ratio: Real
    stribeck: Real
    velocity: Real
    lag: Real
    rise_time: Real
    law: str = PAPERS_LAW

    @property
    def numbers(self) -> tuple[Real, ...]:
        """All but the law."""
        return (self.natural_frequency, self.damping_ratio, self.stribeck, self.velocity, self.lag, self.rise_time)

    @property
    def undamped(self) -> DimensionlessGroups:
        """The same without damping; the natural frequency is of no use then."""
        return replace(self, natural_frequency=np.nan, damping_ratio=np.zeros(np.shape(self.damping_ratio)))


def dimensionless_groups(joint: Joint, gains: Gains, velocity: Real) -> DimensionlessGroups:
    """Dimensionless numbers of a joint under PD control at a commanded velocity [rad/s], Eqs (9)-(16).

    Parameters broadcast. Where the stiffness is not positive there is no natural period, and every
    group that needs one is NaN.
    """
    friction = joint.friction
    stiffness = np.asarray(gains.stiffness, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        natural_frequency = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / joint.inertia)
        momentum = joint.inertia * natural_frequency
        return DimensionlessGroups(
            natural_frequency=natural_frequency,
            damping_ratio=joint.total_damping(gains) / (2.0 * momentum),
            stribeck=friction.stribeck / (momentum * friction.stribeck_velocity),
            velocity=np.abs(velocity) / friction.stribeck_velocity,
            lag=natural_frequency * friction.lag,
            rise_time=natural_frequency * friction.rise_time,
            law=friction.law,
        )


def stiffness_scale(joint: Joint) -> Real:
    """k_p [N·m/rad] at which F*_s∞ = 1: M (F_s∞/(M x˙_s))², around which boundaries are looked for."""
    frequency = np.maximum(np.asarray(joint.friction.stribeck, dtype=float), _LEAST_STRIBECK) / (
        joint.inertia * np.asarray(joint.friction.stribeck_velocity)
    )
    return np.asarray(joint.inertia * frequency * frequency)


def stiffness_of_lag(joint: Joint) -> Real:
    """k_p [N·m/rad] at which the lag is a natural period, τ* = 2π; infinite without lag."""
    with np.errstate(divide="ignore", over="ignore"):
        return np.asarray(joint.inertia * np.square(2 * np.pi / np.asarray(joint.friction.lag, dtype=float)))


def damping_for_ratio(joint: Joint, stiffness: Real, damping_ratio: Real) -> Real:
    """k_v [N·m·s/rad] that gives a damping ratio, the inverse of the second group: 2ρ√(k_p M) − F_v."""
    return 2.0 * damping_ratio * np.sqrt(stiffness * np.asarray(joint.inertia)) - joint.own_damping(stiffness)


def damping_reserve(damping_ratio: Real, critical_damping_ratio: Real) -> Real:
    """ρ/ρ_c − 1: damping in excess of what is asked for; ∞ where none is, NaN where either is unknown."""
    damping, critical = np.asarray(damping_ratio), np.asarray(critical_damping_ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        reserve = np.where(critical > 0, damping / critical - 1.0, np.where(np.isnan(critical), np.nan, np.inf))
    return unwrapped(reserve)


def dimensionless_energy(position: Real, velocity: Real) -> Real:
    """E* = ½(ξ² + ξ˙²) of Eq. (18), relative to the reference; an energy in units of M x˙_s²."""
    return 0.5 * (np.square(position) + np.square(velocity))


def unwrapped(array: NDArray[np.float64]) -> Real:
    """A 0-d array as a float, so that scalars in give scalars out; others as they are."""
    return float(array) if array.ndim == 0 else array
