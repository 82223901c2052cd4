# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction of a joint, Eqs (1)-(6): Coulomb, viscous and Stribeck with memory, by the paper's law or another.

All quantities are in SI units of rotation; a prismatic joint uses N, N·s/m, m/s and kg through the
same code. Equation numbers are those of Armstrong-Hélouvry (1993).

`JOINT_PARAMETERS` and `PRESLIDING_PARAMETERS` are the one table of the parameters, and its order is the one order: a
vector of some of them, in a kernel or a fit, has them in the same sequence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._friction_law import (
    CONTACTS,
    ELASTO_PLASTIC,
    LAWS,
    PAPERS_LAW,
    risen_level,
    stribeck_friction,
)
from stickslip_ros.model._friction_law import Real as Real
from stickslip_ros.model._validation import require_not_negative, require_positive, require_positive_or_infinite
from stickslip_ros.model.transmission import Transmission as Transmission


@dataclass(frozen=True, kw_only=True)
class FrictionParameter:
    """Row of the table: a parameter of a joint and of its friction.

    The parameters of a joint whose gains are unknown are divided by its inertia, which then is 1.

    Attributes
    ----------
    name : field of :class:`Friction` or :class:`Joint`; key in files and in every output.
    unit, unit_per_inertia : for people; :func:`~stickslip_ros.model.units.in_ascii` makes keys of them.
    label : as tables for people have it. symbol : of the paper. help : as help texts of options have it, without unit.
    require : raises InvalidParameterError, with the name and the value, for a value out of bounds.
    """

    name: str
    unit: str
    unit_per_inertia: str
    label: str
    symbol: str
    help: str
    require: Callable[[str, ArrayLike], None]

    @property
    def is_force(self) -> bool:
        """Whether the parameter is divided by the inertia, where that is not known."""
        return self.name != "inertia" and self.unit != self.unit_per_inertia

    def unit_where(self, *, per_inertia: bool) -> str:
        """The unit of a value that is, or is not, per inertia."""
        return self.unit_per_inertia if per_inertia else self.unit


INERTIA = FrictionParameter(
    name="inertia", unit="kg·m²", unit_per_inertia="1", label="inertia", symbol="M", help="inertia",
    require=require_positive,
)  # fmt: skip
FRICTION_PARAMETERS = (
    FrictionParameter(
        name="coulomb", unit="N·m", unit_per_inertia="rad/s²", label="Coulomb friction", symbol="F_k",
        help="Coulomb friction F_k", require=require_not_negative,
    ),
    FrictionParameter(
        name="viscous", unit="N·m·s/rad", unit_per_inertia="1/s", label="viscous friction", symbol="F_v",
        help="viscous friction F_v", require=require_not_negative,
    ),
    FrictionParameter(
        name="stribeck", unit="N·m", unit_per_inertia="rad/s²", label="Stribeck friction after a long rest",
        symbol="F_s∞", help="F_s∞, static friction in excess of Coulomb friction", require=require_not_negative,
    ),
    FrictionParameter(
        name="stribeck_velocity", unit="rad/s", unit_per_inertia="rad/s", label="Stribeck velocity", symbol="x˙_s",
        help="Stribeck velocity", require=require_positive,
    ),
    FrictionParameter(
        name="lag", unit="s", unit_per_inertia="s", label="lag of friction (frictional memory)", symbol="τ_L",
        help="frictional memory τ_L", require=require_not_negative,
    ),
    FrictionParameter(
        name="rise_time", unit="s", unit_per_inertia="s", label="rise time of static friction", symbol="γ",
        help="rise time γ of static friction", require=require_not_negative,
    ),
)  # fmt: skip
JOINT_PARAMETERS = (INERTIA, *FRICTION_PARAMETERS)
PRESLIDING_PARAMETERS = (
    FrictionParameter(
        name="presliding_stiffness", unit="N·m/rad", unit_per_inertia="N·m/rad", label="presliding stiffness",
        symbol="σ₀", help="presliding stiffness σ₀ (default: infinite)", require=require_positive_or_infinite,
    ),
    FrictionParameter(
        name="presliding_damping", unit="N·m·s/rad", unit_per_inertia="N·m·s/rad", label="presliding damping",
        symbol="σ₁", help="presliding damping σ₁", require=require_not_negative,
    ),
)  # of a contact that is not rigid  # fmt: skip
_BY_NAME = {parameter.name: parameter for parameter in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS)}


