# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Advice beside the node's own work: by Eq. (43) it takes ten milliseconds, exactly up to seconds."""

from __future__ import annotations

import math
from time import monotonic

from stickslip_ros.monitoring.advice.adviser import Advice, AdviceQuestion, Adviser, advise
from stickslip_ros.nodes.worker.background import Background
from stickslip_ros.nodes.worker.process import SlowWork

_SUBMIT_EVERY = 5.0  # [s] where the speed alone has changed
_SUBMIT_RARELY = 60.0  # [s] where it has by no more than the mean of a few cycles scatters, of which this is most
_SCATTER = 0.05


class AdviceWorker:
    """Advisers, one a joint."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[AdviceQuestion, Advice] = Background(work, "advice", advise)
        self._submitted_at: dict[str, float] = {}

    def adviser(self, name: str) -> Adviser:
        """What a joint's monitor asks: answers what is known already, or begins to work it out."""

        def latest(question: AdviceQuestion) -> Advice | None:
            known = self._background.latest(name)
            if known is not None and known[0].similar(question):
                return known[1]
            now = monotonic()
            rest = 0.0
            if known is not None and known[0].about_the_same(question):
                rest = _SUBMIT_RARELY if known[0].similar(question, _SCATTER) else _SUBMIT_EVERY
            if now - self._submitted_at.get(name, -math.inf) >= rest:
                self._background.submit(name, question)
                self._submitted_at[name] = now
            # Learning changes the friction with every slip, and the speed may never be the same twice: while the
            # gains are the same, the advice of a moment ago is the best there can be.
            return known[1] if known is not None and known[0].comparable(question) else None

        return latest
