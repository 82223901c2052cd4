# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whatever is refused has the name that the user typed: of the parameter, or of the option."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import pytest

from stickslip_ros.cli.main import build_parser, main
from stickslip_ros.errors import StickSlipError
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameter_table import COMMON, PER_JOINT
from stickslip_ros.settings.parameters import settings_of

BAD = (math.nan, -1.0, math.inf, -math.inf, "many", [1.0], None, 10**400)
# Values of the list above that are right, by parameter.
OPEN_ENDS = {
    "memory": {math.inf},
    **{f"limits.{{joint}}.{key}": {math.inf} for key in ("p_max", "d_max", "damping_ratio_max", "bandwidth", "effort")},
    "effort_scale.{joint}": {-1.0},
    "load.{joint}": {-1.0},
}
MAY_BE_NAN = ("inertia.", "friction.", "gains.", "trial.", "slowest_velocity.")


def allowed(name: str, value: object) -> bool:
    """Whether a value of the list is right for a parameter of the table."""
    if isinstance(value, float):
        if math.isnan(value):
            return name.startswith(MAY_BE_NAN)
        return value in OPEN_ENDS.get(name, ())
    return False


def settings(changes: dict[str, Any]) -> object:
    """What the parameters make of the joint `elbow`, the rest as it is by default."""
    values = {spec.name.format(joint="elbow"): spec.default for spec in (*COMMON, *PER_JOINT)}
    assert set(changes) <= set(values)
    return settings_of("elbow", (values | changes).__getitem__)


@pytest.mark.parametrize("spec", [*COMMON, *PER_JOINT], ids=lambda spec: spec.name)
def test_every_parameter_is_refused_by_its_own_name(spec: Any) -> None:
    """Issue 15: nan, -1, inf and texts in every parameter of the tables; the refusal has its name."""
    name = spec.name.format(joint="elbow")
    for value in BAD:
        if allowed(spec.name, value):
            settings({name: value})
            continue
        with pytest.raises(StickSlipError) as refused:
            settings({name: value})
        assert name in str(refused.value), f"{value}: {refused.value}"
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("key", ["p", "d", "damping_ratio"])
def test_a_reversed_range_names_both_ends_in_the_units_typed(key: str) -> None:
    """Issue 15: limits the wrong way round name both parameters, and the values as they were typed."""
    changes = {f"limits.elbow.{key}_min": 5.0, f"limits.elbow.{key}_max": 3.0, "gain_scale.elbow": 7.0}
    with pytest.raises(StickSlipError) as refused:
        settings(changes)
    assert f"'limits.elbow.{key}_min' and 'limits.elbow.{key}_max' must be " in str(refused.value)
    assert str(refused.value).endswith(": 5.0 and 3.0")


def test_gains_that_their_scale_makes_infinite() -> None:
    """Issue 15: what is finite as typed, and not in SI units, has its name too."""
    with pytest.raises(StickSlipError, match=r"'gains.elbow.p' must be finite, times gain_scale.elbow: 1e\+200"):
        settings({"gains.elbow.p": 1e200, "gain_scale.elbow": 1e200})


def test_a_parameter_of_every_joint_keeps_its_star() -> None:
    """Issue 15: who writes `limits.*.p_max` is told of that, and not of a joint that they never named."""
    with pytest.raises(StickSlipError, match=r"'limits.elbow.p_min' and 'limits.\*.p_max' must be"):
        Parameters({"limits.*.p_max": -3.0, "limits.elbow.p_min": 0.0}).settings_of("elbow")
    with pytest.raises(StickSlipError, match=r"'inertia.\*' must be finite and > 0: -1.0"):
        Parameters({"inertia.*": -1.0}).settings_of("elbow")


def numeric_options(command: str) -> list[str]:
    """Options of a command that take a number."""
    parser = build_parser()
    commands = next(action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return [
        action.option_strings[-1]
        for action in commands.choices[command]._actions
        if action.type in (float, int) or action.dest in ("velocity", "what_if")
    ]


# Options for which a number of the list below is right.
RIGHT = {
    "-1": {"--stiffness", "--damping", "--velocity", "--load"},
    "inf": {
        "--largest-stiffness",
        "--largest-damping",
        "--largest-damping-ratio",
        "--bandwidth",
        "--effort",
        "--presliding-stiffness",
    },
}
COMMANDS = ("margin", "recommend", "map", "simulate")


@pytest.mark.parametrize(("command", "option"), [(one, name) for one in COMMANDS for name in numeric_options(one)])
def test_every_numeric_option_is_refused_by_its_own_name(
    command: str, option: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Issue 15: nan, -1, inf and a text in every option that takes a number; the line has the option as typed."""
    # Every other value is right, so that the refusal is about this one.
    base = [command] if command == "simulate" else [command, "--model", "puma560_joint1"]
    if command in ("map", "simulate"):
        base += ["--out", str(tmp_path / ("map.png" if command == "map" else "x.mcap"))]
    for value in ("nan", "-1", "inf", "many"):
        if option in RIGHT.get(value, ()):
            continue
        given = f"p={value}" if option == "--what-if" else value
        if option == "--what-if" and value == "-1":
            continue
        try:
            status = main([*base, f"{option}={given}"])
        except SystemExit as end:
            status = int(end.code or 0)
        error = capsys.readouterr().err
        assert status == 2, f"{option}={given} was taken"
        (line,) = [text for text in error.splitlines() if text.startswith("stickslip")]
        assert option in line, line
        assert "Traceback" not in error


@pytest.mark.parametrize("name", ["stiffness", "damping", "damping-ratio"])
def test_reversed_bounds_name_both_options(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 15: `--least-stiffness` above `--largest-stiffness`: the line has both."""
    options = [f"--least-{name}=5", f"--largest-{name}=3"]
    assert main(["recommend", "--model", "puma560_joint1", *options]) == 2
    assert f"'--least-{name}' and '--largest-{name}' must be " in capsys.readouterr().err


def test_an_unknown_model_names_the_option(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Issue 15: `--model` with a joint that is not known: the line has the option and what was typed."""
    bag = tmp_path / "x.mcap"
    assert main(["simulate", "--out", str(bag), "--duration", "1"]) == 0
    assert main(["analyze", str(bag), "--model", "joint1=puma"]) == 2
    assert "stickslip: --model joint1=puma: unknown joint 'puma'; known joints: " in capsys.readouterr().err
