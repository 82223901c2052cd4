# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Experiment that excites all of a joint's friction: at rest, slow, faster, and the same way back."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import monotonic

import numpy as np
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, ReferencePairing
from stickslip_ros.nodes.gains.gain_intake import ControllerGains
from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.running import turn
from stickslip_ros.nodes.trajectory_controller import LARGEST_LAG, ExperimentError, Step, TrajectoryController

_QUEUE = 10_000  # depth of a queue, messages: ten seconds at 1 kHz
_SPIN = 0.02  # duration of one spin, s: Ctrl-C and progress are no later
_CONNECT_LIMIT = 20.0  # time until joint and controller are found, s: discovery takes seconds
_ANSWER_LIMIT = 5.0  # time until an answer, s: a node that is busy answers within it
_SETTLE = 0.5  # time recorded before the first step and after the last, s: the joint rests in it
_SILENCE = 1.0  # time without a new stamp, s: the position is not known any more
_STILL, _HOLD_LIMIT = 0.3, 3.0  # time between a hold and a check that the joint stands, and limit of all holds, s
_STANDS = 1e-3  # displacement of a joint that stands, rad: encoders move by less meanwhile


def speed_ladder(speeds: list[float], *, duration: float, rest: float) -> list[Step]:
    """Steps of a ladder: each speed with rests between, then the same backwards, so that the joint ends where it began.

    Raises
    ------
    InvalidParameterError
        If a speed is not finite and > 0, there are none, or a time is not finite and > 0.
    """
    if not speeds or not all(math.isfinite(speed) and speed > 0 for speed in speeds):
        raise InvalidParameterError("speeds", "one or more, finite and > 0", speeds)
    for name, time in (("step_time", duration), ("rest", rest)):
        if not (math.isfinite(time) and time > 0):
            raise InvalidParameterError(name, "finite and > 0", time)
    steps = [Step(velocity=0.0, duration=rest)]
    for direction in (1.0, -1.0):
        for speed in speeds:
            steps += [Step(velocity=direction * speed, duration=duration), Step(velocity=0.0, duration=rest)]
    return steps


