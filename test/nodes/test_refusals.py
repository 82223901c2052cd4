# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node says of what it refused."""

from __future__ import annotations

from stickslip_ros.nodes.intake.refusals import Refusals


def test_a_refusal_is_in_the_status_for_a_minute() -> None:
    """Issue 40: what was refused once, at the start, was in the node's status as long as it ran."""
    logged: list[str] = []
    now = 0.0
    refuse = Refusals(logged.append, lambda: now)
    refuse("a name that is none")
    now = 50.0
    refuse("a message without positions", 2)
    assert refuse.latest == "a message without positions"
    now = 59.0
    refuse("a name that is none")
    now = 115.0
    assert refuse.latest == "a name that is none"
    now = 120.0
    assert refuse.latest == ""
    assert refuse.counts == {"a name that is none": 2, "a message without positions": 2}
    assert logged == ["refused: a name that is none", "refused: a message without positions"]
