# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The service `~/apply_recommendation`: one joint after another, one call at a time."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import Trigger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.nodes.gains.deferred_service import Answer, DeferredService
from stickslip_ros.nodes.gains.gain_application import GainApplication, Outcome

_PATIENCE = 10.0  # [s] for advice that is being worked out


class RefusedError(StickSlipError):
    """There is nothing to apply, or it is not allowed; the text says why."""


class NotYetError(RefusedError):
    """The advice is being worked out; it is worth asking again in a moment."""


class ApplyService:
    """Answers when the gains have been written, or why they have not.

    Parameters
    ----------
    begin : the ramps to make; it may raise :class:`RefusedError`, and :class:`NotYetError` for some seconds.

    ``state`` and ``failed`` are for the diagnostics; ``outcomes`` hold the last message on each joint.
    """

    def __init__(self, node: Node, begin: Callable[[], list[GainApplication]]) -> None:
        self._node, self._begin = node, begin
        self._service = DeferredService(node, Trigger, "~/apply_recommendation", self._on_request)
        self._answer: Answer | None = None
        self._now = self._asked_at = 0.0
        self._queue: list[GainApplication] = []
        self._done: list[Outcome] = []
        self.outcomes: dict[str, str] = {}
        self.state = "not asked for yet"
        self.failed = False

    def tick(self, now: float) -> None:
        """Take requests and carry on with the ramps; ``now`` is a steady time [s]."""
        self._now = now
        self._service.take_all()
        if self._answer is not None and not self._queue:
            self._try_to_begin()
        if not self._queue:
            return
        current = self._queue[0]
        outcome = current.tick(now)
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

    def close(self) -> None:
        """Take the service from the graph."""
        self.stop("the monitor was cleaned up")
        self._service.close()

    def _on_request(self, _: Trigger.Request, answer: Answer) -> None:
        if self._answer is not None:
            joint = self._queue[0].joint if self._queue else "the advice"
            answer(Trigger.Response(success=False, message=f"refused: already at work on {joint}"))
            return
        self._answer, self._done, self._asked_at = answer, [], self._now

    def _try_to_begin(self) -> None:
        try:
            self._queue = self._begin()
        except NotYetError as refused:
            if self._now - self._asked_at > _PATIENCE:
                self._end(success=False, message=f"refused: {refused}")
        except RefusedError as refused:
            self._end(success=False, message=f"refused: {refused}")

    def _end(self, *, success: bool, message: str) -> None:
        self.state, self.failed = message, not success
        if self._answer is not None and self._node.context.ok():
            self._answer(Trigger.Response(success=success, message=message))
        self._answer = None
