# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The parameters that say how joints are judged: one table for the node, for YAML files and for recordings.

Gains, their limits and the advice are in the controller's units, of which one is `gain_scale` in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeVar

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.known_joints import load_joint
from stickslip_ros.model._validation import require_positive
from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.monitoring.advice import Kind
from stickslip_ros.monitoring.advice_limits import AdviceLimits, Condition
from stickslip_ros.monitoring.assessment import MonitorOptions

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


def settings_of(name: str, get: Getter) -> JointSettings:
    """What the parameters that ``get`` gives by name say of a joint.

    Raises
    ------
    StickSlipError
        If they make no joint; the text names the value.
    """

    def value(parameter: str) -> float:
        found = get(parameter)
        if isinstance(found, bool) or not isinstance(found, (int, float)):
            raise InvalidParameterError(parameter, "a number", found)
        return float(found)

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
        condition=choice(Condition, "condition", get("condition")),
        steady_sliding=bool(get("steady_sliding")),
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
        control_delay=bool(get(f"control_delay.{name}")),
    )
    options = MonitorOptions(
        warn_margin=value("warn_margin"),
        least_motion=value("least_motion"),
        learn=bool(get("learn")),
        memory=value("memory"),
        limits=limits,
        variant=choice(Kind, "variant", get("variant")),
        conditions=conditions,
        trial=None if trial is None else _scaled(trial, scale),
    )
    return JointSettings(
        joint=_joint(name, get, value),
        gains=None if gains is None else _scaled(gains, scale),
        options=options,
        gain_scale=scale,
        effort_scale=effort_scale,
    )


def _joint(name: str, get: Getter, value: Callable[[str], float]) -> Joint | None:
    model = str(get(f"model.{name}"))
    known = load_joint(model) if model else None
    if known is not None and known.per_inertia:
        raise InvalidParameterError(f"model.{name}", "a joint whose inertia is known", model)
    inertia = value(f"inertia.{name}")
    friction = {key: value(f"friction.{name}.{key}") for key in FRICTION_UNITS}
    given = {key: number for key, number in friction.items() if not math.isnan(number)}
    if known is not None:
        base = {key: getattr(known.joint.friction, key) for key in FRICTION_UNITS}
        return Joint(
            inertia=known.joint.inertia if math.isnan(inertia) else inertia, friction=Friction(**{**base, **given})
        )
    if not math.isnan(inertia) and {"stribeck", "stribeck_velocity"} <= set(given):
        return Joint(inertia=inertia, friction=Friction(**given))
    return None


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
