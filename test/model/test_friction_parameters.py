# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The table of the friction's parameters, and the units of everything."""

from __future__ import annotations

import pytest

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.friction_parameters import (
    FRICTION_PARAMETERS,
    INERTIA,
    JOINT_PARAMETERS,
    PRESLIDING_PARAMETERS,
    FrictionParameter,
)
from stickslip_ros.model.units import in_ascii, unit_of
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
