# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the node publishes and logs of its joints: diagnostics, margins, cycles, friction, advice.

`~/stability_map` and `~/recommended_compensation`, which take a second to compute, are latched: each is computed only
while somebody listens, and again on change.
"""

from __future__ import annotations

import math
from array import array as array_of
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass
from time import monotonic
from typing import Any, Generic, TypeVar

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CompressedImage, JointState
from std_msgs.msg import Float64MultiArray

from stickslip_ros.model.friction import Gains, steady_friction
from stickslip_ros.monitoring.advice.compensations import CompensatedGains, CompensationQuestion, compensation_advice
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.conversion import table
from stickslip_ros.nodes.slow_work import Background, SlowWork
from stickslip_ros.nodes.watched_joints import WORTH_CHANGING
from stickslip_ros.output.diagnosis import (
    Diagnosis,
    StatusBytes,
    compensation_diagnosis,
    compensation_question,
    cycle_diagnostic,
    diagnostic_array_bytes,
    joint_diagnostic,
    status_bytes,
    waiting_diagnostic,
)
from stickslip_ros.output.published import MARGIN_FIELDS, Findings, margin_row
from stickslip_ros.output.stability_map import MapSubject, picture, subject_of
from stickslip_ros.visible import visible

_APART = 10.0  # time between two lines on a joint, s: a person reads the log
_FURTHEST_APART = 600.0  # limit of that time, s: it doubles while the status goes on changing
_CALM = tuple(one.value for one in Status if one not in (Status.STICK_SLIP, Status.AT_RISK))
_LATCHED = QoSProfile(depth=64, durability=DurabilityPolicy.TRANSIENT_LOCAL)
Question = TypeVar("Question")
Answer = TypeVar("Answer")
_MAP_CHANGE = 0.03  # relative change of a number, 1: a smaller one cannot be seen in a map
_COMPENSATION_CHANGE = 0.05  # relative change of a number, 1: a smaller one changes nothing of the rounded answer


def quiet_publisher(node: LifecycleNode, message_type: type, topic: str, quality: Any) -> LifecyclePublisher:
    """Publisher that is silent while the node is inactive, and that has no events.

    By default a publisher has two events that only write a line to the log, and rclpy's executor goes through all
    events whenever it waits: they took half of the time of an idle monitor. A subscriber whose quality of service or
    type does not fit has the same line in its log.

    Parameters
    ----------
    quality : depth of the queue [1], or a quality of service.
    """
    without = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_lifecycle_publisher(message_type, topic, quality, event_callbacks=without)


@dataclass
class _Entry:
    """State of the log on a joint.

    Attributes
    ----------
    latest, before : the present word, and the word before the latest change; "" for none.
    at : time of the last line, a steady time [s]. changes : number of changes since then.
    apart : least time to the next line [s].
    """

    at: float
    latest: str = ""
    before: str = ""
    changes: int = 0
    apart: float = 0.0


class StatusLog:
    """Log of the joints' statuses: a line at each change to or from a status that is worth a warning.

    Changes before the next line may come are one line then, with their number. The time to the next line doubles as
    long as the status goes on changing.

    Parameters
    ----------
    warn, inform : write a line to the log.
    """

    def __init__(self, warn: Callable[[str], object], inform: Callable[[str], object]) -> None:
        self._warn, self._inform = warn, inform
        self._joints: dict[str, _Entry] = {}

    def note(self, joint: str, word: str, text: str, now: float) -> None:
        """Log the status of a joint, if it has changed.

        Parameters
        ----------
        word : word of the status, or why there is none. text : summary for a person. now : a steady time [s].
        """
        entry = self._joints.setdefault(joint, _Entry(now))
        if word != entry.latest and not (_is_calm(word) and _is_calm(entry.latest)):
            entry.before = entry.latest
            entry.changes += 1
        entry.latest = word
        if not entry.changes or now - entry.at < entry.apart:
            return
        if entry.changes == 1:
            entry.apart = _APART
            more = f" (was {entry.before})" if entry.before else ""
        else:
            entry.apart = min(2.0 * entry.apart, _FURTHEST_APART)
            more = f" ({entry.changes} changes in {now - entry.at:.0f} s)"
        entry.at, entry.changes = now, 0
        write = self._inform if _is_calm(word) else self._warn
        write(visible(f"{joint}: {text}{more}"))


def _is_calm(word: str) -> bool:
    return word in ("", *_CALM)


class Publications:
    """The node's publishers, which are silent while it is inactive; ``robot`` precedes the joints' names."""

    def __init__(self, node: LifecycleNode) -> None:
        self._node, self._clock = node, node.get_clock()
        space = node.get_namespace().strip("/")
        self.robot = f"{space}/" if space else ""
        self._statuses: dict[str, StatusBytes] = {}  # of each joint, as assessed last
        self._rows: dict[str, array_of[float]] = {}  # rows of `~/margins`, as assessed last
        # rclpy distinguishes callers by their lines of code, and refuses a caller that changes its level.
        self._log = StatusLog(
            warn=lambda line: node.get_logger().warning(line),
            inform=lambda line: node.get_logger().info(line),
        )
        self._diagnostics = quiet_publisher(node, DiagnosticArray, "/diagnostics", 10)
        self._margins = quiet_publisher(node, Float64MultiArray, "~/margins", 10)
        self._cycles = quiet_publisher(node, DiagnosticArray, "~/cycles", 1000)
        self._friction = quiet_publisher(node, JointState, "~/friction", 10)
        self._recommended = quiet_publisher(node, Float64MultiArray, "~/recommended_gains", 10)

    def close(self) -> None:
        """Remove the publishers from the graph."""
        for publisher in (self._diagnostics, self._margins, self._cycles, self._friction, self._recommended):
            self._node.destroy_lifecycle_publisher(publisher)

    def publish_cycles(self, found: Sequence[tuple[str, Cycle]]) -> None:
        """Publish a status for every completed cycle, with the name of its joint."""
        if found:
            self._publish_diagnoses(self._cycles, [cycle_diagnostic(name, cycle) for name, cycle in found])

    def publish_waiting(self, own: Diagnosis, joints: Iterable[str], reason: str) -> None:
        """Publish the status of the node, and for each joint why it has none yet."""
        self._publish_diagnoses(self._diagnostics, [own, *(waiting_diagnostic(name, reason) for name in joints)])

    def publish_statuses(
        self,
        own: Diagnosis | None,
        joints: Mapping[str, Findings],
        reported: Iterable[str],
        assessed: Iterable[str],
    ) -> None:
        """Publish one message with the status of the node, if given, and of the reported joints.

        Parameters
        ----------
        joints : findings on all joints. reported : names of joints to report now.
        assessed : names of joints whose findings may have changed since their last report.
        """
        warn_margin = float(self._node.get_parameter("warn_margin").value)
        for name in assessed:
            one = joints.get(name)
            if one is None:
                continue
            diagnosis = joint_diagnostic(name, one, warn_margin)
            self._log.note(name, one.trouble or one.assessment.finding.status.value, diagnosis.message, monotonic())
            self._statuses[name] = status_bytes(diagnosis, self.robot)
            self._rows[name] = array_of("d", margin_row(one))
        statuses = [self._statuses[name] for name in reported if name in joints]
        if own is not None:
            statuses.insert(0, status_bytes(own, self.robot))
        if statuses:
            self._diagnostics.publish(diagnostic_array_bytes(self._clock.now().nanoseconds, statuses))

    def publish_tables(
        self, joints: Mapping[str, Findings], reported: Sequence[str], advised: Mapping[str, Gains | None]
    ) -> None:
        """Publish the numbers, each table only while somebody listens: later listeners would not get it.

        Parameters
        ----------
        joints : findings on all joints, because `~/margins` and `~/recommended_gains` always have every joint.
        reported : names of joints to report on `~/friction` now.
        advised : recommended gains of each joint in the controller's units, None if there are none.
        """
        if not joints:
            return
        if _has_listeners(self._friction):
            now = {name: joints[name].assessment for name in reported if name in joints}
            if now:
                self._friction.publish(_friction_message(self._clock.now().to_msg(), now))
        if _has_listeners(self._margins):
            rows = array_of("d")
            for name in joints:
                rows.extend(self._rows[name])
            self._margins.publish(table(list(joints), MARGIN_FIELDS, rows))
        if _has_listeners(self._recommended):
            gains = {name: found for name in joints if (found := advised.get(name)) is not None}
            if gains:
                values = [float(value) for one in gains.values() for value in (one.stiffness, one.damping)]
                self._recommended.publish(table(list(gains), ("p", "d"), values))

    def _publish_diagnoses(self, topic: LifecyclePublisher, diagnoses: Iterable[Diagnosis]) -> None:
        statuses = [status_bytes(one, self.robot) for one in diagnoses]
        topic.publish(diagnostic_array_bytes(self._clock.now().nanoseconds, statuses))


def _has_listeners(publisher: LifecyclePublisher) -> bool:
    """Whether anybody would get a message that is published now."""
    return bool(publisher.get_subscription_count())


def _friction_message(time: Time, assessments: Mapping[str, Assessment]) -> JointState:
    """Friction of every joint at its speed, by the friction that its margin uses; NaN where none is known."""
    message = JointState(name=list(assessments))
    message.header.stamp = time
    for assessment in assessments.values():
        message.position.append(assessment.position)
        message.velocity.append(assessment.mean_velocity)
        joint, friction = assessment.joint, math.nan
        if joint is not None and not assessment.per_inertia and math.isfinite(assessment.mean_velocity):
            friction = float(steady_friction(joint.friction, assessment.mean_velocity))
        message.effort.append(friction)
    return message


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
        if one.silent_for is not None or not self._answers.is_due(name, now):
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
        kind="stability map", answer=picture,
        question=lambda name, one: subject_of(name, one.assessment, one.assessment.velocity),
        numbers=_map_numbers, change=_MAP_CHANGE, message=message,
    )  # fmt: skip


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
        return diagnostic_array_bytes(node.get_clock().now().nanoseconds, [status])

    return WhileListened(
        node, work, "~/recommended_compensation", DiagnosticArray,
        kind="compensation", answer=compensation_advice,
        question=lambda _, one: compensation_question(one.assessment, one.assessment.velocity, one.conditions),
        numbers=_compensation_numbers, change=_COMPENSATION_CHANGE, message=message,
    )  # fmt: skip


def _compensation_numbers(question: CompensationQuestion) -> tuple[list[float], object]:
    numbers = [question.velocity, *question.joint.numbers.values(), *astuple(question.gains)]
    return [*map(float, numbers)], (question.joint.friction.law, question.conditions)
