# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When advice is worked out again: at once after a while, seldom for what changes all the time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from conftest import LIMIT

from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion, ObservedLoop
from stickslip_ros.monitoring.advice.recommendation import Advice
from stickslip_ros.monitoring.assessment import AdviceQuestion
from stickslip_ros.nodes import slow_work
from stickslip_ros.nodes.slow_work import AdviceWorker, Background, SlowWork

pytestmark = pytest.mark.slow


@pytest.fixture
def work() -> Iterator[SlowWork]:
    """The process for slow work, and its end."""
    one = SlowWork(lambda text: None)
    yield one
    one.close()


def _answered(submit: Callable[[AdviceQuestion], Advice | None], question: AdviceQuestion, work: SlowWork) -> Advice:
    """The advice on a question that was asked, once it is there."""
    until = time.monotonic() + LIMIT
    while work.waiting:
        assert time.monotonic() < until
        time.sleep(0.01)
    advice = submit(question)
    assert advice is not None
    return advice


def test_what_changes_all_the_time_waits(puma: Joint, work: SlowWork, monkeypatch: pytest.MonkeyPatch) -> None:
    """Issue 21: the mean speed of a few slips differed by 1 to 2 % each time, and took 8 to 30 % of a core.

    Gains change all the time while they are applied, and friction that is learnt with every slip.
    """
    clock = [1000.0]
    monkeypatch.setattr(slow_work, "monotonic", lambda: clock[0])
    submit = AdviceWorker(work).adviser("joint1")

    # By Eq. (43) an answer takes milliseconds.
    question = AdviceQuestion(
        joint=puma, gains=Gains(stiffness=600.0), velocity=0.005, limits=AdviceLimits(condition=Criterion.PAPER),
        uncertainty=None, loop=ObservedLoop(), gains_known=True,
    )  # fmt: skip
    assert submit(question) is None
    assert work.waiting == 1
    latest = _answered(submit, question, work)

    learnt = replace(puma, friction=replace(puma.friction, stribeck=1.02 * puma.friction.stribeck))
    for changed in (replace(question, velocity=1.02 * question.velocity), replace(question, joint=learnt)):
        assert submit(changed) is latest
        assert work.waiting == 0
        clock[0] += 60.0
        assert submit(changed) is latest
        assert work.waiting == 1
        latest = _answered(submit, changed, work)
        assert latest.recommendation.velocity == pytest.approx(changed.velocity)

    # There is no advice for other gains, or at a speed that no answer was for, until it has been asked.
    for other in (replace(question, velocity=3.0 * question.velocity), replace(question, gains=Gains(stiffness=700.0))):
        assert submit(other) is None
        assert work.waiting == 0
        clock[0] += 60.0
        assert submit(other) is None
        assert work.waiting == 1
        _answered(submit, other, work)


def _busy(seconds: float) -> float:
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass
    return seconds


def test_all_joints_together_take_a_tenth_of_a_core(work: SlowWork) -> None:
    """Of two joints each asks again after twenty times what its answer took of a core, however long it waited."""
    background = Background(work, "busy", _busy)
    for name in "ab":
        background.submit(name, 0.2, 0.0)
    until = time.monotonic() + LIMIT
    while background.latest("a") is None or background.latest("b") is None:
        assert time.monotonic() < until
        time.sleep(0.01)
    for name in "ab":
        assert not background.is_due(name, 3.9)
        assert background.is_due(name, 6.0)
    assert background.is_due("c", 0.0)
