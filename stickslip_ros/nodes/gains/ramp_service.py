# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Services that change gains: one joint after another, one call at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from rclpy.node import Node
from std_srvs.srv import Trigger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.nodes.gains.deferred_service import Answer, DeferredService
from stickslip_ros.nodes.gains.gain_application import GainApplication, Outcome

_PATIENCE = 10.0  # [s] for advice that is being worked out

Begin = Callable[[], list[GainApplication]]


class RefusedError(StickSlipError):
    """There is nothing to apply, or it is not allowed; the text says why."""


class NotYetError(RefusedError):
    """The advice is being worked out; it is worth asking again in a moment."""


class RampService:
    """Answers when the gains have been written, or why they have not.

    Parameters
    ----------
    services : their names, and what makes the ramps of each; this may raise :class:`RefusedError`, and
        :class:`NotYetError` for some seconds.

    ``state`` and ``failed`` are for the diagnostics; ``outcomes`` hold the last message on each joint.
    """

    def __init__(self, node: Node, services: Mapping[str, Begin]) -> None:
        self._services = [
            DeferredService(node, Trigger, f"~/{name}", partial(self._on_request, name, begin))
            for name, begin in services.items()
        ]
        self._begin: Begin | None = None
        self._answer: Answer | None = None
        self._now = self._requested_at = 0.0
        self._queue: list[GainApplication] = []
        self._done: list[Outcome] = []
        self._name = ""
        self.outcomes: dict[str, str] = {}
        self.state = "not asked for yet"
        self.failed = False

    @property
    def busy(self) -> bool:
        """Whether a request is under way."""
        return self._answer is not None

    def tick(self, now: float) -> None:
        """Take requests and carry on with the ramps; ``now`` is a steady time [s]."""
        self._now = now
        for service in self._services:
            service.take_all()
        if self._answer is not None and not self._queue:
            self._try_to_begin()
        if not self._queue:
            return
        current = self._queue[0]
        outcome = current.tick()
        self.state = self.outcomes[current.joint] = current.state
        if outcome is None:
            return
        self._done.append(outcome)
        del self._queue[0]
        if self._queue and outcome.success:
            return
        messages = [done.message for done in self._done]
        messages += [f"{waiting.joint}: left as it is" for waiting in self._queue]
        self._queue.clear()
        self._end(success=outcome.success, message="; ".join(messages))

    def stop(self, why: str) -> None:
        """End what is under way; the gains stay as they are."""
        if self._answer is not None:
            left = [
                ramp.stop(why).message if n == 0 else f"{ramp.joint}: left as it is"
                for n, ramp in enumerate(self._queue)
            ]
            self._queue.clear()
            self._end(success=False, message="; ".join(left) or f"refused: {why}")

    def withdraw(self) -> None:
        """Take the permission away from what is under way, for good."""
        for ramp in self._queue:
            ramp.withdraw()

    def close(self) -> None:
        """Take the services from the graph."""
        self.stop("the monitor was cleaned up")
        for service in self._services:
            service.close()

    def _on_request(self, name: str, begin: Begin, _: Trigger.Request, answer: Answer) -> None:
        if self._answer is not None:
            joint = self._queue[0].joint if self._queue else "the advice"
            answer(Trigger.Response(success=False, message=f"refused: already at work on {joint}"))
            return
        self._name, self._begin = name, begin
        self._answer, self._done, self._requested_at = answer, [], self._now

    def _try_to_begin(self) -> None:
        assert self._begin is not None
        try:
            self._queue = self._begin()
        except NotYetError as refused:
            if self._now - self._requested_at > _PATIENCE:
                self._end(success=False, message=f"refused: {refused}")
        except RefusedError as refused:
            self._end(success=False, message=f"refused: {refused}")

    def _end(self, *, success: bool, message: str) -> None:
        self.state, self.failed = f"{self._name}: {message}", not success
        if self._answer is not None:
            self._answer(Trigger.Response(success=success, message=message))
        self._answer = None
