# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Tables are made for those who listen, from the first status after they came."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time

from stickslip_ros.model.controlled import OperatingConditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.exact_question import UNKNOWN
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.nodes import publications
from stickslip_ros.nodes.publications import Findings, Publications

TABLES = ("~/margins", "~/friction", "~/recommended_gains")


class Topic:
    """A publisher whose listeners are counted by hand."""

    def __init__(self) -> None:
        self.listeners = 0
        self.messages: list[Any] = []

    def get_subscription_count(self) -> int:
        """As rclpy has it."""
        return self.listeners

    def publish(self, message: Any) -> None:
        """Keep it."""
        self.messages.append(message)


def test_tables_are_published_while_somebody_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each as soon as it has a listener, with every joint; statuses are published in any case."""
    topics: dict[str, Topic] = {}
    monkeypatch.setattr(publications, "quiet_publisher", lambda *args: topics.setdefault(args[2], Topic()))
    clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))
    node: Any = SimpleNamespace(get_clock=lambda: clock, get_namespace=lambda: "/")
    published = Publications(node)
    one = Findings(
        assessment=JointMonitor().assessment(), exact=UNKNOWN, trial=UNKNOWN, silent_for=None, trouble="", missing="",
        applied="", advised=Gains(stiffness=630.0), conditions=OperatingConditions(),
    )  # fmt: skip
    findings = dict.fromkeys(("joint1", "joint2"), one)
    published.publish_statuses(None, findings, findings, findings, warn_margin=0.1)
    published.publish_tables(findings, ["joint1"])
    assert len(topics["/diagnostics"].messages) == 1
    assert not any(topics[name].messages for name in TABLES)
    for number, name in enumerate(TABLES):
        topics[name].listeners = 1
        published.publish_tables(findings, ["joint1"])
        assert [len(topics[other].messages) for other in TABLES] == [*range(number + 1, 0, -1), *[0] * (2 - number)]
    assert topics["~/margins"].messages[0].layout.dim[0].label == "joint1,joint2"
