# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`~/friction_feedforward` and the simulated joint that takes it: what it cures, what it bounds, when it is silent."""

from __future__ import annotations

import math
import time

import pytest
from nodes.forked_nodes import NodeProcess
from sensor_msgs.msg import JointState
from support_ros import Probe, probe

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.messages.joint_states import seconds
from stickslip_ros.model.friction import Friction
from stickslip_ros.nodes.friction_feedforward import feedforward
from stickslip_ros.settings.parameters import Feedforward

TOPIC = "/stickslip_monitor/friction_feedforward"
TO_AND_FRO = {
    "rate": 400.0, "velocity.joint1": 0.01, "profile.joint1": "reverse", "reversal_period.joint1": 2.0,
    "gains.joint1.p": 6300.0, "gains.joint1.d": 40.0, "feedforward_topic": TOPIC,
}  # fmt: skip
KNOWN = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false"}
FRICTION = Friction(stribeck=1.6, stribeck_velocity=0.0058, coulomb=8.43, viscous=4.94)


class Torques:
    """What is published: stamps [s] and torques."""

    def __init__(self, one: Probe) -> None:
        self.heard: list[tuple[float, float]] = []
        one.node.create_subscription(JointState, TOPIC, self._hear, 1000)

    def _hear(self, message: JointState) -> None:
        assert list(message.name) == ["joint1"]
        self.heard.append((seconds(message.header.stamp), message.effort[0]))


def publish_reference(one: Probe, velocity: float) -> None:
    """One reference, of now."""
    message = JointState(name=["joint1"], position=[0.0], velocity=[velocity])
    message.header.stamp = one.node.get_clock().now().to_msg()
    one.references.publish(message)


class Errors:
    """How far the joint is behind its reference."""

    def __init__(self, one: Probe) -> None:
        self._one = one
        self._desired: dict[tuple[int, int], float] = {}
        self._sizes: list[float] = []
        one.node.create_subscription(JointState, "joint_references", self._desire, 1000)
        one.node.create_subscription(JointState, "joint_states", self._hear, 1000)

    def _desire(self, message: JointState) -> None:
        self._desired[message.header.stamp.sec, message.header.stamp.nanosec] = message.position[0]

    def _hear(self, message: JointState) -> None:
        desired = self._desired.pop((message.header.stamp.sec, message.header.stamp.nanosec), None)
        if desired is not None:
            self._sizes.append(abs(desired - message.position[0]))

    def mean(self, duration: float) -> float:
        """In the next seconds [rad]."""
        self._one.spin(0.5)
        self._sizes.clear()
        self._one.spin(duration)
        return sum(self._sizes) / len(self._sizes)


def test_from_off_to_on_to_off(ros_domain: int) -> None:
    """Issue 23: nothing until a share is set; bounded; the error falls; zero at once when switched off."""
    with NodeProcess("simulated_joint", TO_AND_FRO), NodeProcess("monitor", KNOWN), probe() as one:
        one.wait_for_monitor()
        torques, errors = Torques(one), Errors(one)
        one.wait(lambda: "reversal standing [s]" in one.diagnostics["joint1"][2], "a reversal to be measured")
        before = errors.mean(5.0)
        assert not torques.heard
        (refused,) = one.set_parameters("/stickslip_monitor", {"feedforward.joint1.share": 1.0})
        assert "'feedforward.joint1.largest' must be > 0 before a share is set: 0" in refused
        assert one.set_parameters("/stickslip_monitor", {"feedforward.joint1.largest": 2.0}) == [""]
        assert one.set_parameters("/stickslip_monitor", {"feedforward.joint1.share": 0.9}) == [""]
        for largest in (2.0, -2.0):
            one.wait(lambda: [torque for _, torque in torques.heard[-1:]] == [largest], "it both ways")  # noqa: B023
        assert max(abs(torque) for _, torque in torques.heard) == pytest.approx(2.0)
        assert one.set_parameters("/stickslip_monitor", {"feedforward.joint1.largest": 20.0}) == [""]
        after = errors.mean(5.0)
        assert max(abs(torque) for _, torque in torques.heard) == pytest.approx(0.9 * 8.88, rel=0.02)
        # On a busy machine the torque comes late, and takes less of the error.
        assert after < 0.75 * before
        assert one.set_parameters("/stickslip_monitor", {"feedforward.joint1.share": 0.0}) == [""]
        # By the stamps: on a busy machine what was published before is heard late.
        since = time.time()
        one.wait(lambda: torques.heard[-1][1] == 0.0, "the torque to be switched off")
        one.spin(0.5)
        assert not [torque for stamp, torque in torques.heard if stamp > since and torque]


def test_silent_references_and_unknown_friction(ros_domain: int) -> None:
    """Issue 23: zero where the reference stays away, and where nobody knows the friction."""
    told = {"feedforward.joint1.share": 1.0, "feedforward.joint1.largest": 20.0}
    with NodeProcess("monitor", {**KNOWN, **told}), probe() as one:
        one.wait_for_monitor()
        torques = Torques(one)
        for _ in range(100):
            publish_reference(one, 0.02)
            one.spin(0.02)
        assert max(torque for _, torque in torques.heard) > 8.0
        one.wait(lambda: {torque for _, torque in torques.heard[-5:]} == {0.0}, "no torque")
    with NodeProcess("monitor", {"joints": "[joint1]", **told}), probe() as one:
        one.wait_for_monitor()
        torques = Torques(one)
        for _ in range(50):
            publish_reference(one, 0.02)
            one.spin(0.02)
        assert torques.heard
        assert not any(torque for _, torque in torques.heard)


def test_the_torque() -> None:
    """Issue 23: the share of the steady friction, within the largest; none at rest, and no jump about it."""
    whole = Feedforward(share=1.0, largest=50.0)
    assert feedforward(whole, FRICTION, 0.02) == pytest.approx(8.43 + 1.6 / (1 + (0.02 / 0.0058) ** 2) + 4.94 * 0.02)
    assert feedforward(whole, FRICTION, -0.02) == -feedforward(whole, FRICTION, 0.02)
    assert feedforward(whole, FRICTION, 0.0) == 0.0
    assert feedforward(whole, FRICTION, math.nan) == 0.0
    # Issue 34, item 12: no reference has this velocity.
    assert feedforward(whole, FRICTION, 1e200) == 0.0
    assert abs(feedforward(whole, FRICTION, 1e-6)) < 0.05
    assert feedforward(Feedforward(share=1.0, largest=3.0), FRICTION, 0.02) == 3.0


@pytest.mark.parametrize(("share", "largest"), [(1.1, 5.0), (-0.1, 5.0), (math.nan, 5.0), (0.5, -1.0), (0.5, math.inf)])
def test_what_is_refused(share: float, largest: float) -> None:
    """Issue 23: more than all of the friction, and a torque that is no bound."""
    with pytest.raises(InvalidParameterError, match="feedforward"):
        Feedforward(share=share, largest=largest)
