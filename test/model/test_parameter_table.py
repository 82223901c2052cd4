# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The table of the friction's parameters, and the units of everything."""

from __future__ import annotations

import dataclasses
from types import ModuleType

import pytest

from stickslip_ros.model import _plant_state
from stickslip_ros.model.friction import (
    FRICTION_PARAMETERS,
    INERTIA,
    JOINT_PARAMETERS,
    PRESLIDING_PARAMETERS,
    Friction,
    FrictionParameter,
    Gains,
    Joint,
)
from stickslip_ros.model.units import in_ascii, unit_of
from stickslip_ros.monitoring.friction import _window_kernel, sliding
from stickslip_ros.monitoring.friction.estimate import NAMES


@pytest.mark.parametrize("parameter", [*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS], ids=lambda parameter: parameter.name)
def test_the_table_agrees_with_the_law(parameter: FrictionParameter) -> None:
    """Symbol and unit are those that the law's own documentation has."""
    text = (Joint if parameter is INERTIA else Friction).__doc__ or ""
    (line,) = [line for line in text.splitlines() if line.strip().startswith(f"{parameter.name} :")]
    assert parameter.symbol in line
    assert f"[{parameter.unit}]" in line


def test_every_number_of_the_law_is_in_the_table() -> None:
    """Whoever adds one to the law adds a row; estimates, files and outputs go by the rows."""
    joint = Joint(inertia=1.0, friction=Friction(stribeck=1.0, stribeck_velocity=1.0))
    numbers = {name for name, value in vars(joint.friction).items() if isinstance(value, float)}
    assert {parameter.name for parameter in (*FRICTION_PARAMETERS, *PRESLIDING_PARAMETERS)} == numbers
    assert ("inertia", *(parameter.name for parameter in FRICTION_PARAMETERS)) == NAMES


def test_units_per_inertia() -> None:
    """Forces are divided by the inertia; speeds and times are not."""
    forces = [parameter.name for parameter in JOINT_PARAMETERS if parameter.is_force]
    assert forces == ["coulomb", "viscous", "stribeck"]
    assert [in_ascii(parameter.unit_where(per_inertia=True)) for parameter in JOINT_PARAMETERS] == [
        "1", "rad/s^2", "1/s", "rad/s^2", "rad/s", "s", "s"
    ]  # fmt: skip


def test_units_as_keys_have_them() -> None:
    """Keys of diagnostics are ASCII."""
    assert in_ascii(unit_of(Gains, "integral")) == "N*m/(rad*s)"
    assert in_ascii(unit_of(Joint, "inertia")) == "kg*m^2"


def indices(module: ModuleType, prefix: str = "") -> dict[str, int]:
    """Indices that a module has for parameters of the table, in the order of the table."""
    names = [parameter.name for parameter in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS)]
    found = {name: getattr(module, prefix + name.upper(), None) for name in names}
    return {name: index for name, index in found.items() if isinstance(index, int)}


def test_there_is_one_order() -> None:
    """Issue 37: vectors of parameters have them in the order of the table, though not all of them.

    A fit's vector is two such: what shapes a slip, and what Eq. (6) has from one slip to the next. A curve of sliding
    has the friction first.
    """
    whole = [parameter.name for parameter in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS)]
    assert list(indices(_plant_state).items()) == [(name, index) for index, name in enumerate(whole)]
    fitted, shape = _window_kernel.FITTED, _window_kernel.SHAPE
    assert indices(_window_kernel) == {name: index for index, name in enumerate(fitted)}
    assert set(fitted) == {parameter.name for parameter in JOINT_PARAMETERS} - {"coulomb"}
    assert fitted[: len(shape)] == shape
    for part in (shape, fitted[len(shape) :]):
        assert list(part) == [name for name in whole if name in part]
    assert indices(sliding, "_") == {name: index for index, name in enumerate(sliding.NAMES) if name != "load"}
    curve, beside = sliding.NAMES[:4], sliding.NAMES[4:]
    assert beside == ("load", "inertia")
    assert list(curve) == [name for name in whole if name in curve]
    for owner in (Friction, Joint):
        fields = [field.name for field in dataclasses.fields(owner) if field.name in whole]
        assert fields == [name for name in whole if name in fields]
