# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34, item 12: arguments and files that ROS itself refuses are one line and exit status 2, no traceback."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.node import Node

from stickslip_ros.nodes.running import run


@pytest.mark.parametrize(
    "content",
    [
        "arm: {type: effort_controllers/JointTrajectoryController, joints: [a, b], gains: {a: {p: 100.0, d: 1.0}}}",
        "gains: {a: {p: 100.0, i: 0.1, d: 1.0}}",
        "arm:\n  gains:\n    a: {p: 100.0, d: 1.0}\n",
    ],
)
def test_a_parameter_file_of_ros_1(tmp_path: Path, content: str, capfd: pytest.CaptureFixture[str]) -> None:
    """The file is named, and what it lacks."""
    path = tmp_path / "controllers.yaml"
    path.write_text(content)
    assert run(lambda: Node("never_made"), ["--ros-args", "--params-file", str(path)]) == 2
    error = capfd.readouterr().err
    assert f"error: Couldn't parse params file: '--params-file {path}'. Error: " in error
    assert "ROS 2 has ros__parameters between the name of a node and its parameters, ROS 1 had not" in error
    assert ".c:" not in error
    assert "Traceback" not in error


def test_arguments_that_are_none(capfd: pytest.CaptureFixture[str]) -> None:
    """They are named."""
    for arguments, text in ((["-p", "a b"], "'-p a b'"), (["--bogus"], "unknown arguments of ROS: ['--bogus']")):
        assert run(lambda: Node("never_made"), ["--ros-args", *arguments]) == 2
        error = capfd.readouterr().err
        assert text in error
        assert "Traceback" not in error
