# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 39: a joint of two masses by its file or by options: commands, the monitor's parameters, diagnostics."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bags.support_bags import read_joint

from stickslip_ros.cli.main import main
from stickslip_ros.errors import JointFileError
from stickslip_ros.model.friction import Joint, Transmission
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.monitoring.identification import Identification
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.output.published import joint_values, published_joint
from stickslip_ros.settings.known_joints import joint_file_text, load_joint
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

PUMA = load_joint("puma560_joint1")
SPRING = Transmission(resonance=12.0, antiresonance=8.0, spring_damping=0.03, encoder="load")
JOINT = replace(PUMA.joint, transmission=SPRING)
OPTIONS = "--model puma560_joint1 --resonance 12 --antiresonance 8 --spring-damping 0.03 --encoder load"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The paper's joint on a spring, as a file that `identify` would write."""
    found = Identification(
        slips=None, sliding=None, cycles=(), speed=0.0058, resolution=0.0, gains=None,
        state=JointMonitor().assessment(),
    )  # fmt: skip
    path = tmp_path / "soft.yaml"
    path.write_text(joint_file_text("soft", found.joint(JOINT), found, PUMA.gains, "A test."), encoding="utf-8")
    return path


def test_a_joint_file_keeps_the_spring(file: Path) -> None:
    """What is identified keeps it, and the monitor's parameters have it, with another inertia too."""
    assert load_joint(str(file)).joint.transmission == SPRING
    found = Parameters({"model.joint1": str(file), "inertia.joint1": 9.0}).settings_of("joint1").joint
    assert found is not None
    assert (found.transmission, found.inertia) == (SPRING, 9.0)


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        ("resonance: 12 ", "resonance: 7 ", "'resonance' must be > the antiresonance, 8 Hz: 7"),
        ("antiresonance: 8 ", "# ", "'antiresonance' must be given beside resonance"),
        ("encoder: load", "encoder: wrist", "'encoder' must be one of motor, load: wrist"),
    ],
)
def test_what_a_file_cannot_have_is_refused(file: Path, before: str, after: str, text: str) -> None:
    """The error names the file, the value and what would be right."""
    file.write_text(file.read_text(encoding="utf-8").replace(before, after), encoding="utf-8")
    with pytest.raises(JointFileError, match=f"soft.yaml: {text}"):
        load_joint(str(file))


def test_simulate_has_the_motion_of_two_masses(file: Path, tmp_path: Path) -> None:
    """What is recorded is what the encoder on the load sees."""
    bag, count = tmp_path / "soft.mcap", 3000
    assert main(f"simulate --out {bag} --model {file} --duration 3 --resolution 0 --velocity 0.0058".split()) == 0
    expected = JointSimulation(JOINT, PUMA.gains).advance(
        1e-3, 0.0058e-3 * np.arange(count), np.full(count, 0.0058)
    )  # fmt: skip
    assert len(expected.event_rows) > 0
    np.testing.assert_allclose(read_joint(bag, "joint1").position, expected.position, atol=1e-12)


def test_file_and_options_give_one_answer(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Margin and advice; options override the file."""
    answers = []
    for joint in (f"--model {file} --coulomb 8.43", OPTIONS, f"--model {file} --encoder motor"):
        for command in ("margin", "recommend"):
            main(f"{command} {joint} --velocity 0.0058 --json".split())
            answers.append(json.loads(capsys.readouterr().out))
    assert answers[:2] == answers[2:4]
    assert answers[0]["reason"].endswith("this one has a resonance at 12 Hz")
    assert "which damping above" in answers[1]["resonance"]
    assert "which no damping excites" in answers[5]["resonance"]
    assert answers[5]["stiffness"] is not None


def test_an_option_needs_both_frequencies(capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused by its name."""
    assert main(["margin", "--model", "puma560_joint1", "--encoder", "load"]) == 2
    assert "--encoder has no effect here: it needs --resonance and --antiresonance" in capsys.readouterr().err


@pytest.mark.parametrize("joint", [JOINT, PUMA.joint])
def test_diagnostics_say_which_spring_the_monitor_believes_in(joint: Joint) -> None:
    """Who listens can compute with it."""
    found = published_joint({key: str(value) for key, value in joint_values(joint)})
    assert found is not None
    assert found.transmission == joint.transmission
