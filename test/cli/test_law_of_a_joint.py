# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Commands about a joint of another friction law than the paper's: by its file, or by the option."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags.support_bags import read_joint
from conftest import nightly

from stickslip_ros.cli.main import main
from stickslip_ros.errors import JointFileError
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.outcome import outcomes
from stickslip_ros.monitoring.identification import Identification
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.settings.known_joints import KnownJoint, joint_file_text, load_joint

pytestmark = pytest.mark.slow

PUMA = load_joint("puma560_joint1")
OPERATING_POINT = "--stiffness 2016 --damping 0 --velocity 0.00493"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The paper's joint as if its friction fell exponentially."""
    text = joint_text("exponential")
    path = tmp_path / "exponential.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def joint_text(law: str) -> str:
    """A joint file of the paper's joint with another law."""
    joint = replace(PUMA.joint, friction=replace(PUMA.joint.friction, law="exponential"))
    found = Identification(
        slips=None,
        sliding=None,
        cycles=(),
        speed=0.00493,
        resolution=0.0,
        gains=None,
        state=JointMonitor().assessment(),
    )
    return joint_file_text("exponential", joint, found, PUMA.gains, "A test.").replace(
        "law: exponential", f"law: {law}"
    )


def output(capsys: pytest.CaptureFixture[str], command: str, status: int = 0) -> str:
    """What a command prints."""
    assert main(command.split()) == status
    return capsys.readouterr().out


def test_a_joint_file_keeps_the_law(file: Path) -> None:
    """Written and read again; the known joints are of the paper's law without saying so."""
    known = load_joint(str(file))
    assert isinstance(known, KnownJoint)
    assert known.joint.friction.law == "exponential"
    assert {**known.joint.friction.numbers} == pytest.approx(PUMA.joint.friction.numbers)
    assert PUMA.joint.friction.law == "hess_soom"


