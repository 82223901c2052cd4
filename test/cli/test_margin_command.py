# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip margin`."""

from __future__ import annotations

import json

import pytest

from stickslip_ros.cli.main import COMMANDS, main

pytestmark = pytest.mark.slow

PAPER = (
    "margin --inertia 6.3 --stiffness 2016 --damping 0 --velocity 0.00493 --stribeck 1.6 --stribeck-velocity 0.0058 "
    "--lag 0.05 --rise-time 0.264 --viscous 4.94 --json"
)


def answer(capsys: pytest.CaptureFixture[str], command: str, status: int = 0) -> dict[str, object]:
    assert main(command.split()) == status
    captured = capsys.readouterr()
    assert captured.err == ""
    result = json.loads(captured.out)
    assert isinstance(result, dict)
    return result


def test_the_papers_joint(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 2: the JSON of design.md, with the numbers of physics.md at ξ˙_d = 0.85, k_p/M = 320."""
    result = answer(capsys, PAPER)
    assert result["applicable"] is True
    assert result["reason"] is None
    assert result["smooth"] is False
    assert result["energy_margin"] == pytest.approx(-1.91484, abs=1e-5)
    assert result["damping_ratio"] == pytest.approx(0.0219170, abs=1e-6)
    assert result["critical_damping_ratio"] == pytest.approx(0.4437245, abs=1e-6)
    assert result["reduction_factor"] == pytest.approx(0.0917999, abs=1e-6)
    assert result["steady_stribeck"] == pytest.approx(1.4795647, abs=1e-6)
    assert result["lowest_smooth_velocity"] == pytest.approx(0.012927, abs=1e-6)
    assert result["exact"] == {
        "smooth": False,
        "outcome": "sticks",
        "depends_on_start": False,
        "reason": None,
        "steady_damping_ratio": pytest.approx(0.577, rel=0.01),
        "critical_damping_ratio": pytest.approx(0.1628, rel=0.005),
        "damping_reserve": pytest.approx(0.021917 / 0.1628 - 1.0, rel=0.005),
        "lowest_smooth_velocity": pytest.approx(0.010478, rel=0.002),
        "least_smooth_stiffness": pytest.approx(3983.3, rel=0.002),
    }


def test_a_known_joint_and_overrides(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 2: --model loads config/joints; other options override its values. Issue 40: --joint, its former name."""
    same = answer(capsys, "margin --model puma560_joint1 --stiffness 2016 --velocity 0.00493 --json")
    assert same == answer(capsys, PAPER)
    assert same == answer(capsys, "margin --joint=puma560_joint1 --stiffness 2016 --velocity 0.00493 --json")
    for command in ("margin", "recommend", "reversal", "map", "simulate"):
        assert COMMANDS[command].former["--joint"] == "--model"
    # Between the exact boundary and the paper's, the two verdicts differ.
    between = answer(capsys, "margin --model puma560_joint1 --stiffness 2016 --velocity 0.00493 --damping 50 --json")
    assert between["smooth"] is False
    assert between["exact"]["smooth"] is True


def test_not_applicable_has_a_reason_and_no_number(capsys: pytest.CaptureFixture[str]) -> None:
    """Issues 2 and 36: outside the domain every number is null, the reason is given, and the exit status is 1."""
    result = answer(capsys, "margin --model puma560_joint1 --velocity 0 --json", status=1)
    assert result["applicable"] is False
    assert "velocity is zero" in str(result["reason"])
    assert all(value is None for key, value in result.items() if key not in ("applicable", "reason", "exact"))


def test_beyond_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 3: integral action, load, controller period and delay are off unless asked for, and enter `exact` alone."""
    plain, late = answer(capsys, PAPER), answer(capsys, f"{PAPER} --load 3 --controller-period 0.01 --control-delay")
    assert late["exact"]["critical_damping_ratio"] > 1.3 * plain["exact"]["critical_damping_ratio"]
    assert {**late, "exact": None} == {**plain, "exact": None}
    hunting = answer(
        capsys, "margin --model puma560_joint1 --velocity 0 --stiffness 630 --damping 20 --integral 1000 --json"
    )
    assert hunting["applicable"] is False
    assert hunting["exact"]["smooth"] is False
    assert hunting["exact"]["reason"] == "hunting"


def test_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 2: without --json a verdict, numbers with units, and what would change it."""
    assert main(PAPER.replace(" --json", "").split()) == 0
    text = capsys.readouterr().out
    assert text.startswith("Joint: M 6.3 kg·m², k_p 2016 N·m/rad, k_v 0 N·m·s/rad, ")
    assert "At 0.00493 rad/s the joint sticks" in text
    assert "ρ_steady" in text
    (reserve,) = (line.split() for line in text.splitlines() if "damping reserve" in line)
    assert reserve[2:4] == ["-87", "%"]
    assert "N·m" in text
    assert "stiffness × 2.7" in text


def test_how_a_joint_hunts(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: at standstill with integral action: period, amplitude, and gains that would not hunt."""
    lugre = (
        "--inertia 1 --stiffness 3 --damping 6 --integral 4 --velocity 0 --stribeck 0.5 --stribeck-velocity 0.001 "
        "--coulomb 1 --viscous 0.4 --law exponential --contact lugre --presliding-stiffness 1e5 "
        "--presliding-damping 316.2"
    )
    assert main(["margin", *lugre.split(), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["exact"]["reason"] == "hunting"
    assert found["hunting"]["period"] == pytest.approx(24.4, abs=0.5)
    assert found["hunting"]["largest_quiet_integral"] is None
    assert main(["margin", *lugre.split()]) == 0
    text = capsys.readouterr().out
    assert (
        "It hunts by ±63.9 mrad, once in 24.4 s; no k_i down to a thousandth of the present one ends that, "
        "with k_p from 157 it does not" in text
    )


@pytest.mark.nightly
def test_a_hunt_that_presliding_ends(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: with presliding it may settle where the rigid law hunts: text and JSON say which."""
    given = ["margin", "--model", "puma560_joint1", "--stiffness", "630", "--velocity", "0", "--integral", "1000"]
    soft, stiff = ["--presliding-stiffness", "1e4"], ["--presliding-stiffness", "1e5"]
    main([*given, *soft])
    text = capsys.readouterr().out
    assert "the joint comes to rest" in text
    assert "With a rigid contact it would hunt, by ±2.78 mrad: presliding lets it settle." in text
    main([*given, *soft, "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["exact"]["smooth"] is True
    assert found["rigid_contact"]["hunts"] is True
    assert found["rigid_contact"]["amplitude"] == pytest.approx(0.00278, rel=0.01)
    main([*given, *stiff])
    assert "With a rigid contact it would hunt too, by ±2.78 mrad." in capsys.readouterr().out
    main([*given, "--json"])
    assert "rigid_contact" not in json.loads(capsys.readouterr().out)


@pytest.mark.nightly
def test_slips_one_way_are_no_hunting(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 23: limits and verdict are of one piece; a loop that is unstable does not hunt by eight thousand mrad."""
    given = ["margin", "--model", "puma560_joint1", "--stiffness", "630", "--velocity", "0", "--integral"]
    main([*given, "3.2"])
    assert "At 0 rad/s the joint comes to rest" in capsys.readouterr().out
    main([*given, "1000"])
    assert "with k_i up to 322 it does not, with k_p from 903 it does not." in capsys.readouterr().out
    main([*given, "1000", "--coulomb", "0"])
    text = capsys.readouterr().out
    assert "the loop is unstable: its motion grows without end" in text
    assert "hunts" not in text
    main([*given, "1000", "--coulomb", "0", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["exact"]["smooth"] is None
    assert "unstable" in found["exact"]["reason"]
