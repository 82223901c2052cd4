# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction law of the paper, Eqs (1)-(6): Coulomb, viscous and Stribeck with memory.

All quantities are in SI units of rotation; a prismatic joint uses N, N·s/m, m/s and kg through the
same code. Equation numbers are those of Armstrong-Hélouvry (1993).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._validation import require_not_negative, require_positive

Real = float | NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Parameters of the friction law; each a float or an array (they broadcast together).

    Attributes
    ----------
    stribeck : F_s∞ [N·m], Stribeck (excess static) friction after long contact.
    stribeck_velocity : x˙_s [rad/s], characteristic velocity of the Stribeck curve.
    lag : τ_L [s], frictional memory.
    rise_time : γ [s], characteristic time of the rise of static friction.
    viscous : F_v [N·m·s/rad].
    coulomb : F_k [N·m], kinetic friction; it cancels from every stability result.

    Raises
    ------
    InvalidParameterError
        If a value is not finite or negative, or the Stribeck velocity is zero.
    """

    stribeck: Real = field(metadata={"unit": "N·m"})
    stribeck_velocity: Real = field(metadata={"unit": "rad/s"})
    lag: Real = field(default=0.0, metadata={"unit": "s"})
    rise_time: Real = field(default=0.0, metadata={"unit": "s"})
    viscous: Real = field(default=0.0, metadata={"unit": "N·m·s/rad"})
    coulomb: Real = field(default=0.0, metadata={"unit": "N·m"})

    def __post_init__(self) -> None:
        require_positive("stribeck_velocity", self.stribeck_velocity)
        for name in ("stribeck", "lag", "rise_time", "viscous", "coulomb"):
            require_not_negative(name, getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint: its inertia and its friction, Eq. (4).

    Attributes
    ----------
    inertia : M [kg·m²], float or array.
    friction : the friction law's parameters.

    Raises
    ------
    InvalidParameterError
        If the inertia is not finite and > 0.
    """

    inertia: Real = field(metadata={"unit": "kg·m²"})
    friction: Friction

    def __post_init__(self) -> None:
        require_positive("inertia", self.inertia)


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of the controller of Eq. (4), with the integral action that the paper leaves out.

    Any finite values are taken, since controllers hold any; whether Eq. (43) applies to them is
    answered by :func:`stickslip_ros.model.extinction.stability_margin`.

    Attributes
    ----------
    stiffness : k_p [N·m/rad].
    damping : k_v [N·m·s/rad].
    integral : k_i [N·m/(rad·s)].
    """

    stiffness: Real = field(metadata={"unit": "N·m/rad"})
    damping: Real = field(default=0.0, metadata={"unit": "N·m·s/rad"})
    integral: Real = field(default=0.0, metadata={"unit": "N·m/(rad·s)"})


def stribeck_shape(lagged_velocity: Real, stribeck_velocity: Real) -> Real:
    """Ψ of Eq. (5) after the first τ_L of a slip: 1 / (1 + (x˙(t − τ_L)/x˙_s)²), dimensionless.

    During the first τ_L after breakaway Ψ is 1; the caller knows the time since breakaway and
    passes a lagged velocity of zero there. (Some printings show 1 + (…)²; the text has it right.)
    """
    ratio = np.asarray(lagged_velocity) / stribeck_velocity
    return 1.0 / (1.0 + ratio * ratio)


def steady_friction(friction: Friction, velocity: Real) -> Real:
    """Friction in steady sliding, the Stribeck curve of Eqs (4) and (5) [N·m]; odd in velocity [rad/s]."""
    shape = stribeck_shape(velocity, friction.stribeck_velocity)
    return np.sign(velocity) * (friction.coulomb + friction.stribeck * shape) + friction.viscous * velocity


def static_friction_level(friction: Friction, level_at_arrest: Real, dwell: Real) -> Real:
    """F_s,b of Eq. (6): Stribeck friction [N·m] after a dwell t₂ [s] that began at F_s,a [N·m].

    F_s,b = F_s,a + (F_s∞ − F_s,a) t₂/(t₂ + γ); with γ = 0 it is F_s∞ at once.
    """
    total = np.asarray(dwell, dtype=float) + friction.rise_time
    with np.errstate(invalid="ignore", divide="ignore"):
        risen = np.where(total > 0, dwell / total, 1.0)
    return level_at_arrest + (friction.stribeck - level_at_arrest) * risen
