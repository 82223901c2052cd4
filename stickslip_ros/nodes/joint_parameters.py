# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The per-joint parameters of the monitor: what is known of a joint, its gains, limits, the advice.

Gains, their limits and the advice are in the controller's units, of which one is `gain_scale` in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.known_joints import load_joint
from stickslip_ros.model._validation import require_positive
from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice_limits import AdviceLimits, Condition

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

Choice = TypeVar("Choice", bound=Enum)


@dataclass(frozen=True, kw_only=True)
class JointSettings:
    """What the parameters say of one joint, in SI units; None for what they leave open.

    Attributes
    ----------
    trial : gains on trial. gain_scale : SI units in one unit of the controller's gains; effort_scale : N·m in one
        unit of the effort in joint states.
    """

    joint: Joint | None
    gains: Gains | None
    limits: AdviceLimits
    conditions: Conditions
    trial: Gains | None
    gain_scale: float
    effort_scale: float

    def to_si(self, gains: Gains) -> Gains:
        """Gains of the controller in SI units."""
        return _scaled(gains, self.gain_scale)

    def from_si(self, gains: Gains) -> Gains:
        """Gains in the controller's units."""
        return _scaled(gains, 1.0 / self.gain_scale)


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
    for key, word in RECOMMENDED.items():
        unit = GAIN_UNITS[key]
        number(f"trial.{name}.{key}", unit, f"{word} on trial: its margin is published, and nothing is set")
        number(f"limits.{name}.{key}_min", unit, "least gain to recommend", default=0.0)
        number(f"limits.{name}.{key}_max", unit, "largest gain to recommend", default=math.inf)
    least, largest = AdviceLimits().damping_ratio_range
    number(f"limits.{name}.damping_ratio_min", "1", "least damping ratio to recommend", default=least)
    number(f"limits.{name}.damping_ratio_max", "1", "largest damping ratio to recommend", default=largest)
    number(f"limits.{name}.bandwidth", "rad/s", "largest crossover frequency to recommend", default=math.inf)
    number(f"limits.{name}.effort", "N*m", "largest effort that advised gains may ask for now", default=math.inf)
    number(
        f"slowest_velocity.{name}", "rad/s", "the joint shall be smooth from this speed on, instead of at the present"
    )
    number(f"gain_scale.{name}", "1", "N*m/rad in one unit of the controller's p, and so on for d", default=1.0)
    number(f"effort_scale.{name}", "1", "N*m in one unit of the effort in joint states", default=1.0)
    number(f"load.{name}", "N*m", "constant torque against the controller, for the exact verdict", default=0.0)
    number(f"controller_period.{name}", "s", "of a sampled controller; 0: continuous, or not known", default=0.0)
    node.declare_parameter(
        f"control_delay.{name}",
        False,
        ParameterDescriptor(description="whether the effort takes effect one controller period late"),
    )
    for key in RECOMMENDED:
        node.declare_parameter(recommended_name(name, key), _NOT_SET, _recommended_descriptor(node, name, key))


def recommended_name(name: str, key: str) -> str:
    """Name of the parameter that holds the advice."""
    return f"recommended.{name}.{key}"


def describe_recommended(node: Node, name: str) -> None:
    """Let the advice's descriptors say the present limits."""
    for key in RECOMMENDED:
        node.set_descriptor(recommended_name(name, key), _recommended_descriptor(node, name, key))


def _recommended_descriptor(node: Node, name: str, key: str) -> ParameterDescriptor:
    least, largest = (node.get_parameter(f"limits.{name}.{key}_{end}").value for end in ("min", "max"))
    # A floating_point_range would forbid nan, which says that there is no advice.
    return ParameterDescriptor(
        name=recommended_name(name, key),
        type=ParameterType.PARAMETER_DOUBLE,
        description=f"recommended {RECOMMENDED[key]} [{GAIN_UNITS[key]}]; range {least:g} to {largest:g}; nan: none",
        additional_constraints="written by the monitor alone; set the controller's gains instead",
    )


def read(node: Node, name: str, changes: dict[str, Parameter] | None = None) -> JointSettings:
    """Read one joint's parameters, as they would be after the changes.

    Raises
    ------
    StickSlipError
        If they make no joint; the text names the value.
    """
    changes = changes or {}

    def text(parameter: str) -> object:
        changed = changes.get(parameter)
        return changed.value if changed is not None else node.get_parameter(parameter).value

    def value(parameter: str) -> float:
        return float(text(parameter))  # type: ignore[arg-type]

    model = node.get_parameter(f"model.{name}").value
    known = load_joint(model) if model else None
    if known is not None and known.per_inertia:
        raise InvalidParameterError(f"model.{name}", "a joint whose inertia is known", model)
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
    scale, effort_scale = value(f"gain_scale.{name}"), value(f"effort_scale.{name}")
    require_positive(f"gain_scale.{name}", scale)
    if not math.isfinite(effort_scale) or effort_scale == 0.0:
        raise InvalidParameterError(f"effort_scale.{name}", "finite and not zero", effort_scale)
    gains = _gains(*(value(f"gains.{name}.{key}") for key in ("p", "i", "d")))
    trial = _gains(value(f"trial.{name}.p"), math.nan, value(f"trial.{name}.d"))
    slowest = value(f"slowest_velocity.{name}")
    limits = AdviceLimits(
        wanted_margin=value("wanted_margin"),
        confidence=value("confidence"),
        condition=choice(Condition, "condition", text("condition")),
        steady_sliding=bool(text("steady_sliding")),
        slowest_velocity=None if math.isnan(slowest) else slowest,
        stiffness_range=(scale * value(f"limits.{name}.p_min"), scale * value(f"limits.{name}.p_max")),
        damping_range=(scale * value(f"limits.{name}.d_min"), scale * value(f"limits.{name}.d_max")),
        damping_ratio_range=(
            value(f"limits.{name}.damping_ratio_min"),
            value(f"limits.{name}.damping_ratio_max"),
        ),
        bandwidth=value(f"limits.{name}.bandwidth"),
        samples_per_period=value("samples_per_period"),
        effort=value(f"limits.{name}.effort"),
    )
    conditions = Conditions(
        load=value(f"load.{name}"),
        controller_period=value(f"controller_period.{name}"),
        control_delay=bool(value(f"control_delay.{name}")),
    )
    return JointSettings(
        joint=joint,
        gains=None if gains is None else _scaled(gains, scale),
        limits=limits,
        conditions=conditions,
        trial=None if trial is None else _scaled(trial, scale),
        gain_scale=scale,
        effort_scale=effort_scale,
    )


def choice(words: type[Choice], name: str, word: object) -> Choice:
    """The member of an enumeration of words that a parameter names.

    Raises
    ------
    InvalidParameterError
        If there is none of this name.
    """
    try:
        return words(word)
    except ValueError as error:
        raise InvalidParameterError(name, f"one of {', '.join(one.value for one in words)}", word) from error


def _gains(p: float, i: float, d: float) -> Gains | None:
    """Gains, of which NaN are not set; None without a stiffness."""
    if math.isnan(p):
        return None
    return Gains(stiffness=p, damping=0.0 if math.isnan(d) else d, integral=0.0 if math.isnan(i) else i)


def _scaled(gains: Gains, scale: float) -> Gains:
    return Gains(**{name: float(value) * scale for name, value in vars(gains).items()})
