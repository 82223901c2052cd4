# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The services that change gains, `~/apply_recommendation` and `~/restore_gains`: which ramps they begin, and may.

One joint follows the other, one call the other. A service answers when its ramps have ended, seconds later: in Jazzy a
coroutine as a service's callback would keep the executor spinning at full load until it answers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from time import monotonic
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from stickslip_ros.errors import StickSlipError
from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.nodes.gains.gain_application import GainApplication, MotionWatch, Outcome
from stickslip_ros.nodes.gains.gain_intake import GainIntake
from stickslip_ros.nodes.intake.arrivals import NeverExecuted
from stickslip_ros.nodes.kept_state import RampJournal, UnfinishedRamp
from stickslip_ros.nodes.other_monitors import OtherMonitors
from stickslip_ros.nodes.watched_joints import WatchedJoint

APPLY, RESTORE = "apply_recommendation", "restore_gains"
_PATIENCE = 10.0  # time until advice has been computed, s: a client waits no longer for an answer

Answer = Callable[[Any], None]


class DeferredService:
    """A service whose requests wait until they are drained, and then for their answer.

    Parameters
    ----------
    on_request : called with a request and a function that sends its answer, once.
    """

    def __init__(self, node: Node, service_type: Any, name: str, on_request: Callable[[Any, Answer], None]) -> None:
        self._node, self._type = node, service_type
        self._on_request = on_request
        self._service = node.create_service(
            service_type, name, lambda _, response: response, callback_group=NeverExecuted()
        )

    def take_all(self) -> None:
        """Drain the waiting requests, oldest first."""
        while True:
            with self._service.handle:
                request, header = self._service.handle.service_take_request(self._type.Request)
            if header is None:
                return
            self._on_request(request, partial(self._send, header))

    def close(self) -> None:
        """Take the service from the graph."""
        self._node.destroy_service(self._service)

    def _send(self, header: Any, response: Any) -> None:
        self._service.send_response(response, header)


class RefusedError(StickSlipError):
    """A request without anything to apply, or without permission; the text has the reason."""


class NotYetError(RefusedError):
    """A request that is too early, because the advice is being computed."""


