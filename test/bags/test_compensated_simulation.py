# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Recordings of a controller that compensates friction: what it cures, what not, and what too much does (issue 23)."""

from __future__ import annotations

from pathlib import Path

import pytest
from support_bags import KNOWN, WITHOUT_LEARNING

from stickslip_ros.analysis.analysis import analyze
from stickslip_ros.analysis.joint_analysis import JointAnalysis
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.cli.main import main
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.status import Status

STIFF, HARDLY_DAMPED = Gains(stiffness=6300.0, damping=200.0), Gains(stiffness=6300.0, damping=20.0)
TO_AND_FRO = (0.005, -0.005, 0.005, -0.005)


def analysis_of(
    folder: Path, gains: Gains, velocities: tuple[float, ...], duration: float, **shares: float
) -> JointAnalysis:
    """What is found in a recording of the known joint whose controller compensates these shares of its friction."""
    joint = RecordedJoint(
        joint=KNOWN.joint, gains=gains, velocities=velocities, encoder_resolution=KNOWN.encoder_resolution, **shares
    )
    path = folder / "arm.mcap"
    write_simulation(path, {"joint1": joint}, duration=duration, rate=500.0)
    return analyze(path, WITHOUT_LEARNING).joints["joint1"]


def test_feed_forward_shortens_what_a_reversal_costs(tmp_path: Path) -> None:
    plain = analysis_of(tmp_path, STIFF, TO_AND_FRO, 40.0).assessment.reversals
    most = analysis_of(tmp_path, STIFF, TO_AND_FRO, 40.0, feedforward=0.8).assessment.reversals
    assert plain is not None
    assert plain.count == 3
    assert most is not None
    assert most.standing < 0.2 * plain.standing
    assert most.peak_error < 0.4 * plain.peak_error
    all_of_it = analysis_of(tmp_path, STIFF, TO_AND_FRO, 40.0, feedforward=1.0).assessment.reversals
    assert all_of_it is not None
    assert all_of_it.count == plain.count == most.count
    assert all_of_it.standing == 0.0
    assert all_of_it.peak_error < 0.2 * plain.peak_error


@pytest.mark.parametrize("feedforward", [0.0, 1.0])
def test_feed_forward_cures_no_stick_slip(tmp_path: Path, feedforward: float) -> None:
    found = analysis_of(tmp_path, KNOWN.gains, (0.008,), 20.0, feedforward=feedforward)
    assert found.status is Status.STICK_SLIP


@pytest.mark.parametrize(("feedback", "status"), [(0.0, Status.AT_REST), (1.2, Status.STICK_SLIP)])
def test_feedback_of_too_much_hunts_where_the_joint_should_stand(
    tmp_path: Path, feedback: float, status: Status
) -> None:
    found = analysis_of(tmp_path, HARDLY_DAMPED, (0.02, 0.0), 20.0, feedback=feedback)
    assert found.segments[-1].status is status
    assert any(cycle.breakaway > found.start + 12.0 for cycle in found.cycles) == (feedback > 0.0)


@pytest.mark.parametrize("kind", ["feedforward", "feedback", "push"])
@pytest.mark.parametrize("share", ["-1", "nan", "inf"])
def test_a_share_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, share: str
) -> None:
    assert main(["simulate", "--out", str(tmp_path / "arm.mcap"), f"--{kind}={share}"]) == 2
    assert kind in capsys.readouterr().err
    assert not (tmp_path / "arm.mcap").exists()
    with pytest.raises(InvalidParameterError, match=kind):
        RecordedJoint(joint=KNOWN.joint, gains=STIFF, velocities=(0.0,), **{kind: float(share)})


def test_the_command_says_what_the_reversals_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = str(tmp_path / "arm.mcap")
    to_and_fro = ",".join(map(str, TO_AND_FRO))
    options = ["--stiffness", "6300", "--damping", "200", "--velocity", to_and_fro, "--duration", "40", "--rate", "500"]
    assert main(["simulate", "--out", bag, *options]) == 0
    assert main(["analyze", bag]) == 0
    assert "joint1 reversed 3 times: at a reversal it stands for 0.5" in capsys.readouterr().out
