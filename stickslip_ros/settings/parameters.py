# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the parameters of `parameter_table.py` say of a joint, whether they come from the node or from a YAML file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, TypeVar

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.model._validation import require_not_negative, require_positive
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import FRICTION_PARAMETERS, PRESLIDING_PARAMETERS, Friction, Gains, Joint
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, by_field, limits_from
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.settings.known_joints import KnownJoint, load_joint
from stickslip_ros.settings.parameter_table import GAINS, RECOMMENDED

_NO_FRICTION = Friction(stribeck=0.0, stribeck_velocity=1.0)
_GAIN_LIMITS = ("stiffness_range", "damping_range")  # in the controller's units, of which one is gain_scale
_FRICTION = tuple(parameter.name for parameter in (*FRICTION_PARAMETERS, *PRESLIDING_PARAMETERS))

Choice = TypeVar("Choice", bound=Enum)
Getter = Callable[[str], Any]


@dataclass(frozen=True, kw_only=True)
class Feedforward:
    """What of the friction is published as a torque to be added.

    Attributes
    ----------
    share : of the friction, 0 to 1; 0 is off. largest : never more than this [N·m].

    Raises
    ------
    InvalidParameterError
        If the share is not from 0 to 1, or the largest torque is negative or not finite, or not set with a share.
    """

    share: float = 0.0
    largest: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise InvalidParameterError("feedforward_share", ">= 0 (off) and <= 1 (all of the friction)", self.share)
        require_not_negative("feedforward_largest", self.largest)
        if self.share > 0 and self.largest == 0:
            raise InvalidParameterError("feedforward_largest", "> 0 before a share is set", self.largest)


@dataclass(frozen=True, kw_only=True)
class JointSettings:
    """What the parameters say of one joint, in SI units; None for what they leave open.

    Attributes
    ----------
    options : how the joint is judged, with limits, conditions and gains on trial.
    feedforward : what is published as a torque to be added.
    gain_scale : SI units in one unit of the controller's gains; effort_scale : N·m in one unit of the effort in joint
        states.
    """

    joint: Joint | None
    gains: Gains | None
    options: MonitorOptions
    gain_scale: float
    effort_scale: float
    feedforward: Feedforward = Feedforward()

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
    try:
        return _settings(name, _Values(get))
    except InvalidParameterError as error:
        made_of = _made_of(name)
        parameters = made_of.get(error.name, (error.name,))
        values = [get(one) for one in parameters] if error.name in made_of else ()
        raise error.as_typed([typed(one) for one in parameters], values) from error


def _made_of(name: str) -> dict[str, tuple[str, ...]]:
    """The parameters that fields are made of, where they have other names."""
    return {
        "slowest_velocity": (f"slowest_velocity.{name}",),
        **by_field(lambda one: f"limits.{name}.{one.parameter}"),
        "load": (f"load.{name}",),
        "feedforward_share": (f"feedforward.{name}.share",),
        "feedforward_largest": (f"feedforward.{name}.largest",),
        "controller_period": (f"controller_period.{name}",),
        "inertia": (f"inertia.{name}",),
        **{key: (f"friction.{name}.{key}",) for key in _FRICTION},
    }


def _settings(name: str, values: _Values) -> JointSettings:
    value = values.number
    scale, effort_scale = value(f"gain_scale.{name}"), value(f"effort_scale.{name}")
    require_positive(f"gain_scale.{name}", scale)
    if not math.isfinite(effort_scale) or effort_scale == 0.0:
        raise InvalidParameterError(f"effort_scale.{name}", "finite and not zero", effort_scale)
    limits = AdviceLimits(
        wanted_margin=value("wanted_margin"),
        confidence=value("confidence"),
        condition=choice(Criterion, "condition", values.get("condition")),
        steady_sliding=values.flag("steady_sliding"),
        slowest_velocity=values.number_if_set(f"slowest_velocity.{name}"),
        samples_per_period=value("samples_per_period"),
        **limits_from(
            lambda one: value(f"limits.{name}.{one.parameter}") * (scale if one.field in _GAIN_LIMITS else 1.0)
        ),
    )
    conditions = OperatingConditions(
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
        variant=choice(Kind, "variant", values.get("variant")),
        conditions=conditions,
        trial=_gains("trial", name, RECOMMENDED, scale, values),
    )
    return JointSettings(
        joint=_joint(name, values),
        gains=_gains("gains", name, GAINS, scale, values),
        options=options,
        gain_scale=scale,
        effort_scale=effort_scale,
        feedforward=Feedforward(share=value(f"feedforward.{name}.share"), largest=value(f"feedforward.{name}.largest")),
    )


def _joint(name: str, values: _Values) -> Joint | None:
    model = str(values.get(f"model.{name}"))
    known = _known_joint(f"model.{name}", model) if model else None
    inertia = values.number_if_set(f"inertia.{name}")
    friction = {key: values.number_if_set(f"friction.{name}.{key}") for key in _FRICTION}
    given = {key: number for key, number in friction.items() if number is not None}
    if known is not None:
        return replace(
            known.joint,
            inertia=known.joint.inertia if inertia is None else inertia,
            friction=known.joint.friction.changed(given),
        )
    # What is given is looked at even where it makes no joint yet.
    joint = Joint(inertia=1.0 if inertia is None else inertia, friction=_NO_FRICTION.changed(given))
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


def _gains(group: str, name: str, keys: Iterable[str], scale: float, values: _Values) -> Gains | None:
    """Gains in SI units; those that are not set are 0, but without a stiffness there are none."""
    given = {key: values.number_if_set(f"{group}.{name}.{key}") for key in keys}
    for key, number in given.items():
        # With another sign a controller drives the joint away from where it ought to be.
        if number is not None and number < 0.0:
            raise InvalidParameterError(f"{group}.{name}.{key}", "finite and >= 0, or nan where it is not set", number)
        if number is not None and not math.isfinite(number * scale):
            raise InvalidParameterError(f"{group}.{name}.{key}", f"finite, times gain_scale.{name}", number)
    if given["p"] is None:
        return None
    gains = Gains(stiffness=given["p"], damping=given.get("d") or 0.0, integral=given.get("i") or 0.0)
    return _scaled(gains, scale)


def _scaled(gains: Gains, scale: float) -> Gains:
    return Gains(**{name: float(value) * scale for name, value in vars(gains).items()})


@dataclass(frozen=True)
class _Values:
    """The values of parameters, which ``get`` gives by name, each of its kind."""

    get: Getter

    def number(self, name: str) -> float:
        """A number, which may be infinite or NaN.

        Raises
        ------
        InvalidParameterError
            If it is none.
        """
        found = self.get(name)
        if isinstance(found, bool) or not isinstance(found, (int, float)):
            raise InvalidParameterError(name, "a number", found)
        try:
            return float(found)
        except OverflowError as error:
            raise InvalidParameterError(name, "a number below 1e308", "an integer of too many digits") from error

    def number_if_set(self, name: str) -> float | None:
        """A finite number, None where it is NaN: not set.

        Raises
        ------
        InvalidParameterError
            If it is none.
        """
        found = self.number(name)
        if math.isinf(found):
            raise InvalidParameterError(name, "finite, or nan where it is not set", found)
        return None if math.isnan(found) else found

    def flag(self, name: str) -> bool:
        """Yes or no.

        Raises
        ------
        InvalidParameterError
            If it is neither: the text "false" would count as true.
        """
        found = self.get(name)
        if not isinstance(found, bool):
            raise InvalidParameterError(name, "true or false", found)
        return found