@pytest.mark.parametrize(
    "changes",
    [
        {"law": "exponential"},
        nightly(
            {"contact": "lugre", "presliding_stiffness": 63000.0, "presliding_damping": 630.0, "lag": 0, "rise_time": 0}
        ),
    ],
)
def test_what_is_identified_keeps_law_and_contact(
    changes: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The joint file had the paper's law and a rigid contact, whatever the slips were fitted with."""
    values = {"name": "other", "inertia": float(PUMA.joint.inertia), "gains": {"stiffness": 630.0}, "velocity": 0.005}
    values |= {"friction": {**PUMA.joint.friction.numbers, **changes}, "encoder_resolution": 2.5e-5}
    (tmp_path / "other.yaml").write_text(json.dumps(values), encoding="utf-8")
    output(
        capsys, f"simulate --model {tmp_path}/other.yaml --out {tmp_path}/bag.mcap --rate 250 --velocity 0.005,0.003"
    )
    output(capsys, f"identify {tmp_path}/bag.mcap --out {tmp_path}/found.yaml")
    friction = load_joint(f"{tmp_path}/found.yaml").joint.friction
    assert friction.law == changes.get("law", "hess_soom")
    assert friction.rigid is ("contact" not in changes)
    assert float(friction.stribeck_velocity) == pytest.approx(float(PUMA.joint.friction.stribeck_velocity), rel=0.02)
    if "contact" in changes:
        assert float(friction.presliding_stiffness) == pytest.approx(63000.0, rel=0.05)
        assert float(friction.lag) == 0.0


@pytest.mark.parametrize("law", ["gaussian", "3", "[exponential]", ""])
def test_an_unknown_law_in_a_joint_file_is_refused(law: str, tmp_path: Path) -> None:
    """The message names the file, and the laws that are known."""
    path = tmp_path / "unknown.yaml"
    path.write_text(joint_text(law), encoding="utf-8")
    with pytest.raises(JointFileError, match=r"unknown\.yaml: 'law' must be one of hess_soom, exponential: "):
        load_joint(str(path))


def test_margin(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Eq. (43) is not applicable, with the reason; the exact verdict is of the joint's own law."""
    text = output(capsys, f"margin --model {file} {OPERATING_POINT}")
    assert "not applicable, because it is of the paper's friction law (hess_soom), and this joint's is expo" in text
    assert "the joint sticks, as the model predicts by integration of Eqs (4)-(6)" in text
    assert re.search(r"ρ_c +0\.216", text)
    result: dict[str, Any] = json.loads(output(capsys, f"margin --model {file} {OPERATING_POINT} --json"))
    assert result["applicable"] is False
    assert result["smooth"] is None
    assert result["energy_margin"] is None
    known = load_joint(str(file))
    gains = replace(known.gains, stiffness=2016.0, damping=0.0)
    critical = exact_critical_damping_ratio(dimensionless_groups(known.joint, gains, 0.00493))
    assert result["exact"]["critical_damping_ratio"] == critical


def test_the_option_overrides_the_file(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``--law`` beside the other values that can be typed."""
    by_file = output(capsys, f"margin --model {file} {OPERATING_POINT} --json")
    by_option = output(capsys, f"margin --model puma560_joint1 --law exponential {OPERATING_POINT} --json")
    for key in ("critical_damping_ratio", "lowest_smooth_velocity", "least_smooth_stiffness"):
        assert json.loads(by_option)["exact"][key] == pytest.approx(json.loads(by_file)["exact"][key], rel=1e-2)
    papers = output(capsys, f"margin --model puma560_joint1 {OPERATING_POINT} --json")
    back = output(capsys, f"margin --model {file} --law hess_soom {OPERATING_POINT} --json")
    assert json.loads(back)["applicable"] is True
    assert json.loads(back)["energy_margin"] == pytest.approx(json.loads(papers)["energy_margin"], rel=1e-3)


def test_an_unknown_law_as_an_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """With the laws that are known."""
    with pytest.raises(SystemExit):
        main(["margin", "--model", "puma560_joint1", "--law", "gaussian"])
    said = capsys.readouterr().err
    assert "hess_soom" in said
    assert "exponential" in said


def test_recommend_is_by_the_exact_condition(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """There is advice, it holds for the law, and it says by what."""
    result = json.loads(output(capsys, f"recommend --model {file} {OPERATING_POINT} --json"))
    assert result["condition"] == "exact"
    assert result["exactly_smooth"] is True
    assert result["outcome"] == "steady"
    known = load_joint(str(file))
    gains = replace(known.gains, stiffness=result["stiffness"], damping=result["damping"])
    groups = dimensionless_groups(known.joint, gains, 0.00493)
    assert groups.damping_ratio >= 1.2 * exact_critical_damping_ratio(groups)
    assert outcomes(groups).steady
    assert all(math.isfinite(one["elasticity"]) for one in result["sensitivities"].values())
    text = output(capsys, f"recommend --model {file} {OPERATING_POINT}")
    assert text.startswith(
        "By the friction model (Eq. (43) does not hold for the law exponential) at 0.00493 rad/s: raise"
    )


def test_map_is_without_eq_43(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The exact boundary alone; nothing is said of a share of points that there is not."""
    output(capsys, f"map --model {file} {OPERATING_POINT} --points 100 --out {tmp_path / 'map.png'}")
    drawn = (tmp_path / "map.svg").read_text(encoding="utf-8")
    table = (tmp_path / "map.csv").read_text(encoding="utf-8")
    assert "stick-slip ends (integrated)" in table
    assert "by Eq. (43)" not in table
    assert "nan" not in drawn.casefold().split("<text", 1)[-1]


def test_simulate_and_analyze(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The recording is of the law; what analyzes it learns nothing of it and goes by what is configured."""
    bags = {}
    for name, law in (("file", file), ("paper", "puma560_joint1")):
        bags[name] = tmp_path / f"{name}.mcap"
        output(capsys, f"simulate --model {law} {OPERATING_POINT} --resolution 0 --duration 12 --out {bags[name]}")
    positions = [read_joint(bag, "joint1").position for bag in bags.values()]
    assert np.abs(positions[0] - positions[1]).max() > 1e-4
    analysis = json.loads(output(capsys, f"analyze {bags['file']} --model {file} --json"))
    joint = analysis["bags"][0]["joints"]["joint1"]
    assert joint["status"] == "stick_slip"
    assert joint["margin"]["applicable"] is False
    assert joint["margin"]["exact"]["smooth"] is False
    assert joint["recommendation"]["exactly_smooth"] is True
    said = output(capsys, f"analyze {bags['file']} --model {file}")
    assert "friction of the law exponential is not estimated" in said
    assert main(["identify", str(bags["file"]), "--prior", str(file)]) == 2
    assert "'--model' must be a joint of the law that is fitted, hess_soom: exponential" in capsys.readouterr().err
