# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Exact verdicts beside the node's own work: milliseconds, and seconds for some controllers, are too long there."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.verdict import ExactVerdict, exact_verdict

UNKNOWN = ExactVerdict(smooth=None)
_SAME_SPEED = 0.02
_SAME_GAINS_INTERVAL = 5.0  # [s] between verdicts that only a change of speed asks for


@dataclass(frozen=True)
class _Question:
    joint: Joint
    gains: Gains
    conditions: Conditions
    speed: float
    asked_at: float


class ExactWorker:
    """One thread; each joint has at most one question under way, and asks again when it is answered."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="exact")
        self._running: dict[str, tuple[_Question, Future[ExactVerdict]]] = {}
        self._answers: dict[str, tuple[_Question, ExactVerdict]] = {}

    def verdict(
        self, name: str, joint: Joint, gains: Gains, conditions: Conditions, velocity: float, now: float
    ) -> ExactVerdict:
        """The verdict on a joint as it is now, or :data:`UNKNOWN` until it is there.

        Parameters
        ----------
        name : under which the joint asks. velocity : [rad/s]. now : a steady time [s].
        """
        question = _Question(joint, gains, conditions, abs(velocity), now)
        self._collect(name)
        known = self._answers.get(name)
        answer, wanted = UNKNOWN, True
        if known is not None and (known[0].joint, known[0].gains, known[0].conditions) == (joint, gains, conditions):
            if abs(known[0].speed - question.speed) <= _SAME_SPEED * question.speed:
                answer, wanted = known[1], False
            else:
                wanted = now - known[0].asked_at >= _SAME_GAINS_INTERVAL
        if wanted and name not in self._running:
            future = self._pool.submit(exact_verdict, joint, gains, question.speed, conditions)
            self._running[name] = (question, future)
        return answer

    def _collect(self, name: str) -> None:
        if name in self._running and self._running[name][1].done():
            question, future = self._running.pop(name)
            self._answers[name] = (question, future.result())

    def close(self) -> None:
        """Drop the questions not begun."""
        self._pool.shutdown(wait=False, cancel_futures=True)
