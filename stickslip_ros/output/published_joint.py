# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The joint that a monitor believes in, as keys of its diagnostics, so that who listens can compute with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    INERTIA,
    PRESLIDING_PARAMETERS,
    Friction,
    Joint,
    Transmission,
)
from stickslip_ros.model.units import in_ascii

_BEFORE = "believed "
_DELAY = f"{_BEFORE}actuation_delay [s]"
_SPRING = {
    one.name: f"{_BEFORE}{one.name} [{one.metadata['unit']}]" if one.metadata else f"{_BEFORE}{one.name}"
    for one in fields(Transmission)
}
_LAW, _CONTACT = f"{_BEFORE}law", f"{_BEFORE}contact"


def joint_values(joint: Joint) -> list[tuple[str, object]]:
    """Keys and values of a joint that is known with its inertia; SI units."""
    friction = joint.friction
    values: list[tuple[str, object]] = [(_key(INERTIA.name, INERTIA.unit), float(joint.inertia))]
    parameters = FRICTION_PARAMETERS if friction.rigid else (*FRICTION_PARAMETERS, *PRESLIDING_PARAMETERS)
    values += [(_key(one.name, one.unit), float(getattr(friction, one.name))) for one in parameters]
    if joint.actuation_delay:
        values.append((_DELAY, float(joint.actuation_delay)))
    if joint.transmission is not None:
        values += [(key, getattr(joint.transmission, name)) for name, key in _SPRING.items()]
    return [*values, (_LAW, friction.law), *([] if friction.rigid else [(_CONTACT, friction.contact)])]


def published_joint(values: Mapping[str, str]) -> Joint | None:
    """The joint that diagnostics tell of; None if they tell of none, or of one that cannot be."""
    inertia = values.get(_key(INERTIA.name, INERTIA.unit))
    if inertia is None:
        return None
    texts = {
        one.name: values[key]
        for one in (*FRICTION_PARAMETERS, *PRESLIDING_PARAMETERS)
        if (key := _key(one.name, one.unit)) in values
    }
    words = {name: values[key] for name, key in (("law", _LAW), ("contact", _CONTACT)) if key in values}
    try:
        numbers = {name: float(text) for name, text in texts.items()}
        friction = Friction(**numbers, **words)  # type: ignore[arg-type]
        return Joint(
            inertia=float(inertia),
            friction=friction,
            transmission=Transmission.given({name: values.get(key) for name, key in _SPRING.items()}),
            actuation_delay=float(values.get(_DELAY, 0.0)),
        )
    except (InvalidParameterError, TypeError, ValueError):
        return None


def _key(name: str, unit: str) -> str:
    return f"{_BEFORE}{name} [{in_ascii(unit)}]"
