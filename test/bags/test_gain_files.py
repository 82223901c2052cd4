# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34, items 11 and 13: gains in parameter files, where controllers have them; what is not taken is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support_bags import JOINT_STATE, joint_state, write_mcap

from stickslip_ros.cli.main import main
from stickslip_ros.messages.gain_parameters import gains_elsewhere, texts_in, why_not_taken
from stickslip_ros.settings.parameter_file import ParameterFileError, Parameters

EFFORT = "arm: {ros__parameters: {command_interfaces: [effort], gains: {a: {p: 630.0, i: 2.0, d: 12.0}}}}\n"
VELOCITY = "wheels: {ros__parameters: {command_interfaces: [velocity], gains: {b: {p: 3.0, d: 0.1}}}}\n"
ARRAYS = "panda: {ros__parameters: {joints: [a, b], p: [630.0, 500.0], k_q_d: [1.0, 2.0], rate: 100}}\n"
GIVEN = {"gains.a.p": 630.0, "gains.a.i": 2.0, "gains.a.d": 12.0}
NOTHING_READ = "holds nothing that is read, neither gains.<joint>.p, .i and .d of a controller nor parameters of "


def read(tmp_path: Path, content: str) -> Parameters:
    """The parameters of a file with this content."""
    path = tmp_path / "p.yaml"
    path.write_text(content)
    return Parameters.of_files([path])


def gains_in(parameters: Parameters) -> dict[str, Any]:
    """What was taken."""
    return {name: value for name, value in parameters.given.items() if name.startswith("gains.")}


@pytest.mark.parametrize("section", ["arm", "/**", "/left/arm"])
def test_gains_that_are_taken(tmp_path: Path, section: str) -> None:
    """Of a controller, and of every node."""
    found = read(tmp_path, EFFORT.replace("arm", section))
    assert gains_in(found) == GIVEN
    assert found.notes == ()


@pytest.mark.parametrize(
    ("more", "note"),
    [
        (VELOCITY, "/wheels: gains.b.d, gains.b.p not taken: command_interfaces is velocity: gains beside it have the "
                   "unit 1/s, not N·m/rad; only those of a controller that commands effort are stiffness and damping"),
        (VELOCITY.replace("interfaces: [velocity]", "interface: b/velocity"), "command_interface is velocity"),
        (VELOCITY.replace("[velocity]", "[position]"), "gains beside it have the unit 1, not N·m/rad"),
        (ARRAYS, "/panda: p (a list of 2), k_q_d (a list of 2) look like gains, and gains.<joint>.p, .i and .d are "
                 "read, as in gains.a.p: 630.0"),
        ("drive: {ros__parameters: {pid: {b: {kp: 1.0}}}}", "/drive: pid.b.kp looks like a gain, and gains.<joint>.p"),
    ],
)  # fmt: skip
def test_gains_that_are_not_taken(tmp_path: Path, more: str, note: str) -> None:
    """Beside others they are a note; alone they are an error, for nothing of the file is used."""
    found = read(tmp_path, EFFORT + more)
    assert gains_in(found) == GIVEN
    assert len(found.notes) == 1
    assert note in found.notes[0]
    with pytest.raises(ParameterFileError) as refused:
        read(tmp_path, more)
    assert NOTHING_READ in str(refused.value)
    assert note in str(refused.value)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (EFFORT + EFFORT.replace("arm", "hand").replace("630", "700"),
         "gains.a.p is 630.0 in /arm and 700.0 in /hand: leave one of them out"),
        ("arm:\n  ros__parameters:\n    gains:\n      a: {p: 1.0}\n      a: {p: 2.0}\n",
         "must have 'a' once: it is in line 4 and in line 5"),
        (EFFORT + EFFORT, "must have 'arm' once: it is in line 1 and in line 2"),
        ("arm: {joints: [a], gains: {a: {p: 630.0, d: 12.0}}}",
         "holds no ros__parameters, which ROS 2 has between the name of a node and its parameters, as "
         "arm.gains.a.p (ROS 1 had not)"),
        ("gains: {a: {p: 630.0}}", "its parameters, as gains.a.p (ROS 1 had not)"),
        ("other: {ros__parameters: {update_rate: 100}}", NOTHING_READ),
        ("stickslip_monitor: {ros__parameters: {k_q_p: [1.0]}}",
         "parameter 'k_q_p' is not known; of gains, gains.<joint>.p, .i and .d are read"),
    ],
)  # fmt: skip
def test_files_that_are_refused(tmp_path: Path, content: str, text: str) -> None:
    """With what is wrong, and what would be right."""
    with pytest.raises(ParameterFileError) as refused:
        read(tmp_path, content)
    assert text in str(refused.value)
    assert str(refused.value).isprintable()


