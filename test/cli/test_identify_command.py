# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip identify` from recordings: what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, nightly
from mcap.writer import Writer
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from stickslip_ros.cli.main import main
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.settings.known_joints import load_joint

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the paper's joint at two speeds, as a CSV file with units in its header."""
    joint: Joint = load_joint("puma560_joint1").joint
    count, rate = 36_000, 1000.0
    velocities = np.where(np.arange(count) < count // 2, 0.0058, 0.011)
    references = np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    motion = JointSimulation(joint, Gains(stiffness=630.0)).advance(1.0 / rate, references, velocities)
    columns = (motion.time, 2.5e-5 * np.round(motion.position / 2.5e-5), references + velocities / rate)
    path = tmp_path_factory.mktemp("recording") / "waist.csv"
    np.savetxt(path, np.array(columns).T, "%.9g", ",", header="time_s,position_rad,reference_rad", comments="")
    return path


def test_a_recording_becomes_a_joint_file(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 4, item 6: from a recording, a joint file that loads and holds the truth, with errors and units."""
    out = tmp_path / "waist.yaml"
    assert main(["identify", str(table), "--stiffness", "630", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "identified" in printed
    assert "One direction only" in printed
    known = load_joint(str(out))
    assert known.name == "waist"
    assert known.joint.inertia == pytest.approx(6.3, rel=0.01)
    assert known.joint.friction.rise_time == pytest.approx(0.264, rel=0.03)
    assert known.gains.stiffness == 630.0
    assert known.encoder_resolution == pytest.approx(2.5e-5, rel=1e-6)
    text = out.read_text(encoding="utf-8")
    assert "# kg·m², ± 0.0" in text
    # A file that is there is never written over.
    with pytest.raises(SystemExit, match="2"):
        main(["identify", str(table), "--stiffness", "630", "--out", str(out)])
    assert "is there already" in capsys.readouterr().err
    assert out.read_text(encoding="utf-8") == text


def test_gains_unknown_print_the_groups(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 4, item 7: without gains the natural frequency and what is per inertia are printed, as JSON too."""
    assert main(["identify", str(table), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["per_inertia"]
    assert found["natural_frequency"] == pytest.approx(10.0, rel=0.02)
    assert "coulomb" not in found["friction"]
    assert found["friction"]["lag"]["value"] == pytest.approx(0.05, rel=0.05)


def test_without_gains_the_joint_file_is_per_inertia(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 5, item 5: what is known per inertia goes into a file that says so; advice from it is in factors."""
    out = tmp_path / "waist.yaml"
    assert main(["identify", str(table), "--out", str(out)]) == 0
    known = load_joint(str(out))
    assert known.per_inertia
    assert known.joint.inertia == 1.0
    assert float(known.gains.stiffness) == pytest.approx(100.0, rel=0.03)
    capsys.readouterr()
    assert main(["recommend", "--model", str(out), "--velocity", "0.0058"]) == 0
    advice = capsys.readouterr().out
    assert "damping × " in advice
    assert "N·m" not in advice
    # As a prior, which has an inertia, it will not do.
    assert main(["identify", str(table), "--prior", str(out)]) == 2
    assert "whose inertia is known" in capsys.readouterr().err


def test_a_bag_is_a_recording_too(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 4, item 6: the same motion from an MCAP bag with joint states and references, among other joints."""
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    bag = tmp_path / "waist.mcap"
    with bag.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/joint_references", "/joint_states")]
        for time, position, reference in rows:
            for channel, value in zip(channels, (reference, position), strict=True):
                message = JointState(name=["elbow", "waist"], position=[0.0, value])
                message.header.stamp = stamp(1.0 + time)
                when = round(1e9 * time)
                writer.add_message(channel, when, serialize_message(message), when)
        writer.finish()
    assert main(["identify", str(bag), "--on", "waist", "--stiffness", "630", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["friction"]["inertia"]["value"] == pytest.approx(6.3, rel=0.01)
    assert main(["identify", str(bag), "--on", "wrist", "--stiffness", "630"]) == 2
    assert "joints there: elbow, waist" in capsys.readouterr().err
    bag.write_bytes(b"no bag at all")
    assert main(["identify", str(bag)]) == 2
    assert str(bag) in capsys.readouterr().err


def test_gains_are_those_that_the_bag_has(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 40, item 6: `identify` takes recorded gains as `analyze` does, others by --gains in their place; the former
    names of its options go on working.
    """
    bag = str(tmp_path / "waist.mcap")
    assert main(["convert", str(table), "--out", bag, "--stiffness", "630"]) == 0

    def found(*options: str) -> dict[str, Any]:
        capsys.readouterr()
        assert main(["identify", bag, "--json", *options]) == 0
        return json.loads(capsys.readouterr().out)

    recorded = found("--joint", "joint1")
    assert not recorded["per_inertia"]
    assert recorded["friction"]["inertia"]["value"] == pytest.approx(6.3, rel=0.01)
    assert found("--gains-topic", "")["per_inertia"]
    twice = found("--gains", "1260")
    assert twice["friction"]["inertia"]["value"] == pytest.approx(12.6, rel=0.01)
    assert found("--on", "joint1", "--stiffness=1260") == twice
    assert main(["identify", bag, "--gains", "fast"]) == 2
    assert "'--gains' must be of the form 630" in capsys.readouterr().err


def test_motion_that_shows_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 4, item 6: a recording without slips and effort is status 1, in words."""
    path = tmp_path / "smooth.csv"
    rows = ["time_s,position_rad"] + [f"{0.01 * i},{1e-4 * i:.6g}" for i in range(1000)]
    path.write_text("\n".join(rows), encoding="utf-8")
    assert main(["identify", str(path)]) == 1
    assert "Friction could not be estimated" in capsys.readouterr().out


def test_a_plan_moves_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 4, item 6: --plan says every step and needs no joint."""
    assert main(["identify", "--controller", "/none", "--speeds", "0.01,0.02", "--plan"]) == 0
    said = capsys.readouterr().err
    assert "9 steps" in said
    assert "-0.02 rad/s" in said


def test_the_known_joints_say_how_to_contribute() -> None:
    """Issue 4, item 6: the folder of known joints has a README that names the command."""
    text = (ROOT / "config" / "joints" / "README.md").read_text(encoding="utf-8")
    assert "stickslip identify" in text


@pytest.mark.parametrize("kind", ["folder", "renamed folder", nightly("mcap")])
def test_a_bag_in_every_form(table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    """A folder as rosbag2 makes it is a bag as its file is, and says the same of the friction."""
    bag = tmp_path / ("waist.mcap" if kind == "mcap" else "waist")
    assert main(["convert", str(table), "--out", str(bag)]) == 0
    if kind == "renamed folder":
        (bag / "metadata.yaml").unlink()
        bag = bag.rename(tmp_path / "other")
    capsys.readouterr()
    assert main(["identify", str(bag), "--on", "joint1", "--stiffness", "630", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["friction"]["inertia"]["value"] == pytest.approx(6.3, rel=0.01)
