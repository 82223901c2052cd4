# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Exact verdicts beside the node's own work: milliseconds, and seconds for some controllers, are too long there."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stickslip_ros.model.controlled import OperatingConditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.exact_question import NOT_COMPUTED, ExactQuestion
from stickslip_ros.nodes.worker.background import Background
from stickslip_ros.nodes.worker.process import SlowWork

_SAME_GAINS_INTERVAL = 5.0  # [s] between verdicts that only a change of speed asks for


@dataclass(frozen=True)
class _Dated:
    question: ExactQuestion
    at: float


def _answer(dated: _Dated) -> ExactVerdict:
    return dated.question.verdict()


class ExactWorker:
    """Asks again where gains or speed have changed."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[_Dated, ExactVerdict] = Background(work, "exact verdict", _answer)

    def verdict(self, name: str, question: ExactQuestion, now: float) -> ExactVerdict:
        """The verdict on a joint as it is now, or :data:`NOT_COMPUTED` until it is there.

        Parameters
        ----------
        name : under which the joint asks. now : a steady time [s].
        """
        known = self._background.latest(name)
        if known is None or not known[0].question.of_the_same_controller(question):
            self._background.submit(name, _Dated(question, now))
            return NOT_COMPUTED
        dated, verdict = known
        same_speed = dated.question.at_the_same_speed(question)
        if not dated.question.answers(question) and (
            dated.question.joint != question.joint or now - dated.at >= _SAME_GAINS_INTERVAL
        ):
            self._background.submit(name, _Dated(question, now))
        # Learning changes the friction with every slip: the verdict of a moment ago is the best there can be.
        return verdict if same_speed else NOT_COMPUTED

    def verdict_on(
        self, name: str, assessment: Assessment, gains: Gains | None, conditions: OperatingConditions, now: float
    ) -> ExactVerdict:
        """The verdict on a joint as it is assessed, with gains that need not be the present ones.

        Parameters
        ----------
        name : under which the joint asks. now : a steady time [s].
        """
        question = ExactQuestion.on(assessment, gains, conditions)
        return NOT_COMPUTED if question is None else self.verdict(name, question, now)

    def verdict_here(
        self, name: str, assessment: Assessment, conditions: OperatingConditions, now: float
    ) -> ExactVerdict | None:
        """Where friction is known to vary with place or load, the verdict at the present one; else None."""
        here = assessment.here
        if here is None:
            return None
        local = replace(assessment, joint=here, uncertainty=None)
        return self.verdict_on(name, local, local.margin_gains, conditions, now)
