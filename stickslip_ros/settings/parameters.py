# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The parameters that say how joints are judged: one table for the node, for YAML files and for recordings.

Gains, their limits and the advice are in the controller's units, of which one is `gain_scale` in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeVar

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.model._validation import require_positive
from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Condition
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.settings.known_joints import KnownJoint, load_joint
from stickslip_ros.settings.parameter_values import ParameterValues

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
Getter = Callable[[str], Any]


@dataclass(frozen=True, kw_only=True)
class ParameterSpec:
    """A parameter: ``default`` tells its type, ``unit`` is "" where it has none."""

    name: str
    default: Any
    text: str
    unit: str = ""
    read_only: bool = False

    @property
    def description(self) -> str:
        """For people, with the unit, and what nan means where it is allowed."""
        unit = f" [{self.unit}]" if self.unit else ""
        open_value = "; nan: not set" if isinstance(self.default, float) and self.unit and "{" in self.name else ""
        return f"{self.text}{unit}{open_value}"


def _common() -> tuple[ParameterSpec, ...]:
    options, limits = MonitorOptions(), AdviceLimits()
    spec = ParameterSpec
    return (
        spec(
            name="warn_margin",
            default=options.warn_margin,
            unit="1",
            text="damping reserve rho/rho_c - 1 below which smooth motion is at risk",
        ),
        spec(
            name="wanted_margin",
            default=limits.wanted_margin,
            unit="1",
            text="damping reserve rho/rho_c - 1 that advice must reach",
        ),
        spec(
            name="confidence",
            default=limits.confidence,
            unit="1",
            text="probability with which advice must reach it, the friction learnt being uncertain",
        ),
        spec(
            name="condition",
            default=limits.condition.value,
            text="which condition advice must satisfy: paper (Eq. (43)) or exact",
        ),
        spec(
            name="steady_sliding",
            default=limits.steady_sliding,
            text="whether advice must also keep the sliding joint from swinging about its speed",
        ),
        spec(
            name="variant",
            default=options.variant.value,
            text="which advice is recommended: least_change, damping_only, stiffness_only",
        ),
        spec(
            name="samples_per_period",
            default=limits.samples_per_period,
            unit="1",
            text="how often the controller must act in a period of the crossover frequency that advice may ask for",
        ),
        spec(name="learn", default=options.learn, text="whether friction is learnt from the motion"),
        spec(
            name="memory",
            default=options.memory,
            unit="1",
            text="slips after which what they taught has faded to a third",
        ),
        spec(
            name="least_motion",
            default=options.least_motion,
            unit="s",
            text="how long motion must last before it is called smooth",
        ),
    )


def _per_joint() -> tuple[ParameterSpec, ...]:
    spec = ParameterSpec
    least, largest = AdviceLimits().damping_ratio_range
    found = [
        spec(
            name="model.{joint}",
            default="",
            text="known joint (config/joints) or path of a joint file (.yaml); empty: none",
            read_only=True,
        ),
        spec(name="inertia.{joint}", default=_NOT_SET, unit="kg*m^2", text="inertia; overrides the model's"),
    ]
    for key, unit in FRICTION_UNITS.items():
        text = f"{key.replace('_', ' ')}; overrides the model's"
        found.append(spec(name=f"friction.{{joint}}.{key}", default=_NOT_SET, unit=unit, text=text))
    for key, unit in GAIN_UNITS.items():
        text = "gain of the controller, used until one is heard from"
        found.append(spec(name=f"gains.{{joint}}.{key}", default=_NOT_SET, unit=unit, text=text))
    for key, word in RECOMMENDED.items():
        text = f"{word} on trial: its margin is published, and nothing is set"
        found += [
            spec(name=f"trial.{{joint}}.{key}", default=_NOT_SET, unit=GAIN_UNITS[key], text=text),
            spec(name=f"limits.{{joint}}.{key}_min", default=0.0, unit=GAIN_UNITS[key], text="least gain to recommend"),
            spec(
                name=f"limits.{{joint}}.{key}_max",
                default=math.inf,
                unit=GAIN_UNITS[key],
                text="largest gain to recommend",
            ),
        ]
    return (
        *found,
        spec(name="limits.{joint}.damping_ratio_min", default=least, unit="1", text="least damping ratio to recommend"),
        spec(
            name="limits.{joint}.damping_ratio_max",
            default=largest,
            unit="1",
            text="largest damping ratio to recommend",
        ),
        spec(
            name="limits.{joint}.bandwidth",
            default=math.inf,
            unit="rad/s",
            text="largest crossover frequency to recommend",
        ),
        spec(
            name="limits.{joint}.effort",
            default=math.inf,
            unit="N*m",
            text="largest effort that advised gains may ask for now",
        ),
        spec(
            name="slowest_velocity.{joint}",
            default=_NOT_SET,
            unit="rad/s",
            text="the joint shall be smooth from this speed on, instead of at the present",
        ),
        spec(
            name="gain_scale.{joint}",
            default=1.0,
            unit="1",
            text="N*m/rad in one unit of the controller's p, and so on for d",
        ),
        spec(name="effort_scale.{joint}", default=1.0, unit="1", text="N*m in one unit of the effort in joint states"),
        spec(
            name="load.{joint}",
            default=0.0,
            unit="N*m",
            text="constant torque against the controller, for the exact verdict",
        ),
        spec(
            name="controller_period.{joint}",
            default=0.0,
            unit="s",
            text="of a sampled controller; 0: continuous, or not known",
        ),
        spec(
            name="control_delay.{joint}",
            default=False,
            text="whether the effort takes effect one controller period late",
        ),
    )


