# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the commands say of a contact that gives way (issue 23)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from stickslip_ros.cli.main import main
from stickslip_ros.settings.known_joints import load_joint

pytestmark = pytest.mark.slow

STIFFNESS = 3e4
FILE = f"""
name: elastic
inertia: 6.3
friction:
  coulomb: 8.43
  viscous: 4.94
  stribeck: 1.6
  stribeck_velocity: 0.0058
  rise_time: 0.5
  presliding_stiffness: {STIFFNESS}
  presliding_damping: 200
gains: {{stiffness: 630, damping: 0}}
velocity: 0.01
encoder_resolution: 2.5e-6
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A joint on an elastic contact that turns every ten seconds."""
    folder = tmp_path_factory.mktemp("elastic")
    (folder / "elastic.yaml").write_text(FILE)
    bag = str(folder / "arm.mcap")
    to_and_fro = ",".join(["0.01", "-0.01"] * 4)
    given = ["--model", str(folder / "elastic.yaml"), "--velocity", to_and_fro, "--duration", "40", "--rate", "500"]
    assert main(["simulate", "--out", bag, *given]) == 0
    return bag


def test_analyze_says_that_it_gives_way(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As a sentence, in JSON and in the table."""
    # With its friction given, no slip is studied.
    friction = ["--model", str(Path(bag).with_name("elastic.yaml"))]
    main(["analyze", bag, *friction, "--table", str(tmp_path / "table.csv")])
    text = capsys.readouterr().out
    assert "joint1 gives way at rest: presliding stiffness 3" in text
    assert "times the controller's stiffness (elasto_plastic)" in text
    main(["analyze", bag, *friction, "--json"])
    (found,) = json.loads(capsys.readouterr().out)["bags"]
    seen = found["joints"]["joint1"]["presliding"]
    assert seen["identified"]
    assert abs(seen["value"] - STIFFNESS) <= 1.96 * seen["std"]
    assert "presliding_stiffness_at_least" in (tmp_path / "table.csv").read_text().splitlines()[0]


def test_identify_says_so_and_offers_it_in_the_joint_file(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As comments, since a verdict with it is another one; without their marks the file is read with it."""
    path = tmp_path / "found.yaml"
    main(["identify", bag, "--stiffness", "630", "--out", str(path)])
    assert "The joint gives way at rest: presliding stiffness 3" in capsys.readouterr().out
    text = path.read_text()
    assert load_joint(str(path)).joint.friction.rigid
    assert "presliding_stiffness" not in yaml.safe_load(text)["friction"]
    path.write_text(text.replace("  # presliding", "  presliding").replace("  # contact", "  contact"))
    friction = load_joint(str(path)).joint.friction
    assert friction.contact == "elasto_plastic"
    assert abs(float(friction.presliding_stiffness) / STIFFNESS - 1.0) < 0.02
