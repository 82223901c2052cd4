# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A latched topic of what takes a second to work out of a joint: made only while somebody listens, anew on change."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Generic, TypeVar

from rclpy.lifecycle import LifecycleNode
from rclpy.qos import DurabilityPolicy, QoSProfile

from stickslip_ros.nodes.joints.watched_joints import WORTH_CHANGING
from stickslip_ros.nodes.publications import Findings
from stickslip_ros.nodes.quiet_publisher import quiet_publisher
from stickslip_ros.nodes.worker.process import Background, SlowWork

_REQUEST_EVERY = 10.0  # [s] a joint
_LATCHED = QoSProfile(depth=64, durability=DurabilityPolicy.TRANSIENT_LOCAL)

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class WhileListened(Generic[Question, Answer]):
    """See the module. A joint has an answer from when it first sticks or is at risk.

    One question at a time is worked out, since each keeps the process for slow work for a second.

    Parameters
    ----------
    kind : of question, in words. answer : answers it; a function of a module, as another process has to find it.
    question : of a joint's name and findings, None where there is nothing to ask.
    alike : whether nobody could tell the answers to two questions apart.
    message : of a joint's name, a question and its answer, in the type of the topic.
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
        similar: Callable[[Question, Question], bool],
        message: Callable[[str, Question, Answer], Any],
    ) -> None:
        self._node = node
        self._question, self._similar, self._message = question, similar, message
        self._publisher = quiet_publisher(node, message_type, topic, _LATCHED)
        self._answers: Background[Question, Answer] = Background(work, kind, answer)
        self._requested_at: dict[str, float] = {}
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
            # Not every viewer asks for what was published before it came.
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
                self._answers.submit(name, question)
                self._requested_at[name], self._requested = now, name
                return

    def _due(self, name: str, one: Findings, now: float) -> Question | None:
        """What to ask of a joint, None if it needs no answer, or no other one."""
        known = self._answers.latest(name)
        if known is None and one.assessment.finding.status not in WORTH_CHANGING:
            return None
        if one.silent_for is not None or now - self._requested_at.get(name, -math.inf) < _REQUEST_EVERY:
            return None
        question = self._question(name, one)
        return None if known is not None and question is not None and self._similar(known[0], question) else question
