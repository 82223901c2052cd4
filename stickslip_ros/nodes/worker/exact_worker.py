# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Exact verdicts beside the node's own work: milliseconds, and seconds for some controllers, are too long there."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip_ros.model.controlled import Conditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.verdict import ExactVerdict, exact_verdict
from stickslip_ros.nodes.worker.background import Background
from stickslip_ros.nodes.worker.process import SlowWork

UNKNOWN = ExactVerdict(smooth=None)
_SAME_SPEED = 0.02
_SAME_GAINS = 0.01
_SAME_GAINS_INTERVAL = 5.0  # [s] between verdicts that only a change of speed asks for


@dataclass(frozen=True)
class _Question:
    joint: Joint
    gains: Gains
    conditions: Conditions
    speed: float
    asked_at: float

    def of_the_same_controller(self, other: _Question) -> bool:
        """Whether conditions and gains are the same, the latter but for what learning makes of them per inertia."""
        pairs = [(getattr(self.gains, name), getattr(other.gains, name)) for name in vars(self.gains)]
        near = all(abs(float(one) - float(two)) <= _SAME_GAINS * abs(float(two)) for one, two in pairs)
        return near and self.conditions == other.conditions


def _answer(question: _Question) -> ExactVerdict:
    return exact_verdict(question.joint, question.gains, question.speed, question.conditions)


class ExactWorker:
    """Asks again where gains or speed have changed."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[_Question, ExactVerdict] = Background(work, "exact verdict", _answer)

    def verdict(
        self, name: str, joint: Joint, gains: Gains, conditions: Conditions, velocity: float, now: float
    ) -> ExactVerdict:
        """The verdict on a joint as it is now, or :data:`UNKNOWN` until it is there.

        Parameters
        ----------
        name : under which the joint asks. velocity : [rad/s]. now : a steady time [s].
        """
        question = _Question(joint, gains, conditions, abs(velocity), now)
        known = self._background.latest(name)
        if known is None or not known[0].of_the_same_controller(question):
            self._background.ask(name, question)
            return UNKNOWN
        same_speed = abs(known[0].speed - question.speed) <= _SAME_SPEED * question.speed
        if known[0].joint != joint or (not same_speed and now - known[0].asked_at >= _SAME_GAINS_INTERVAL):
            self._background.ask(name, question)
        # Learning changes the friction with every slip: the verdict of a moment ago is the best there can be.
        return known[1] if same_speed else UNKNOWN
