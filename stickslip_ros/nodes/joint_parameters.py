# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The per-joint parameters of the monitor: what is known of a joint, its gains, limits, the advice."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.known_joints import load_joint
from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice import AdviceLimits

FRICTION_UNITS = {
    "coulomb": "N*m",
    "viscous": "N*m*s/rad",
    "stribeck": "N*m",
    "stribeck_velocity": "rad/s",
    "lag": "s",
    "rise_time": "s",
}
GAIN_UNITS = {"p": "N*m/rad", "i": "N*m/(rad*s)", "d": "N*m*s/rad"}
RECOMMENDED = {"p": "stiffness", "d": "damping"}
_NOT_SET = math.nan


@dataclass(frozen=True, kw_only=True)
class JointSettings:
    """What the parameters say of one joint; None for what they leave open."""

    joint: Joint | None
    gains: Gains | None
    limits: AdviceLimits
    conditions: Conditions


def declare(node: Node, name: str) -> None:
    """Declare one joint's parameters; whatever is not set stays open (NaN or empty)."""

    def number(parameter: str, unit: str, text: str, *, default: float = _NOT_SET) -> None:
        node.declare_parameter(parameter, default, ParameterDescriptor(description=f"{text} [{unit}]; nan: not set"))

    node.declare_parameter(
        f"model.{name}",
        "",
        ParameterDescriptor(
            description="known joint (config/joints) or path of a joint file (.yaml); empty: none", read_only=True
        ),
    )
    number(f"inertia.{name}", "kg*m^2", "inertia; overrides the model's")
    for key, unit in FRICTION_UNITS.items():
        number(f"friction.{name}.{key}", unit, f"{key.replace('_', ' ')}; overrides the model's")
    for key, unit in GAIN_UNITS.items():
        number(f"gains.{name}.{key}", unit, "gain of the controller, used until one is heard from")
    for key, unit in (("p", GAIN_UNITS["p"]), ("d", GAIN_UNITS["d"])):
        number(f"limits.{name}.{key}_min", unit, "least gain to recommend", default=0.0)
        number(f"limits.{name}.{key}_max", unit, "largest gain to recommend", default=math.inf)
    number(f"load.{name}", "N*m", "constant torque against the controller, for the exact verdict", default=0.0)
    number(f"controller_period.{name}", "s", "for the exact verdict; 0: continuous control", default=0.0)
    node.declare_parameter(
        f"control_delay.{name}",
        False,
        ParameterDescriptor(description="whether the effort takes effect one controller period late"),
    )
    for key, word in RECOMMENDED.items():
        node.declare_parameter(
            f"recommended.{name}.{key}",
            _NOT_SET,
            ParameterDescriptor(
                description=f"recommended {word} [{GAIN_UNITS[key]}]; written by the monitor alone; nan: no advice"
            ),
        )


def read(node: Node, name: str, changes: dict[str, Parameter] | None = None) -> JointSettings:
    """Read one joint's parameters, as they would be after the changes.

    Raises
    ------
    StickSlipError
        If they make no joint; the text names the value.
    """
    changes = changes or {}

    def value(parameter: str) -> float:
        changed = changes.get(parameter)
        return float(changed.value if changed is not None else node.get_parameter(parameter).value)

    model = node.get_parameter(f"model.{name}").value
    known = load_joint(model) if model else None
    inertia = value(f"inertia.{name}")
    friction = {key: value(f"friction.{name}.{key}") for key in FRICTION_UNITS}
    given = {key: number for key, number in friction.items() if not math.isnan(number)}
    joint = None
    if known is not None:
        base = {key: getattr(known.joint.friction, key) for key in FRICTION_UNITS}
        joint = Joint(
            inertia=known.joint.inertia if math.isnan(inertia) else inertia, friction=Friction(**{**base, **given})
        )
    elif not math.isnan(inertia) and {"stribeck", "stribeck_velocity"} <= set(given):
        joint = Joint(inertia=inertia, friction=Friction(**given))
    p, i, d = (value(f"gains.{name}.{key}") for key in ("p", "i", "d"))
    gains = None
    if not math.isnan(p):
        gains = Gains(stiffness=p, damping=0.0 if math.isnan(d) else d, integral=0.0 if math.isnan(i) else i)
    limits = AdviceLimits(
        wanted_margin=value("wanted_margin"),
        confidence=value("confidence"),
        stiffness_range=(value(f"limits.{name}.p_min"), value(f"limits.{name}.p_max")),
        damping_range=(value(f"limits.{name}.d_min"), value(f"limits.{name}.d_max")),
    )
    conditions = Conditions(
        load=value(f"load.{name}"),
        controller_period=value(f"controller_period.{name}"),
        control_delay=bool(value(f"control_delay.{name}")),
    )
    return JointSettings(joint=joint, gains=gains, limits=limits, conditions=conditions)
