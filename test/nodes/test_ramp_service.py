# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Ramps of several joints that one request asks for: their order, and what is left after one that fails."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from std_srvs.srv import Trigger

from stickslip_ros.nodes.gains.gain_application import Outcome
from stickslip_ros.nodes.gains.ramps import Ramps
from stickslip_ros.nodes.kept_state import RampJournal


class Service:
    """A node and its service with one waiting request; ``answers`` has the responses."""

    def __init__(self) -> None:
        self.waiting, self.answers = [(Trigger.Request(), "header")], list[Any]()

    def create_service(self, *_: Any, **__: Any) -> Service:
        """The service itself."""
        return self

    @property
    def handle(self) -> Any:
        """What a request is taken from."""
        context = nullcontext(self)
        context.service_take_request = lambda _: self.waiting.pop() if self.waiting else (None, None)  # type: ignore[attr-defined]
        return context

    def get_parameter(self, _: str) -> Any:
        """Gains may be written."""
        return SimpleNamespace(value=True)

    def send_response(self, response: Any, _: Any) -> None:
        """Keep the response."""
        self.answers.append(response)


class Ramp:
    """A ramp that ends at its second step."""

    def __init__(self, joint: str, *, success: bool) -> None:
        self.joint, self.state, self._success, self.steps = joint, f"{joint} at work", success, 0

    def tick(self) -> Outcome | None:
        """One step."""
        self.steps += 1
        return Outcome(success=self._success, message=f"{self.joint}: done") if self.steps > 1 else None


@pytest.mark.parametrize("success", [True, False])
def test_after_a_ramp_that_fails_no_other_begins(success: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """One joint follows the other; where one fails, those that wait are left as they are, and the answer says so."""
    node, ramps = Service(), [Ramp("a", success=success), Ramp("b", success=True)]
    monkeypatch.setattr(Ramps, "_to_the_advice", lambda _: list(ramps))
    service = Ramps(node, {}, None, None, RampJournal(None))  # type: ignore[arg-type]
    for step in range(6):
        service.tick(0.1 * step)
        assert ramps[1].steps == 0 or ramps[0].steps == 2
    assert ramps[1].steps == (2 if success else 0)
    (answer,) = node.answers
    assert answer.success is success
    assert answer.message == ("a: done; b: done" if success else "a: done; b: left as it is")
