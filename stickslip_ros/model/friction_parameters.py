# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the parameters of friction are called, and in which units they are, wherever they are read or printed.

A joint whose gains are unknown is known per inertia: its inertia is 1, and forces have other units.
"""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_ros.model.friction import Friction, Joint
from stickslip_ros.model.units import unit_of


@dataclass(frozen=True, kw_only=True)
class FrictionParameter:
    """One parameter.

    Attributes
    ----------
    name : of the field of :class:`~stickslip_ros.model.friction.Friction`, in files and in every output.
    unit, unit_per_inertia : for people; :func:`~stickslip_ros.model.units.in_ascii` makes keys of them.
    label : as tables for people have it. symbol : of the paper. help : what options say of it, without the unit.
    """

    name: str
    unit: str
    unit_per_inertia: str
    label: str
    symbol: str
    help: str

    @property
    def is_force(self) -> bool:
        """Whether it is divided by the inertia, where that is not known."""
        return self.name != "inertia" and self.unit != self.unit_per_inertia

    def unit_where(self, *, per_inertia: bool) -> str:
        """The unit of a value that is, or is not, per inertia."""
        return self.unit_per_inertia if per_inertia else self.unit


def _of_friction(name: str, label: str, symbol: str, text: str, per_inertia: str = "") -> FrictionParameter:
    unit = unit_of(Friction, name)
    return FrictionParameter(
        name=name, unit=unit, unit_per_inertia=per_inertia or unit, label=label, symbol=symbol, help=text
    )


FRICTION_PARAMETERS = (
    _of_friction("coulomb", "Coulomb friction", "F_k", "Coulomb friction F_k", "rad/s²"),
    _of_friction("viscous", "viscous friction", "F_v", "viscous friction F_v", "1/s"),
    _of_friction(
        "stribeck",
        "Stribeck friction after a long rest",
        "F_s∞",
        "F_s∞, static friction in excess of Coulomb friction",
        "rad/s²",
    ),
    _of_friction("stribeck_velocity", "Stribeck velocity", "x˙_s", "Stribeck velocity"),
    _of_friction("lag", "lag of friction (frictional memory)", "τ_L", "frictional memory τ_L"),
    _of_friction("rise_time", "rise time of static friction", "γ", "rise time γ of static friction"),
)
INERTIA = FrictionParameter(
    name="inertia", unit=unit_of(Joint, "inertia"), unit_per_inertia="1", label="inertia", symbol="M", help="inertia"
)
JOINT_PARAMETERS = (INERTIA, *FRICTION_PARAMETERS)
PRESLIDING_PARAMETERS = (
    _of_friction("presliding_stiffness", "presliding stiffness", "σ₀", "presliding stiffness σ₀ (default: infinite)"),
    _of_friction("presliding_damping", "presliding damping", "σ₁", "presliding damping σ₁"),
)  # where a joint at rest is not held rigidly
