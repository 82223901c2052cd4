# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When advice is worked out again: at once for another joint, rarely for a speed that only scatters."""

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
from stickslip_ros.nodes.slow_work import AdviceWorker, SlowWork

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


def test_a_speed_that_scatters_is_asked_about_once_a_minute(
    puma: Joint, work: SlowWork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Issue 21: the mean speed of a few slips differed by 1 to 2 % each time, and took 8 to 30 % of a core."""
    clock = [1000.0]
    monkeypatch.setattr(slow_work, "monotonic", lambda: clock[0])
    submit = AdviceWorker(work).adviser("joint1")

    # By Eq. (43) an answer takes ten milliseconds.
    question = AdviceQuestion(
        joint=puma, gains=Gains(stiffness=600.0), velocity=0.005, limits=AdviceLimits(condition=Criterion.PAPER),
        uncertainty=None, loop=ObservedLoop(), gains_known=True,
    )  # fmt: skip
    assert submit(question) is None
    assert work.waiting == 1
    first = _answered(submit, question, work)

    scattered = replace(question, velocity=1.02 * question.velocity)
    for clock[0] in (1001.0, 1020.0, 1059.0):
        assert submit(scattered) is first
        assert work.waiting == 0
    clock[0] = 1061.0
    assert submit(scattered) is first
    assert work.waiting == 1
    again = _answered(submit, scattered, work)
    assert again.recommendation.velocity == pytest.approx(scattered.velocity)

    # A speed that is another one is not kept waiting so long, another joint not at all.
    faster = replace(question, velocity=1.2 * question.velocity)
    clock[0] = 1064.0
    assert submit(faster) is again
    assert work.waiting == 0
    clock[0] = 1067.0
    assert submit(faster) is again
    assert work.waiting == 1
    _answered(submit, faster, work)
    assert submit(replace(faster, gains=Gains(stiffness=700.0))) is None
    assert work.waiting == 1