def test_the_same_gains_twice_are_no_contradiction(tmp_path: Path) -> None:
    """Nor is what is not set."""
    same = EFFORT + EFFORT.replace("arm", "hand") + "third: {ros__parameters: {gains: {a: {p: .nan}}}}"
    assert read(tmp_path, same).given["gains.a.d"] == 12.0


def test_what_is_not_used_stands_in_the_warnings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of an analysis; so do gains of joints none of which was recorded."""
    times = [1.0 + 0.01 * index for index in range(300)]
    rows = [("/joint_states", JOINT_STATE, t, joint_state(t, ("a",), position=[0.1 * t])) for t in times]
    bag = write_mcap(tmp_path / "a.mcap", rows)
    path = tmp_path / "p.yaml"

    def warnings(content: str) -> str:
        path.write_text(content)
        assert main(["analyze", str(bag), "--no-learning", "--json", "--parameters", str(path)]) == 0
        (found,) = json.loads(capsys.readouterr().out)["bags"]
        return " ".join(found["warnings"])

    assert "gains.b.d, gains.b.p not taken" in warnings(EFFORT + VELOCITY)
    assert "not used" not in warnings(EFFORT)
    unused = "the gains in --parameters are not used: they are of elbow, and none was recorded"
    assert unused in warnings(EFFORT.replace("a: {", "elbow: {"))


def test_gains_that_are_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--gains` and `convert` take the same numbers, the integral gain too, and refuse the same."""
    table = tmp_path / "a.csv"
    table.write_text("time,position\n" + "".join(f"{0.01 * index},{0.001 * index}\n" for index in range(300)))
    out, bare = tmp_path / "a.mcap", tmp_path / "bare.mcap"
    typed = ["--stiffness", "630", "--damping", "12", "--integral", "100"]
    assert main(["convert", str(table), "--out", str(out), *typed]) == 0
    assert main(["convert", str(table), "--out", str(bare)]) == 0
    for arguments in ([str(out)], [str(bare), "--gains", "630,12,100"]):
        capsys.readouterr()
        assert main(["analyze", "--no-learning", "--json", *arguments]) == 0
        (joint,) = json.loads(capsys.readouterr().out)["bags"][0]["joints"].values()
        assert joint["gains"] == {"stiffness": 630.0, "damping": 12.0, "integral": 100.0}
    rule = "must be finite and >= 0 (without the sign, if the motor counts against its joint)"
    for option, value in (("--stiffness", "-630"), ("--damping", "-1"), ("--integral", "inf")):
        given = [option, value] if option == "--stiffness" else ["--stiffness", "630", option, value]
        assert main(["convert", str(table), "--out", str(tmp_path / "no.mcap"), *given]) == 2
        assert f"{option!r} {rule}: {float(value)}" in capsys.readouterr().err
    for value in ("-630", "630,-1", "630,1,inf"):
        assert main(["analyze", str(bare), "--gains", value]) == 2
        assert f"'--gains' {rule}: {value}" in capsys.readouterr().err
    assert main(["convert", str(table), "--out", str(tmp_path / "no.mcap"), "--integral", "1"]) == 2
    assert "'--integral' must be given together with --stiffness" in capsys.readouterr().err


def test_names_that_look_like_gains() -> None:
    """Those of controllers that are about; others are none."""
    like = [
        "p",
        "pid.elbow.d",
        "k_q_p",
        "Kp",
        "k_p",
        "kv",
        "gains",
        "gains.p",
        "gains.a.k_i",
        "p_gains",
        "joint_stiffness",
    ]
    unlike = [
        "gains.a.p",
        "gains.a.i_clamp",
        "joints",
        "rate",
        "command_interfaces",
        "prefix.id",
        "gains_topic",
        "speed",
    ]
    assert gains_elsewhere([*like, *unlike]) == like


def test_what_a_controller_commands() -> None:
    """Efforts and what is of no kind that is known let gains be; other types of parameters are no texts."""
    assert texts_in(None) == texts_in(5.0) == texts_in([1.0, 2.0]) == []
    for kinds in (["effort"], ["position", "effort"], ["torque"], [], None, "elbow/effort", 7):
        assert why_not_taken({"command_interfaces": kinds}) == ""
    assert "position, velocity: gains beside it have the unit 1, 1/s" in why_not_taken(
        {"command_interfaces": ["position", "velocity"]}
    )
