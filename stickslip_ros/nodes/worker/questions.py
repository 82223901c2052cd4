# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the process for slow work computes of each joint: advice, exact verdicts, and studies of slips.

Advice by Eq. (43) takes ten milliseconds, exact advice up to seconds; an exact verdict takes milliseconds, and seconds
for some controllers.
"""

from __future__ import annotations

from dataclasses import replace
from time import monotonic

from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.advice.adviser import Advice, AdviceQuestion, Adviser, advise
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.exact_question import NOT_COMPUTED, ExactQuestion
from stickslip_ros.monitoring.friction.learner import FrictionLearner
from stickslip_ros.monitoring.study import study
from stickslip_ros.nodes.worker.process import Background, SlowWork

_CHANGED_SPEED = 5.0  # time between two questions that differ in speed alone, s: a speed that ramps is no new case
_SCATTER = 0.05  # change of the speed, 1: the mean speed of a few cycles scatters by no more
_SCATTERED_SPEED = 60.0  # time between two questions whose speeds differ by the scatter, s: the advice is the same
_KIND = "study"


class AdviceWorker:
    """Advisers of the joints."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[AdviceQuestion, Advice] = Background(work, "advice", advise)

    def adviser(self, name: str) -> Adviser:
        """Adviser of a joint's monitor: returns the latest advice, and begins to compute new advice where it is due."""

        def latest(question: AdviceQuestion) -> Advice | None:
            known = self._background.latest(name)
            if known is not None and known[0].similar(question):
                return known[1]
            now = monotonic()
            rest = 0.0
            if known is not None and known[0].about_the_same(question):
                rest = _SCATTERED_SPEED if known[0].similar(question, _SCATTER) else _CHANGED_SPEED
            if self._background.age(name, now) >= rest:
                self._background.submit(name, question, now)
            # Learning changes the friction with every slip, and the speed may never be the same twice. While the
            # gains are the same, the latest advice is the best there can be.
            return known[1] if known is not None and known[0].comparable(question) else None

        return latest


class ExactWorker:
    """Exact verdicts by name, computed again where joint, gains or speed have changed."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[ExactQuestion, ExactVerdict] = Background(
            work, "exact verdict", ExactQuestion.verdict
        )

    def verdict_on(
        self, name: str, assessment: Assessment, gains: Gains | None, conditions: OperatingConditions, now: float
    ) -> ExactVerdict:
        """The verdict on an assessed joint, with gains that need not be the present ones.

        It is :data:`NOT_COMPUTED` until it is there.

        Parameters
        ----------
        name : name of the question. now : a steady time [s].
        """
        question = ExactQuestion.on(assessment, gains, conditions)
        if question is None:
            return NOT_COMPUTED
        known = self._background.latest(name)
        if known is None or not known[0].of_the_same_controller(question):
            self._background.submit(name, question, now)
            return NOT_COMPUTED
        before, verdict = known
        if not before.answers(question) and (
            before.joint != question.joint or self._background.age(name, now) >= _CHANGED_SPEED
        ):
            self._background.submit(name, question, now)
        # Learning changes the friction with every slip; the latest verdict is the best there can be.
        return verdict if before.at_the_same_speed(question) else NOT_COMPUTED

    def verdict_here(
        self, name: str, assessment: Assessment, conditions: OperatingConditions, now: float
    ) -> ExactVerdict | None:
        """The verdict at the present place or load, None where friction is not known to vary with these."""
        here = assessment.here
        if here is None:
            return None
        local = replace(assessment, joint=here, uncertainty=None)
        return self.verdict_on(name, local, local.margin_gains, conditions, now)


def attend_study(work: SlowWork, name: str, learner: FrictionLearner) -> None:
    """Pass a finished study to a joint's learner, and begin the next one that is due."""
    done = work.pop_result((_KIND, name))
    if done is not None:
        learner.adopt(done.answer)
    if learner.study_is_due and work.has_room((_KIND, name)):
        question = learner.wanted_study()
        if question is not None and not work.submit((_KIND, name), study, question):
            learner.adopt(None)