COMMON = _common()
PER_JOINT = _per_joint()


@dataclass(frozen=True, kw_only=True)
class JointSettings:
    """What the parameters say of one joint, in SI units; None for what they leave open.

    Attributes
    ----------
    options : how the joint is judged, with limits, conditions and gains on trial.
    gain_scale : SI units in one unit of the controller's gains; effort_scale : N·m in one unit of the effort in joint
        states.
    """

    joint: Joint | None
    gains: Gains | None
    options: MonitorOptions
    gain_scale: float
    effort_scale: float

    def to_si(self, gains: Gains) -> Gains:
        """Gains of the controller in SI units."""
        return _scaled(gains, self.gain_scale)

    def from_si(self, gains: Gains) -> Gains:
        """Gains in the controller's units."""
        return _scaled(gains, 1.0 / self.gain_scale)


def settings_of(name: str, get: Getter, typed: Callable[[str], str] = str) -> JointSettings:
    """What the parameters that ``get`` gives by name say of a joint.

    Parameters
    ----------
    typed : the name by which a parameter was given, where that is another one.

    Raises
    ------
    StickSlipError
        If they make no joint; the text names the parameter and the value, as they were typed.
    """
    values = ParameterValues(get, typed)
    with values.refused_as_typed(_made_of(name)):
        return _settings(name, values)


def _made_of(name: str) -> dict[str, tuple[str, ...]]:
    """The parameters that fields are made of, where they have other names."""
    return {
        "slowest_velocity": (f"slowest_velocity.{name}",),
        "stiffness_range": (f"limits.{name}.p_min", f"limits.{name}.p_max"),
        "damping_range": (f"limits.{name}.d_min", f"limits.{name}.d_max"),
        "damping_ratio_range": (f"limits.{name}.damping_ratio_min", f"limits.{name}.damping_ratio_max"),
        "bandwidth": (f"limits.{name}.bandwidth",),
        "effort": (f"limits.{name}.effort",),
        "load": (f"load.{name}",),
        "controller_period": (f"controller_period.{name}",),
        "inertia": (f"inertia.{name}",),
        **{key: (f"friction.{name}.{key}",) for key in FRICTION_UNITS},
    }


def _settings(name: str, values: ParameterValues) -> JointSettings:
    value = values.number
    scale, effort_scale = value(f"gain_scale.{name}"), value(f"effort_scale.{name}")
    require_positive(f"gain_scale.{name}", scale)
    if not math.isfinite(effort_scale) or effort_scale == 0.0:
        raise InvalidParameterError(f"effort_scale.{name}", "finite and not zero", effort_scale)
    limits = AdviceLimits(
        wanted_margin=value("wanted_margin"),
        confidence=value("confidence"),
        condition=choice(Condition, "condition", values["condition"]),
        steady_sliding=values.flag("steady_sliding"),
        slowest_velocity=values.number_if_set(f"slowest_velocity.{name}"),
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
        control_delay=values.flag(f"control_delay.{name}"),
    )
    options = MonitorOptions(
        warn_margin=value("warn_margin"),
        least_motion=value("least_motion"),
        learn=values.flag("learn"),
        memory=value("memory"),
        limits=limits,
        variant=choice(Kind, "variant", values["variant"]),
        conditions=conditions,
        trial=_gains("trial", name, RECOMMENDED, scale, values),
    )
    return JointSettings(
        joint=_joint(name, values),
        gains=_gains("gains", name, GAIN_UNITS, scale, values),
        options=options,
        gain_scale=scale,
        effort_scale=effort_scale,
    )


def _joint(name: str, values: ParameterValues) -> Joint | None:
    model = str(values[f"model.{name}"])
    known = _known_joint(f"model.{name}", model) if model else None
    inertia = values.number_if_set(f"inertia.{name}")
    friction = {key: values.number_if_set(f"friction.{name}.{key}") for key in FRICTION_UNITS}
    given = {key: number for key, number in friction.items() if number is not None}
    if known is not None:
        base = {key: getattr(known.joint.friction, key) for key in FRICTION_UNITS}
        return Joint(
            inertia=known.joint.inertia if inertia is None else inertia, friction=Friction(**{**base, **given})
        )
    # What is given is looked at even where it makes no joint yet.
    whole = {"stribeck": 0.0, "stribeck_velocity": 1.0, **given}
    joint = Joint(inertia=1.0 if inertia is None else inertia, friction=Friction(**whole))
    return joint if inertia is not None and {"stribeck", "stribeck_velocity"} <= set(given) else None


def _known_joint(parameter: str, model: str) -> KnownJoint:
    try:
        known = load_joint(model)
    except StickSlipError as error:
        raise StickSlipError(f"{parameter}: {error}") from error
    if known.per_inertia:
        raise InvalidParameterError(parameter, "a joint whose inertia is known", model)
    return known


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


def _gains(group: str, name: str, keys: Iterable[str], scale: float, values: ParameterValues) -> Gains | None:
    """Gains in SI units; those that are not set are 0, but without a stiffness there are none."""
    given = {key: values.number_if_set(f"{group}.{name}.{key}") for key in keys}
    for key, number in given.items():
        if number is not None and not math.isfinite(number * scale):
            raise InvalidParameterError(f"{group}.{name}.{key}", f"finite, times gain_scale.{name}", number)
    if given["p"] is None:
        return None
    gains = Gains(stiffness=given["p"], damping=given.get("d") or 0.0, integral=given.get("i") or 0.0)
    return _scaled(gains, scale)


def _scaled(gains: Gains, scale: float) -> Gains:
    return Gains(**{name: float(value) * scale for name, value in vars(gains).items()})
