# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The node `stickslip_monitor`: joint states and gains in; diagnostics, margins, cycles and advice out."""

from __future__ import annotations

import traceback
from collections.abc import Callable

from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.timer import Timer

from stickslip_ros.errors import StickSlipError
from stickslip_ros.nodes import node_parameters
from stickslip_ros.nodes.kept_state import RampJournal, state_path
from stickslip_ros.nodes.running import run
from stickslip_ros.nodes.session import SHORTEST_TICK, Session
from stickslip_ros.nodes.watched_joints import GainBounds

RCLError = rclpy_implementation.RCLError

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Monitor(LifecycleNode):
    """Managed node that watches the configured joints, or every joint that is heard of.

    The node has its joints, topics and services from `configure` to `cleanup`, and listens and publishes from
    `activate` to `deactivate`. config/monitor.yaml has the parameters.
    """

    def __init__(self) -> None:
        super().__init__("stickslip_monitor")
        self._session: Session | None = None
        self._timer: Timer | None = None
        self._bounds, self._own_change = GainBounds(), node_parameters.OwnChange()
        # A ramp that was cut off outlasts the session, as the gains do that it left.
        self._journal: RampJournal | None = None
        self.failure: Exception | None = None
        node_parameters.declare(self)
        node_parameters.check(self)
        self._answer_impossible_transitions()
        node_parameters.refuse_by(self, self._check_parameters)
        node_parameters.follow_by(self, self._apply_parameters)

    def start(self) -> None:
        """Configure and activate, as `autostart` asks for.

        Raises
        ------
        StickSlipError, rclpy.exceptions.ParameterException
            If the parameters do not allow it.
        """
        for transition in (self.trigger_configure, self.trigger_activate):
            if transition() != SUCCESS:
                raise self.failure or StickSlipError("the node could not be started")

    def _answer_impossible_transitions(self) -> None:
        """Refuse transitions that the state has not: rclpy raises an exception in Jazzy, and gives no answer."""
        service = self._service_change_state
        change = service.callback

        def change_state(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            try:
                return change(request, response)
            except RCLError as error:
                self.get_logger().warning(f"refused: {error}")
                response.success = False
                return response

        service.callback = change_state

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Create the session: joints, topics and services."""

        def configure() -> None:
            path = state_path(self)
            if self._journal is None:
                self._journal = RampJournal.beside(path)
            self._session = Session(self, self._bounds, self._own_change, path, self._journal)

        return self._transition(configure, super().on_configure, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen and publish."""

        def activate() -> None:
            assert self._session is not None
            self._session.activate(self._tick)
            # A timer on ROS time would stop with a paused or looping simulation.
            self._timer = self.create_timer(SHORTEST_TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

        return self._transition(activate, super().on_activate, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Neither listen nor publish."""
        return self._transition(self._deactivate, super().on_deactivate, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give everything back."""
        return self._transition(self.close, super().on_cleanup, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give everything back, for good."""
        return self._transition(self.close, super().on_shutdown, state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give everything back, so that the node can be configured again."""
        return self._transition(self.close, super().on_error, state)

    def _transition(
        self,
        change: Callable[[], None],
        managed: Callable[[LifecycleState], TransitionCallbackReturn],
        state: LifecycleState,
    ) -> TransitionCallbackReturn:
        """Make a transition, and that of the publishers; the reason of a failure is kept and logged."""
        try:
            change()
        except (StickSlipError, ParameterException) as error:
            self.failure = error
            self.get_logger().error(str(error))
            return FAILURE
        except Exception:
            # rclpy would discard the exception.
            self.get_logger().error(traceback.format_exc())
            return TransitionCallbackReturn.ERROR
        return managed(state)

    def _deactivate(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self._session is not None:
            self._session.deactivate()

    def close(self) -> None:
        """End the session and save what was learnt; the node itself stays."""
        self._deactivate()
        if self._session is not None:
            self._session.close()
            self._session = None

    def destroy_node(self) -> None:
        """Give everything back first."""
        self.close()
        super().destroy_node()

    def _tick(self) -> None:
        if self._session is None or self._timer is None:
            return
        try:
            self._set_pace(self._session.tick())
        except Exception:
            # Whatever the error is, the next tick may succeed, and a monitor that has ended helps nobody.
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=10.0)

    def _set_pace(self, period: float) -> None:
        nanoseconds = round(period * 1e9)
        if self._timer is not None and self._timer.timer_period_ns != nanoseconds:
            self._timer.timer_period_ns = nanoseconds
            self._timer.reset()

    def _check_parameters(self, parameters: list[Parameter]) -> None:
        """Refuse values that make no joint; nothing is changed here."""
        if self._own_change.active:
            return
        changes = {parameter.name: parameter for parameter in parameters}
        for name in changes:
            if name.startswith("recommended."):
                raise StickSlipError(
                    f"{name} is the monitor's advice and cannot be set; set the controller's gains instead"
                )
        node_parameters.check(self, changes)
        if self._session is not None:
            self._session.joints.check(changes)

    def _apply_parameters(self, parameters: list[Parameter]) -> None:
        if self._session is None or self._own_change.active:
            return
        self._session.apply({parameter.name: parameter for parameter in parameters})


def _create() -> Monitor:
    node = Monitor()
    if node.get_parameter("autostart").value:
        node.start()
    return node


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(_create, args, persevere=True)
