# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 23, item 6: what compensation buys beside the advised gains, as the monitor publishes it."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
from nodes.forked_nodes import NodeProcess
from rclpy.qos import DurabilityPolicy, QoSProfile
from support_ros import probe

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.advice.compensations import CompensationQuestion, compensation_advice
from stickslip_ros.settings.known_joints import load_joint

_KNOWN = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false", "controller": "/simulated_joint"}


def test_what_compensation_buys_beside_the_advised_gains(ros_domain: int) -> None:
    """The numbers are those of the published speed and gains; a latecomer gets them too."""
    with NodeProcess("simulated_joint", {"rate": 250.0}), NodeProcess("monitor", _KNOWN), probe() as one:
        one.wait_for_monitor()
        heard: list[DiagnosticArray] = []
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        topic = "/stickslip_monitor/recommended_compensation"
        one.node.create_subscription(DiagnosticArray, topic, heard.append, qos)
        one.wait(lambda: len(heard) > 0, "what compensation buys")
        late: list[DiagnosticArray] = []
        one.node.create_subscription(DiagnosticArray, topic, late.append, qos)
        one.wait(lambda: len(late) > 0, "the same for who comes later")
    (status,) = heard[0].status
    assert status.hardware_id == "joint1"
    values = {pair.key: pair.value for pair in status.values}
    number = {key: float(text) for key, text in values.items() if not key.endswith("outcome")}
    joint = load_joint("puma560_joint1").joint
    gains = Gains(stiffness=number["stiffness [N*m/rad]"], damping=number["damping [N*m*s/rad]"])
    assert gains.damping > 100.0
    question = CompensationQuestion(
        joint=joint, gains=gains, velocity=number["velocity [rad/s]"], conditions=OperatingConditions(),
        resolution=0.0,
    )  # fmt: skip
    alone, forward, back = compensation_advice(question)
    assert values["gains alone: outcome"] == alone.effect.outcome.value  # type: ignore[union-attr]
    for label, one_kind in (("gains alone", alone), ("with feed-forward", forward)):
        peak = number[f"{label}: peak error at a reversal [rad]"]
        assert abs(peak - one_kind.effect.peak_error) < 0.02 * alone.effect.peak_error
    # Feed-forward helps where the joint turns round; feedback of a slow measured speed does not.
    assert number["with feed-forward: peak error at a reversal [rad]"] < 0.5 * alone.effect.peak_error
    assert number["with feedback: harmless share [1]"] < number["with feed-forward: harmless share [1]"]
    assert back.share == min(1.0, back.harmless)
    assert status.message.startswith("Feed-forward of 100 % of the friction: the error where the joint turns round is")
