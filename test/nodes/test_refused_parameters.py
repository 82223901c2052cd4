# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: parameters that cannot be are refused with the rule, at the start and while the node runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from stickslip_ros.errors import StickSlipError
from stickslip_ros.nodes import node_parameters
from stickslip_ros.nodes.kept_state import state_path
from stickslip_ros.nodes.node_parameters import refuse_by

JOINTS = "'joints' must be [''], or different names of at most 128 visible characters without blanks, commas and dots"
NOT_NEGATIVE = "must be finite and >= 0"
REFUSED: list[tuple[dict[str, object], str]] = [
    *(({"warn_margin": value}, f"'warn_margin' {NOT_NEGATIVE}") for value in (float("nan"), float("inf"), -1.0)),
    ({"wanted_margin": float("inf")}, f"'wanted_margin' {NOT_NEGATIVE}"),
    ({"least_motion": float("nan")}, f"'least_motion' {NOT_NEGATIVE}"),
    ({"confidence": 2.0}, "'confidence' must be >= 0.5 and < 1"),
    ({"condition": "guess"}, "'condition' must be one of paper, exact"),
    ({"gains.a.p": float("inf")}, "'gains.a.p' must be finite, or nan where it is not set"),
    *(({f"gains.a.{key}": -1.0, "gains.a.p": 1.0} | {f"gains.a.{key}": -1.0}, f"'gains.a.{key}' {NOT_NEGATIVE}")
      for key in "pid"),
    # Issue 34, item 13: 1/s are no N·m/rad.
    ({"gains.a.p": 3.0, "command_interfaces": ["velocity"]},
     "gains.a.p: command_interfaces is velocity: gains beside it have the unit 1/s, not N·m/rad"),
    ({"trial.a.p": -1.0}, f"'trial.a.p' {NOT_NEGATIVE}"),
    *(({"joints": names}, JOINTS) for names in (["a b"], ["a.b"], ["a", "a"], ["x" * 5000], ["a\x1b[2J"], ["a", ""])),
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def context() -> Iterator[None]:
    """ROS, in this process."""
    rclpy.init(args=[])
    yield
    rclpy.shutdown()


@pytest.mark.parametrize(("given", "rule"), REFUSED, ids=[str(given)[:40] for given, _ in REFUSED])
def test_at_the_start(given: dict[str, object], rule: str) -> None:
    """Also of joints that are not heard of yet."""
    node = Node("refusing", parameter_overrides=[Parameter(name, value=value) for name, value in given.items()])
    try:
        node_parameters.declare(node)
        with pytest.raises(StickSlipError) as refused:
            node_parameters.check(node)
        assert rule in str(refused.value)
        assert str(refused.value).isprintable()
    finally:
        node.destroy_node()


def test_while_it_runs() -> None:
    """What concerns every joint is refused although no joint is heard of; the value stays."""
    node = Node("refusing")
    try:
        node_parameters.declare(node)
        refuse_by(node, lambda changed: node_parameters.check(node, {one.name: one for one in changed}))
        for given, rule in REFUSED:
            for name, value in given.items():
                if name.endswith("margin") or name == "confidence":
                    before = node.get_parameter(name).value
                    (answer,) = node.set_parameters([Parameter(name, value=value)])
                    assert not answer.successful
                    assert rule in answer.reason
                    assert node.get_parameter(name).value == before
    finally:
        node.destroy_node()


@pytest.mark.parametrize("name", ["/dev/full", "/tmp"])
def test_state_files_are_regular_files(name: str) -> None:
    """Devices and folders are none."""
    node = Node("refusing", parameter_overrides=[Parameter("state_file", value=name)])
    try:
        node_parameters.declare(node)
        with pytest.raises(StickSlipError, match="the name of a regular file"):
            state_path(node)
    finally:
        node.destroy_node()
    assert Path(name).exists()
