# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whom the node tells of: all joints within a second, and at once where there is something to tell."""

from __future__ import annotations

import math
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given
from hypothesis import strategies as st
from nodes.forked_nodes import NodeProcess
from support_processes import processor_time
from support_ros import probe

from stickslip_ros.nodes.watched_joints import RoundRobin

JOINTS = [f"joint{number + 1}" for number in range(40)]
PERIOD = 0.04  # [s] from one publication to the next


@given(
    count=st.integers(1, 200),
    rate=st.sampled_from([1.0, 10.0, 25.0, 30.0, 100.0]),
    changes=st.lists(st.tuples(st.integers(0, 199), st.booleans()), max_size=60),
)
def test_every_joint_has_its_turn(count: int, rate: float, changes: list[tuple[int, bool]]) -> None:
    """News are told at the next publication, what is urgent within a tenth of a second, all else within a second."""
    round_robin = RoundRobin()
    change_tokens: dict[str, tuple[object, ...]] = {f"j{number}": (object(),) for number in range(count)}
    assert round_robin.due(change_tokens, (), 1.0 / rate) == (list(change_tokens), [])
    waits = dict.fromkeys(change_tokens, 0)
    urgent_for = 0
    for number, urgent in changes:
        # Urgent is always the same joint, and not always for long.
        name = f"j{0 if urgent else number % count}"
        if not urgent:
            change_tokens[name] = (object(),)
        reported, in_turn = round_robin.due(change_tokens, ["j0"] if urgent else (), 1.0 / rate)
        assert name in reported or urgent
        # What is new, or urgent, is no mere turn.
        assert set(in_turn) <= set(reported)
        assert urgent or name not in in_turn
        urgent_for = 0 if "j0" in reported or not urgent else urgent_for + 1
        assert urgent_for <= max(0, rate * 0.1 - 0.5)
        assert reported == [one for one in change_tokens if one in reported]
        waits = {one: 0 if one in reported else waits[one] + 1 for one in change_tokens}
        assert max(waits.values()) <= max(1, math.ceil(rate))
        # An arm's joints are always all there, and of many only a few.
        assert len(reported) >= (count if count <= 8 else 4)
        assert len(reported) <= 1 + (count if count <= 8 else max(4, math.ceil(count / rate)))


def test_a_joint_that_was_not_there_is_told_of_at_once() -> None:
    """So is one whose findings were others before; joints that are gone are forgotten."""
    round_robin = RoundRobin()
    change_tokens: dict[str, tuple[object, ...]] = dict.fromkeys(JOINTS, ("smooth",))
    round_robin.due(change_tokens, (), PERIOD)
    assert len(round_robin.due(change_tokens, (), PERIOD)[0]) == 4
    assert "new" in round_robin.due({**change_tokens, "new": ("smooth",)}, (), PERIOD)[0]
    del change_tokens["joint1"]
    assert "joint1" not in round_robin.due(change_tokens, (), PERIOD)[0]


def test_forty_joints_over_dds(ros_domain: int) -> None:
    """Issue 21: few joints in a message, all within a second; news at once; the tables have every joint."""
    gains = {f"gains.{name}.p": 630.0 for name in JOINTS}
    sizes: list[int] = []
    heard: dict[str, list[int]] = {name: [] for name in JOINTS}  # which of the messages told of the joint

    def take(message: DiagnosticArray) -> None:
        sizes.append(len(message.status))
        for status in message.status:
            heard.setdefault(status.hardware_id, []).append(sizes.count(4))

    with NodeProcess("monitor", {"joints": f"[{', '.join(JOINTS)}]", "state_file": "none", **gains}), probe() as one:
        one.wait_for_monitor()
        begin, sent, rate = time.time(), 0, 100.0

        def stand(seconds: float) -> None:
            nonlocal sent
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                while sent < (time.time() - begin) * rate:
                    # They all stand still at a count of their encoders.
                    one.publish(JOINTS, begin + sent / rate, position=[0.0] * len(JOINTS))
                    sent += 1
                one.spin(0.01)

        stand(3.0)
        assert set(one.margins) == set(JOINTS)
        assert {one.status(name) for name in JOINTS} == {"at_rest"}
        one.node.create_subscription(DiagnosticArray, "/diagnostics", take, 1000)
        stand(4.0)
        # A latecomer had every joint within one round, of ten messages, and each round again.
        for name in JOINTS:
            assert max(np.diff([0, *heard[name], sizes.count(4)])) <= 11, name
        # The node's own status is told first, with what is new; then a few of the joints in turn.
        assert sizes.count(1) > 50
        assert sizes.count(4) > 50
        took = []
        for stiffness in (700.0, 710.0, 720.0):  # a busy machine spoils one
            assert one.set_parameters("/stickslip_monitor", {"gains.joint33.p": stiffness}) == [""]
            changed = time.monotonic()
            while one.margins["joint33"]["stiffness"] != stiffness:
                assert time.monotonic() - changed < 60.0
                stand(0.02)
            took.append(time.monotonic() - changed)
        assert min(took) < 0.5
        assert one.margins["joint34"]["stiffness"] == 630.0


def test_idle_it_takes_next_to_nothing_and_wakes_at_once(ros_domain: int) -> None:
    """Issue 21: without messages statuses come once a second; with the first one all is as it was."""
    with NodeProcess("monitor", {"joints": "[joint1]", "state_file": "none"}) as monitor, probe() as one:
        one.wait_for_monitor()
        one.spin(3.0)
        stamps = one.stamps
        before, stamps[:] = processor_time(monitor.pid), []
        one.spin(5.0)
        assert 3 <= len(stamps) <= 7
        # Of a core 8 % were usual, on a machine on which 0.5 % is what it takes now.
        assert processor_time(monitor.pid) - before < 0.03 * 5.0
        # What ends the silence is not left waiting for the next of the rare statuses.
        stamps.clear()
        one.wait(lambda: bool(stamps), "a status")
        begin = time.time()
        one.publish(["joint1"], begin - 0.01, position=[0.0])
        one.wait(lambda: len(stamps) > 1, "the next status")
        assert stamps[1] - stamps[0] < 0.6
        for number in range(100):
            one.publish(["joint1"], begin + 0.01 * number, position=[0.0])
            one.spin(0.01)
        one.wait(lambda: one.status("joint1") not in ("", "unknown"), "the joint's status")
        stamps.clear()
        for number in range(100, 200):
            one.publish(["joint1"], begin + 0.01 * number, position=[0.0])
            one.spin(0.01)
        assert len(stamps) > 10