class Ramps:
    """Ramps of the watched joints' gains, by request and permission, one after the other.

    A request is answered when its ramps have ended or are refused.

    Parameters
    ----------
    node : has the services and the parameters. joints : watched joints. gains : has their controllers.
    others : other monitors, which may change the same gains. journal : of unfinished ramps.

    ``state`` and ``failed`` are for the diagnostics; ``outcomes`` has the last message on each joint.
    """

    def __init__(
        self,
        node: Node,
        joints: Mapping[str, WatchedJoint],
        gains: GainIntake,
        others: OtherMonitors,
        journal: RampJournal,
    ) -> None:
        self._node, self._joints, self._gains = node, joints, gains
        self._others, self._journal = others, journal
        if self._journal.trouble:
            node.get_logger().warning(self._journal.trouble)
        self._logged: set[str] = set()
        self._ramps_of: dict[str, Callable[[], list[GainApplication]]] = {
            APPLY: self._to_the_advice,
            RESTORE: self._back,
        }
        self._services = [
            DeferredService(node, Trigger, f"~/{name}", partial(self._on_request, name)) for name in self._ramps_of
        ]
        self._answer: Answer | None = None
        self._now, self._not_yet, self._requested_at = 0.0, "", 0.0
        self._queue: list[GainApplication] = []
        self._done: list[Outcome] = []
        self._name = ""
        self.outcomes: dict[str, str] = {}
        self.state = "not asked for yet"
        self.failed = False

    @property
    def busy(self) -> bool:
        """Whether a request is under way, so that samples have to be processed at once."""
        return self._answer is not None

    def tick(self, now: float, not_yet: str = "") -> None:
        """Drain requests and continue the ramps.

        Parameters
        ----------
        now : a steady time [s]. not_yet : why nothing can be judged yet, "" if it can.
        """
        self._now, self._not_yet = now, not_yet
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
        """End the ramps; the gains stay as they are."""
        if self._answer is not None:
            left = [
                ramp.stop(why).message if n == 0 else f"{ramp.joint}: left as it is"
                for n, ramp in enumerate(self._queue)
            ]
            self._queue.clear()
            self._end(success=False, message="; ".join(left) or f"refused: {why}")

    def withdraw(self) -> None:
        """Withdraw the permission of the present ramps, for good."""
        for ramp in self._queue:
            ramp.withdraw()

    def close(self) -> None:
        """Take the services from the graph."""
        self.stop("the monitor was cleaned up")
        for service in self._services:
            service.close()

    def _on_request(self, name: str, _: Trigger.Request, answer: Answer) -> None:
        if self._answer is not None:
            joint = self._queue[0].joint if self._queue else "the advice"
            answer(Trigger.Response(success=False, message=f"refused: already at work on {joint}"))
            return
        self._name, self._answer, self._done, self._requested_at = name, answer, [], self._now

    def _try_to_begin(self) -> None:
        try:
            if self._not_yet:
                raise NotYetError(self._not_yet)
            if not self._node.get_parameter("allow_apply").value:
                raise RefusedError("allow_apply is false; set it to true where gains may be written")
            self._queue = self._ramps_of[self._name]()
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

    @property
    def trouble(self) -> str:
        """Faults for the diagnostics, "" if there are none."""
        troubles = [self._journal.trouble]
        if not self.busy:
            troubles += [self.state if self.failed else ""]
            troubles += [self._unfinished(ramp) for ramp in self._journal.values()]
        return "; ".join(trouble for trouble in troubles if trouble)

    def hear_gains(self, joint: WatchedJoint) -> None:
        """Remove a cut-off ramp from the journal, if the gains are those before it or off its way; else warn once."""
        ramp = self._journal.get(joint.name)
        gains = joint.monitor.gains
        if ramp is None or gains is None or self.busy or self._controller_name(joint.name) != ramp.controller:
            return
        now = GainPair.from_si(gains, joint.settings.gain_scale)
        if now.same(ramp.before) or not now.between(ramp.before, ramp.target):
            self._journal.end(joint.name)
            self._node.get_logger().info(f"{joint.name} has {now} now; the ramp that was cut off is forgotten")
        elif joint.name not in self._logged:
            self._logged.add(joint.name)
            self._node.get_logger().warning(self._unfinished(ramp))

    def _unfinished(self, ramp: UnfinishedRamp) -> str:
        joint = self._joints.get(ramp.joint)
        gains = joint.monitor.gains if joint is not None else None
        now = ""
        if joint is not None and gains is not None:
            now = f", now {GainPair.from_si(gains, joint.settings.gain_scale)}"
        return (
            f"a ramp of {ramp.joint}'s gains in {ramp.controller}, begun {ramp.begun}, did not come to a good end: "
            f"before {ramp.before}, asked {ramp.target}{now}; the service ~/{RESTORE} goes back to those before"
        )

    def _controller_name(self, joint: str) -> str:
        controller = self._gains.controller_of(joint)
        return controller.remote if controller is not None else ""

    def _to_the_advice(self) -> list[GainApplication]:
        """Ramps to the advice, for every joint that needs it."""
        ramps, reasons = [], []
        for joint in self._joints.values():
            other = self._others.watching(joint.name)
            if other:
                reasons.append(f"another monitor watches {joint.name} too, and may change its gains: {other}")
                continue
            assessment = joint.monitor.assessment()
            if joint.being_advised(assessment):
                raise NotYetError(f"the advice for {joint.name} is being worked out")
            has_controller = self._gains.controller_of(joint.name) is not None
            reason = joint.why_not_applied(assessment, has_controller=has_controller)
            if reason:
                reasons.append(reason)
            else:
                ramps.append(self._ramp(joint))
        if not ramps:
            raise RefusedError("; ".join(reasons) or "no joint is watched yet")
        return ramps

    def _back(self) -> list[GainApplication]:
        """Ramps back to the first gains of ramps that did not come to a good end."""
        ramps, reasons = [], []
        for name, unfinished in self._journal.items():
            joint = self._joints.get(name)
            if joint is None or self._controller_name(name) != unfinished.controller:
                reasons.append(f"{unfinished.controller}, which had the gains of {name}, is not there")
            else:
                ramps.append(self._ramp(joint, unfinished))
        if not ramps:
            nothing = self._journal.trouble or "there is no ramp that was cut off, or made nothing better"
            raise RefusedError("; ".join(reasons) or nothing)
        return ramps

    def _ramp(self, joint: WatchedJoint, back_to: UnfinishedRamp | None = None) -> GainApplication:
        controller = self._gains.controller_of(joint.name)
        assert controller is not None
        return GainApplication(
            joint.name,
            controller,
            MotionWatch(joint, monotonic),
            self._journal,
            scale=joint.settings.gain_scale,
            bounds=lambda: (joint.bounds("stiffness_range"), joint.bounds("damping_range")),
            rate=float(self._node.get_parameter("apply_rate").value),
            allowed=lambda: bool(self._node.get_parameter("allow_apply").value),
            clock=monotonic,
            log=self._node.get_logger(),
            back_to=back_to,
        )