class LadderNode(Node):
    """Node that moves one joint through a ladder and records it.

    Parameters
    ----------
    joint : its name. simulated : name of a simulated joint's node, whose parameters are set; or "".
    controller : name of a joint_trajectory_controller, which gets one trajectory; or "".
    largest_lag : largest distance of the joint from its trajectory [rad].
    """

    def __init__(
        self, joint: str, *, simulated: str = "", controller: str = "", largest_lag: float = LARGEST_LAG
    ) -> None:
        super().__init__("stickslip_identify")
        self._joint, self._simulated = joint, simulated
        self._pairing = ReferencePairing()
        self._batches: list[Batch] = []
        self.gains: Gains | None = None
        self._positions: dict[str, float] = {}
        self._stamp = math.nan
        incoming = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        refuse = Refusals(self.get_logger().warning)
        self._states = JointStateTopic(self, "joint_states", incoming, refuse)
        self._references = JointStateTopic(self, "joint_references", incoming, refuse)
        self._controller_gains = ControllerGains(self, simulated or controller, self._on_gains, [joint], refuse)
        self._client = AsyncParameterClient(self, simulated) if simulated else None
        self._controller = TrajectoryController(self, controller, joint, largest_lag) if controller else None

    def _on_gains(self, _: str, gains: Gains | None) -> None:
        # The experiment was made with the last known gains, even if the controller has ended.
        self.gains = gains or self.gains

    def run(self, steps: list[Step], report: Callable[[float, str], None]) -> Batch:
        """Move through the steps; returns the recorded samples.

        Parameters
        ----------
        report : called with the seconds done and the present step.

        Raises
        ------
        ExperimentError
            If nothing is heard of the joint or its controller, or the joint does not follow.
        """
        self._connect()
        if self._controller is not None:
            before = dict(self._positions)
            self._spin(_SETTLE)
            self._controller.refuse_motion(before, self._positions)
        try:
            return self._climb(steps, report)
        finally:
            self._hold()

    @property
    def position(self) -> float:
        """Last position of the joint [rad]; NaN before the first."""
        return self._positions.get(self._joint, math.nan)

    def _spin(self, duration: float) -> None:
        end = monotonic() + duration
        while monotonic() < end:
            self._turn()

    def _connect(self) -> None:
        end = monotonic() + _CONNECT_LIMIT
        while missing := self._missing():
            if monotonic() > end:
                raise ExperimentError(f"nothing heard of {self._joint} on {missing} for {_CONNECT_LIMIT:g} s")
            self._turn()

    def _missing(self) -> str:
        if math.isnan(self.position):
            return "joint_states"
        if self._controller is not None:
            return self._controller.missing(self._positions)
        return "" if self._client is None or self._client.services_are_ready() else "its controller"

    def _turn(self) -> None:
        """Let ROS work a little, and process the messages that have come."""
        turn(self, _SPIN)
        self._controller_gains.poll(monotonic())
        if self._controller is not None:
            self._controller.poll(monotonic())
        states = self._states.samples_until(math.inf)
        for name, rows in states.items():
            known = rows[np.isfinite(rows[:, 1]), 1]
            if len(known):
                self._positions[name] = float(known[-1])
        if self._joint in states:
            self._stamp = float(states[self._joint][-1, 0])
            self._pairing.add_samples(states[self._joint])
        references = self._references.samples_until(math.inf)
        if self._joint in references:
            self._pairing.add_references(references[self._joint][:, :3])
        batch = self._pairing.next_batch()
        if batch is not None:
            self._batches.append(batch)

    def _climb(self, steps: list[Step], report: Callable[[float, str], None]) -> Batch:
        self._batches.clear()
        if self._controller is not None:
            self._follow(self._controller, steps, report)
        else:
            self._set_in_turn(steps, report)
        if not self._batches:
            raise ExperimentError(f"no samples of {self._joint} while it moved")
        return Batch.joined(self._batches)

    def _follow(
        self, controller: TrajectoryController, steps: list[Step], report: Callable[[float, str], None]
    ) -> None:
        """Send the whole ladder, and check that the joint follows it."""
        begin = last = self._stamp
        heard = monotonic()
        controller.begin(steps, self._positions, _SETTLE)
        end = sum(step.duration for step in steps) + 2.0 * _SETTLE
        while self._stamp - begin < end:
            self._turn()
            if self._stamp != last:
                last, heard = self._stamp, monotonic()
            elif monotonic() - heard > _SILENCE:
                raise ExperimentError(f"nothing new of {self._joint} on joint_states for {_SILENCE:g} s")
            controller.check(self._stamp - begin, self.position)
            report(self._stamp - begin, "")

    def _set_in_turn(self, steps: list[Step], report: Callable[[float, str], None]) -> None:
        begin = monotonic()
        due = begin + _SETTLE
        for step in steps:
            self._set(step.velocity)
            due += step.duration
            what = f"at {step.velocity:+.4g} rad/s" if step.velocity else "at rest"
            while monotonic() < due:
                self._turn()
                report(monotonic() - begin, what)
        self._spin(_SETTLE)

    def _set(self, velocity: float) -> None:
        assert self._client is not None
        profile = "move" if velocity else "hold"
        answer = self._client.set_parameters_atomically(
            [
                Parameter(f"velocity.{self._joint}", Parameter.Type.DOUBLE, velocity),
                Parameter(f"profile.{self._joint}", Parameter.Type.STRING, profile),
            ]
        )
        end = monotonic() + _ANSWER_LIMIT
        while not answer.done():
            if monotonic() > end:
                raise ExperimentError(f"{self._simulated} has not answered for {_ANSWER_LIMIT:g} s")
            self._turn()
        result = answer.result()
        if result is None or not result.result.successful:
            why = result.result.reason if result else "no answer"
            raise ExperimentError(f"{self._simulated} refused velocity {velocity:g}: {why}")

    def _hold(self) -> None:
        """Bring the joint to rest, whatever happened."""
        if self._controller is None:
            try:
                self._set(0.0)
            except ExperimentError as error:
                self.get_logger().error(f"could not stop the joint: {error}")
            return
        end = monotonic() + _HOLD_LIMIT
        while monotonic() < end:
            self._controller.hold(self._positions)
            self._controller.wait_for_delivery(_STILL)
            self._spin(_STILL)
            before = self.position
            self._spin(_STILL)
            if abs(self.position - before) <= _STANDS:
                return
        self.get_logger().error(f"{self._joint} was told to hold for {_HOLD_LIMIT:g} s, and moves all the same")
