# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The table of the friction's parameters, and the units of everything."""

from __future__ import annotations

import ast
import dataclasses
import itertools
import math

import numpy as np
import pytest
from conftest import ROOT

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
from stickslip_ros.monitoring.friction import sliding
from stickslip_ros.monitoring.friction.estimate import NAMES, NOT_ESTIMATED, FrictionEstimate
from stickslip_ros.monitoring.friction.slip_windows import ForceSource

PACKAGE = ROOT / "stickslip_ros"
# Vectors that begin the order a second time: of a fit, what shapes a slip and what Eq. (6) has from one slip to the
# next; of a curve of sliding, the friction and the forces beside it.
IN_TWO_PARTS = {"monitoring/friction/_window_kernel.py", "monitoring/friction/sliding.py"}


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


def test_there_is_one_order() -> None:
    """Issue 37: vectors of parameters have them in the order of the table, though not all of them."""
    whole = [parameter.name for parameter in (*JOINT_PARAMETERS, *PRESLIDING_PARAMETERS)]
    vectors = 0
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}
    for path in [path for path, text in texts.items() if " = range(" in text]:
        for node in ast.walk(ast.parse(texts[path])):
            if not (isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("range(")):
                continue
            names = [name.id.strip("_").lower() for name in ast.walk(node.targets[0]) if isinstance(name, ast.Name)]
            places = [whole.index(name) for name in names if name in whole]
            parts = 1 + sum(after < before for before, after in itertools.pairwise(places))
            vectors += len(places) > 2
            assert parts <= 1 + (str(path.relative_to(PACKAGE)) in IN_TWO_PARTS), f"{path}: {names}"
    assert vectors >= 2
    curve, beside = sliding.NAMES[:4], sliding.NAMES[4:]
    assert beside == ("load", "inertia")
    assert list(curve) == [name for name in whole if name in curve]
    for owner in (Friction, Joint):
        fields = [field.name for field in dataclasses.fields(owner) if field.name in whole]
        assert fields == [name for name in whole if name in fields]


def test_an_estimate_has_one_order() -> None:
    """Issue 37: each number of an estimate has one name, alone, in the joint and in its draws."""
    count = len(NAMES) - 1  # Coulomb friction is estimated apart
    estimate = FrictionEstimate(
        source=ForceSource.GAINS, normalised=False, logarithms=np.log(np.arange(2.0, 2.0 + count)),
        covariance=np.zeros((count, count)), coulomb=NOT_ESTIMATED, load=NOT_ESTIMATED, coulomb_and_load=NOT_ESTIMATED,
        slips=12, aside=0, mean_square=1.0, left_over=0.0, scatter=0.0, mismatch="", configured=False,
    )  # fmt: skip
    joint, draws = estimate.joint(), estimate.draws()[0]
    named = {name: estimate[name].value for name in NAMES if name != "coulomb"}
    assert sorted(named.values()) == pytest.approx(np.arange(2.0, 2.0 + count))
    for name, value in named.items():
        one, drawn = (getattr(of if name == "inertia" else of.friction, name) for of in (joint, draws))
        assert math.isclose(one, value)
        assert drawn == pytest.approx(value)