def _unit(name: str) -> dict[str, str]:
    """Metadata of a field that is a parameter of the table."""
    return {"unit": _BY_NAME[name].unit}


@dataclass(frozen=True, kw_only=True)
class Friction:
    """A friction law and its parameters; each a float or an array (they broadcast together).

    Attributes
    ----------
    coulomb : F_k [N·m], kinetic friction; it cancels from every stability result.
    viscous : F_v [N·m·s/rad].
    stribeck : F_s∞ [N·m], Stribeck (excess static) friction after long contact.
    stribeck_velocity : x˙_s [rad/s], characteristic velocity of the Stribeck curve.
    lag : τ_L [s], frictional memory.
    rise_time : γ [s], characteristic time of the rise of static friction.
    law : how Stribeck friction falls with speed, Ψ of Eq. (5). "hess_soom", 1/(1 + (x˙/x˙_s)²) after Hess and Soom,
        is the paper's, and the only one that Eq. (43) holds for; "exponential" is exp(−(x˙/x˙_s)²).
    presliding_stiffness : σ₀ [N·m/rad], of the contact before it breaks away, see
        :mod:`stickslip_ros.model.joint_simulation`; infinite, as the paper has it, where a stuck joint does not move.
    presliding_damping : σ₁ [N·m·s/rad], of the contact's deflection.
    contact : how the contact yields: "elasto_plastic", elastic up to breakaway, or "lugre", ever more the closer to it.

    Raises
    ------
    InvalidParameterError
        If a value is not finite or negative, the Stribeck velocity or the presliding stiffness is zero, or a law or a
        contact is not known. An infinite presliding stiffness is none.
    """

    coulomb: Real = field(default=0.0, metadata=_unit("coulomb"))
    viscous: Real = field(default=0.0, metadata=_unit("viscous"))
    stribeck: Real = field(metadata=_unit("stribeck"))
    stribeck_velocity: Real = field(metadata=_unit("stribeck_velocity"))
    lag: Real = field(default=0.0, metadata=_unit("lag"))
    rise_time: Real = field(default=0.0, metadata=_unit("rise_time"))
    law: str = PAPERS_LAW
    presliding_stiffness: Real = field(default=math.inf, metadata=_unit("presliding_stiffness"))
    presliding_damping: Real = field(default=0.0, metadata=_unit("presliding_damping"))
    contact: str = ELASTO_PLASTIC

    def __post_init__(self) -> None:
        for parameter in (*FRICTION_PARAMETERS, *PRESLIDING_PARAMETERS):
            parameter.require(parameter.name, getattr(self, parameter.name))
        if not isinstance(self.law, str) or self.law not in LAWS:
            raise InvalidParameterError("law", f"one of {', '.join(LAWS)}", self.law)
        if not isinstance(self.contact, str) or self.contact not in CONTACTS:
            raise InvalidParameterError("contact", f"one of {', '.join(CONTACTS)}", self.contact)

    @property
    def numbers(self) -> dict[str, Real]:
        """The parameters by name; all but the law."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self) if "unit" in entry.metadata}

    def changed(self, numbers: Mapping[str, Real]) -> Friction:
        """The same law with other parameters, by name."""
        values: dict[str, Any] = dict(numbers)
        return replace(self, **values)

    @property
    def of_the_paper(self) -> bool:
        """Whether the law is the paper's, all of it: its Stribeck curve, and no presliding."""
        return self.law == PAPERS_LAW and self.rigid

    @property
    def law_in_words(self) -> str:
        """The law's name, with its contact where that is not rigid."""
        return self.law if self.rigid else f"{self.law} with presliding ({self.contact})"

    @property
    def rigid(self) -> bool:
        """Whether a stuck joint does not move at all."""
        return bool(np.isinf(self.presliding_stiffness).all())


