# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Latched topics whose content takes a second to compute: `~/stability_map` and `~/recommended_compensation`.

Each is computed only while somebody listens, and again on change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import astuple
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CompressedImage

from stickslip_ros.monitoring.advice.compensations import CompensatedGains, CompensationQuestion, compensation_advice
from stickslip_ros.nodes.joints.watched_joints import WORTH_CHANGING
from stickslip_ros.nodes.publications import Findings, diagnostic_array_bytes, quiet_publisher, status_bytes
from stickslip_ros.nodes.slow_work import Background, SlowWork
from stickslip_ros.output.compensation import compensation_diagnosis, compensation_question
from stickslip_ros.output.stability_map import MapSubject, picture, subject_of

_REQUEST_EVERY = 10.0  # time between two questions on a joint, s: each takes a second of the slow process
_LATCHED = QoSProfile(depth=64, durability=DurabilityPolicy.TRANSIENT_LOCAL)

Question = TypeVar("Question")
Answer = TypeVar("Answer")
_MAP_CHANGE = 0.03  # relative change of a number, 1: a smaller one cannot be seen in a map
_COMPENSATION_CHANGE = 0.05  # relative change of a number, 1: a smaller one changes nothing of the rounded answer


class WhileListened(Generic[Question, Answer]):
    """Topic of the answers to one kind of question. A joint has an answer from when it first sticks or is at risk.

    One question at a time is computed, because each occupies the process for slow work for a second.

    Parameters
    ----------
    kind : name of the kind. answer : answers a question; a function of a module, which another process can import.
    question : makes a question of a joint's name and findings, None where there is none.
    numbers : values of a question that may differ a little between questions of one answer, and what may not differ.
    change : largest relative difference of such a value [1].
    message : makes a message of a joint's name, a question and its answer, or its bytes.
    """

    def __init__(
        self,
        node: LifecycleNode,
        work: SlowWork,
        topic: str,
        message_type: type,
        *,
        kind: str,
        answer: Callable[[Question], Answer],
        question: Callable[[str, Findings], Question | None],
        numbers: Callable[[Question], tuple[list[float], object]],
        change: float,
        message: Callable[[str, Question, Answer], Any],
    ) -> None:
        self._node = node
        self._question, self._numbers, self._change, self._message = question, numbers, change, message
        self._publisher = quiet_publisher(node, message_type, topic, _LATCHED)
        self._answers: Background[Question, Answer] = Background(work, kind, answer)
        self._shown: dict[str, Question] = {}
        self._requested = ""  # the joint whose question is under way
        self._listeners = 0

    def close(self) -> None:
        """Take the topic from the graph."""
        self._node.destroy_lifecycle_publisher(self._publisher)

    def attend(self, joints: Mapping[str, Findings], now: float) -> None:
        """Publish answers that are ready, and begin the next one that is due at a steady time [s]."""
        before, self._listeners = self._listeners, self._publisher.get_subscription_count()
        if self._listeners == 0:
            return
        if self._listeners > before:
            # Not every viewer requests the messages that were published before it came.
            self._shown.clear()
        for name in joints:
            known = self._answers.latest(name)
            if known is not None and self._shown.get(name) is not known[0]:
                self._publisher.publish(self._message(name, *known))
                self._shown[name] = known[0]
        if self._answers.under_way(self._requested):
            return
        for name, one in joints.items():
            question = self._due(name, one, now)
            if question is not None:
                self._answers.submit(name, question, now)
                self._requested = name
                return

    def _due(self, name: str, one: Findings, now: float) -> Question | None:
        """Question about a joint that is due, None if its answer is still good or it needs none."""
        known = self._answers.latest(name)
        if known is None and one.assessment.finding.status not in WORTH_CHANGING:
            return None
        if one.silent_for is not None or self._answers.age(name, now) < _REQUEST_EVERY:
            return None
        question = self._question(name, one)
        return None if known is not None and question is not None and self._similar(known[0], question) else question

    def _similar(self, one: Question, other: Question) -> bool:
        (numbers, fixed), (others, others_fixed) = self._numbers(one), self._numbers(other)
        return fixed == others_fixed and all(
            math.isclose(first, second, rel_tol=self._change) for first, second in zip(numbers, others, strict=True)
        )


def stability_maps(node: LifecycleNode, work: SlowWork) -> WhileListened[MapSubject, bytes]:
    """Topic of maps, pictures of where a joint sticks."""

    def message(name: str, _: MapSubject, image: bytes) -> CompressedImage:
        found = CompressedImage(format="png", data=image)
        found.header.stamp = node.get_clock().now().to_msg()
        found.header.frame_id = name
        return found

    return WhileListened(
        node, work, "~/stability_map", CompressedImage,
        kind="stability map", answer=picture, question=_subject, numbers=_map_numbers, change=_MAP_CHANGE,
        message=message,
    )  # fmt: skip


def _subject(name: str, one: Findings) -> MapSubject | None:
    return subject_of(name, one.assessment, one.assessment.velocity)


def _map_numbers(subject: MapSubject) -> tuple[list[float], object]:
    gains = [each for each in (subject.gains, subject.advised) if each is not None]
    numbers = [
        abs(subject.velocity),
        *subject.joint.numbers.values(),
        *(value for each in gains for value in astuple(each)),
    ]
    return [*map(float, numbers)], (subject.advised is None, subject.per_inertia, subject.joint.friction.law)


def recommended_compensation(
    node: LifecycleNode, work: SlowWork, robot: str
) -> WhileListened[CompensationQuestion, tuple[CompensatedGains, ...]]:
    """Topic of what friction compensation buys beside the advised gains; ``robot`` precedes the joints' names."""

    def message(name: str, question: CompensationQuestion, found: tuple[CompensatedGains, ...]) -> bytes:
        status = status_bytes(compensation_diagnosis(name, question, found), robot)
        return diagnostic_array_bytes(node.get_clock().now().to_msg(), [status])

    return WhileListened(
        node, work, "~/recommended_compensation", DiagnosticArray,
        kind="compensation", answer=compensation_advice, question=_compensation_question,
        numbers=_compensation_numbers, change=_COMPENSATION_CHANGE, message=message,
    )  # fmt: skip


def _compensation_question(_: str, one: Findings) -> CompensationQuestion | None:
    return compensation_question(one.assessment, one.assessment.velocity, one.conditions)


def _compensation_numbers(question: CompensationQuestion) -> tuple[list[float], object]:
    numbers = [question.velocity, *question.joint.numbers.values(), *astuple(question.gains)]
    return [*map(float, numbers)], (question.joint.friction.law, question.conditions)
