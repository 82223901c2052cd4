# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The topic `~/recommended_compensation`: what friction compensation buys beside the advised gains."""

from __future__ import annotations

import math
from dataclasses import astuple

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecycleNode

from stickslip_ros.monitoring.advice.compensations import CompensatedGains, CompensationQuestion, compensation_advice
from stickslip_ros.nodes.conversion import diagnostic_status
from stickslip_ros.nodes.publications import Findings
from stickslip_ros.nodes.while_listened import WhileListened
from stickslip_ros.nodes.worker.process import SlowWork
from stickslip_ros.output.compensation import compensation_diagnosis, compensation_question

_DISTINGUISHED = 0.05  # relative change of a number that changes the answer

Topic = WhileListened[CompensationQuestion, tuple[CompensatedGains, ...]]


def recommended_compensation(node: LifecycleNode, work: SlowWork, robot: str) -> Topic:
    """The topic; a robot's name stands before its joints'."""

    def message(name: str, question: CompensationQuestion, found: tuple[CompensatedGains, ...]) -> DiagnosticArray:
        array = DiagnosticArray(status=[diagnostic_status(compensation_diagnosis(name, question, found), robot)])
        array.header.stamp = node.get_clock().now().to_msg()
        return array

    return WhileListened(
        node, work, "~/recommended_compensation", DiagnosticArray,
        kind="compensation", answer=compensation_advice, question=_question, similar=_similar, message=message,
    )  # fmt: skip


def _question(_: str, one: Findings) -> CompensationQuestion | None:
    return compensation_question(one.assessment, one.assessment.velocity, one.conditions)


def _similar(one: CompensationQuestion, other: CompensationQuestion) -> bool:
    """Whether the answers to both would say the same."""
    if (one.joint.friction.law, one.conditions) != (other.joint.friction.law, other.conditions):
        return False
    pairs = zip(_numbers(one), _numbers(other), strict=True)
    return all(math.isclose(first, second, rel_tol=_DISTINGUISHED) for first, second in pairs)


def _numbers(question: CompensationQuestion) -> list[float]:
    gains = (float(value) for value in astuple(question.gains))
    return [question.velocity, *map(float, question.joint.numbers.values()), *gains]