@dataclass(frozen=True, kw_only=True)
class Joint:
    """A joint: its inertia and its friction, Eq. (4), and how late the controller's force acts on it.

    Attributes
    ----------
    inertia : M [kg·m²], float or array.
    friction : the friction law's parameters.
    transmission : spring between motor and load; None for a rigid joint.
    actuation_delay : τ_d [s], float or array, by which the force acts late; to the first order it takes k_p τ_d of the
        damping away. Where a controller's period is stated, that delays the force instead, see
        :class:`stickslip_ros.model.conditions.OperatingConditions`.

    Raises
    ------
    InvalidParameterError
        If the inertia is not finite and > 0, or the delay is not finite or negative, or a contact that creeps
        ("lugre") is given with a transmission.
    """

    inertia: Real = field(metadata=_unit("inertia"))
    friction: Friction
    transmission: Transmission | None = None
    actuation_delay: Real = field(default=0.0, metadata={"unit": "s"})

    def __post_init__(self) -> None:
        INERTIA.require("inertia", self.inertia)
        require_not_negative("actuation_delay", self.actuation_delay)
        if self.transmission is not None and not self.friction.rigid and self.friction.contact != ELASTO_PLASTIC:
            requirement = f"{ELASTO_PLASTIC} where there is a resonance"
            raise InvalidParameterError("contact", requirement, self.friction.contact)

    @property
    def numbers(self) -> dict[str, Real]:
        """All that a verdict may depend on, by name: inertia, the friction's parameters, the delay."""
        return {"inertia": self.inertia, **self.friction.numbers, "actuation_delay": self.actuation_delay}

    def own_damping(self, stiffness: Real) -> Real:
        """Damping beside the controller's k_v [N·m·s/rad]: viscous friction less what a delay takes, F_v − k_p τ_d.

        Parameters
        ----------
        stiffness : k_p [N·m/rad].
        """
        if not np.any(self.actuation_delay):
            return self.friction.viscous
        return np.asarray(self.friction.viscous - np.asarray(stiffness) * self.actuation_delay)

    def total_damping(self, gains: Gains) -> Real:
        """Damping of controller and joint together, k_v + F_v − k_p τ_d [N·m·s/rad]."""
        return gains.damping + self.own_damping(gains.stiffness)


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of the controller of Eq. (4), with the integral action that the paper leaves out.

    Any finite values are taken, since controllers hold any; whether Eq. (43) applies to them is
    answered by :func:`stickslip_ros.model.margin.stability_margin`.

    Attributes
    ----------
    stiffness : k_p [N·m/rad].
    damping : k_v [N·m·s/rad].
    integral : k_i [N·m/(rad·s)].
    """

    stiffness: Real = field(metadata={"unit": "N·m/rad"})
    damping: Real = field(default=0.0, metadata={"unit": "N·m·s/rad"})
    integral: Real = field(default=0.0, metadata={"unit": "N·m/(rad·s)"})


def stribeck_shape(lagged_velocity: Real, stribeck_velocity: Real, law: str = PAPERS_LAW) -> Real:
    """Ψ of Eq. (5) after the first τ_L of a slip, by a law of :class:`Friction`; dimensionless.

    By the paper's it is 1 / (1 + (x˙(t − τ_L)/x˙_s)²). During the first τ_L after breakaway Ψ is 1; the caller knows
    the time since breakaway and passes a lagged velocity of zero there. (Some printings show 1 + (…)²; the text has it
    right.)
    """
    return stribeck_friction(LAWS[law], 1.0, np.asarray(lagged_velocity) / stribeck_velocity)


def steady_friction(friction: Friction, velocity: Real) -> Real:
    """Friction in steady sliding, the Stribeck curve of Eqs (4) and (5) [N·m]; odd in velocity [rad/s]."""
    shape = stribeck_shape(velocity, friction.stribeck_velocity, friction.law)
    return np.sign(velocity) * (friction.coulomb + friction.stribeck * shape) + friction.viscous * velocity


def static_friction_level(friction: Friction, level_at_arrest: Real, dwell: Real) -> Real:
    """F_s,b of Eq. (6): Stribeck friction [N·m] after a dwell t₂ [s] that began at F_s,a [N·m].

    F_s,b = F_s,a + (F_s∞ − F_s,a) t₂/(t₂ + γ); with γ = 0 it is F_s∞ at once.
    """
    return risen_level(level_at_arrest, friction.stribeck, np.asarray(dwell, dtype=float), friction.rise_time)
