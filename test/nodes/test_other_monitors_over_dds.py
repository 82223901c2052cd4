# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Two monitors on one graph: said of those that run, and not of those that were killed; no ramp beside another one.

By night: monitors that run, as in some starts Fast DDS never brings one of two what the other publishes.
"""

from __future__ import annotations

from contextlib import ExitStack

import pytest
from nodes.forked_nodes import NodeProcess
from support_ros import Probe, probe


def monitor(joints: str = "joint1", name: str = "stickslip_monitor") -> NodeProcess:
    parameters = {"joints": f"[{joints}]", "state_file": "none", "allow_apply": "true"}
    return NodeProcess("monitor", parameters, {"__node": name})


def own(one: Probe) -> str:
    """What the monitor says of itself; of several, whichever was heard last."""
    return one.diagnostics["stickslip_monitor"][1]


@pytest.mark.nightly
def test_two_monitors_of_one_name(ros_domain: int) -> None:
    """Both say so, once in the log, and refuse to ramp; until one of them has ended."""
    with monitor() as first, probe() as one:
        one.wait_for_monitor()
        with monitor() as second:
            for node, other in ((first, second), (second, first)):
                text = f"another monitor watches joint1 too: /stickslip_monitor (process {other.pid} on "
                one.wait(lambda node=node, text=text: text in node.output(), text)  # type: ignore[misc]
                one.wait(lambda text=text: text in own(one), text)  # type: ignore[misc]
            answer = one.answer("apply_recommendation")
            assert not answer.success
            assert "another monitor watches joint1 too, and may change its gains: /stickslip_mon" in answer.message
            one.spin(2.0)
            assert [node.output().count("another monitor") for node in (first, second)] == [1, 1]
        one.wait(lambda: "end one of them" not in own(one), "the end of it")
        assert "another monitor" not in one.answer("apply_recommendation").message


@pytest.mark.usefixtures("without_shared_memory")
def test_what_a_killed_monitor_leaves_is_no_monitor(ros_domain: int) -> None:
    """Its name stays on the graph for some seconds, in which its successor starts and says nothing of it."""
    with probe() as one:
        with monitor() as first:
            one.wait_for_monitor()
            first.kill()
        one.diagnostics.clear()
        with monitor() as second:
            one.wait_for_monitor()
            one.spin(4.0)
            assert "another monitor" not in second.output() + own(one)
            assert "another monitor" not in one.answer("apply_recommendation").message


@pytest.mark.nightly
def test_monitors_of_the_same_joint_or_name(ros_domain: int) -> None:
    """Joints in common and the name are said each; a monitor of other joints and another name is nobody's trouble."""
    others = {"second": ("b, a", "second"), "third": ("c", "stickslip_monitor"), "fourth": ("d", "fourth")}
    with monitor("a") as first, ExitStack() as stack, probe() as one:
        nodes = {name: stack.enter_context(monitor(*arguments)) for name, arguments in others.items()}
        texts = [
            f"another monitor watches a too: /second (process {nodes['second'].pid} on ",
            f"another monitor has this one's name: /stickslip_monitor (process {nodes['third'].pid} on ",
        ]
        one.wait(lambda: all(text in first.output() for text in texts), " and ".join(texts))
        one.spin(2.0)
        assert first.output().count("another monitor") == 2
        assert nodes["third"].output().count("another monitor") == 1
        assert "another monitor" not in nodes["fourth"].output()
