# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The experiment that shows all of a joint's friction: at rest, slow, faster, and the same way back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.message_content import MessageError, joint_rows, seconds
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.nodes.drain import DrainedSubscription
from stickslip_ros.nodes.gain_source import ControllerGains

_QUEUE = 10_000
_SPIN = 0.02
_CONNECT_LIMIT = 20.0  # [s]
_ANSWER_LIMIT = 5.0
_STOP_TIME = 0.2  # [s]
_SETTLE = 0.5  # [s] recorded before the first step and after the last


class ExperimentError(StickSlipError, RuntimeError):
    """An experiment that cannot begin or go on; the text says why."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a ladder: velocity [rad/s], 0 for a rest, and how long [s]."""

    velocity: float
    duration: float


def speed_ladder(speeds: list[float], *, duration: float, rest: float) -> list[Step]:
    """Rest, each speed in turn with rests between, then the same backwards: the joint ends where it began.

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
    """Moves one joint through a ladder and records it.

    Parameters
    ----------
    joint : its name. simulated : name of a simulated joint's node, whose parameters are set; or "".
    controller : name of a joint_trajectory_controller, which is sent one trajectory; or "".
    """

    def __init__(self, joint: str, *, simulated: str = "", controller: str = "") -> None:
        super().__init__("stickslip_identify")
        self._joint, self._simulated = joint, simulated
        self._pairing = ReferencePairing()
        self._batches: list[Batch] = []
        self.gains: Gains | None = None
        self.position = math.nan
        incoming = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_QUEUE, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._states = DrainedSubscription(self, JointState, "joint_states", incoming)
        self._references = DrainedSubscription(self, JointState, "joint_references", incoming)
        self._controller_gains = ControllerGains(self, simulated or controller, self._on_gains, lambda: [joint])
        self._client = AsyncParameterClient(self, simulated) if simulated else None
        topic = f"{controller}/joint_trajectory" if controller else "~/unused"
        self._trajectory = self.create_publisher(JointTrajectory, topic, 10)

    def _on_gains(self, _: str, gains: Gains) -> None:
        self.gains = gains

    def run(self, steps: list[Step], told: Callable[[float, str], None]) -> Batch:
        """Move through the steps and return what was recorded.

        Parameters
        ----------
        told : called with the seconds done and what is being done.

        Raises
        ------
        ExperimentError
            If nothing is heard of the joint or its controller.
        """
        self._connect()
        try:
            return self._climb(steps, told)
        finally:
            self._hold()

    def _connect(self) -> None:
        end = monotonic() + _CONNECT_LIMIT
        while math.isnan(self.position) or not self._ready():
            if monotonic() > end:
                missing = "joint_states" if math.isnan(self.position) else "its controller"
                raise ExperimentError(f"nothing heard of {self._joint} on {missing} for {_CONNECT_LIMIT:g} s")
            self._turn()

    def _ready(self) -> bool:
        if self._client is not None:
            return bool(self._client.services_are_ready())
        return bool(self._trajectory.get_subscription_count() > 0)

    def _turn(self) -> None:
        """Let ROS work a little, and take what has come."""
        rclpy.spin_once(self, timeout_sec=_SPIN)
        self._controller_gains.poll(monotonic())
        for message, _ in self._states.take_all():
            row = self._row(message)
            if row is not None:
                self.position = row[0]
                self._pairing.add_sample(seconds(message.header.stamp), *row)
        for message, _ in self._references.take_all():
            row = self._row(message)
            if row is not None:
                self._pairing.add_reference(seconds(message.header.stamp), row[0], row[1])
        batch = self._pairing.take()
        if batch is not None:
            self._batches.append(batch)

    def _row(self, message: JointState) -> tuple[float, float, float] | None:
        """What a message says of the joint; None if nothing that can be read."""
        try:
            return joint_rows(message).get(self._joint)
        except MessageError:
            return None

    def _climb(self, steps: list[Step], told: Callable[[float, str], None]) -> Batch:
        self._batches.clear()
        if not self._simulated:
            self._send(steps)
        begin = monotonic()
        due = begin + _SETTLE
        for step in steps:
            if self._simulated:
                self._set(step.velocity)
            due += step.duration
            what = f"at {step.velocity:+.4g} rad/s" if step.velocity else "at rest"
            while monotonic() < due:
                self._turn()
                told(monotonic() - begin, what)
        end = monotonic() + _SETTLE
        while monotonic() < end:
            self._turn()
        if not self._batches:
            raise ExperimentError(f"no samples of {self._joint} while it moved")
        return Batch.joined(self._batches)

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

    def _send(self, steps: list[Step]) -> None:
        """The whole ladder as one trajectory from where the joint is."""
        message = JointTrajectory(joint_names=[self._joint])
        position, time = self.position, _SETTLE
        message.points.append(_point(position, time))
        for step in steps:
            position += step.velocity * step.duration
            time += step.duration
            message.points.append(_point(position, time))
        self._trajectory.publish(message)

    def _hold(self) -> None:
        """Leave the joint at rest, whatever happened."""
        if self._simulated:
            try:
                self._set(0.0)
            except ExperimentError as error:
                self.get_logger().error(f"could not stop the joint: {error}")
        else:
            # Not an empty trajectory, which joint_trajectory_controller refuses.
            self._trajectory.publish(
                JointTrajectory(joint_names=[self._joint], points=[_point(self.position, _STOP_TIME)])
            )
            rclpy.spin_once(self, timeout_sec=_SPIN)


def _point(position: float, time: float) -> JointTrajectoryPoint:
    """A point without velocity: the controller then goes on a straight line, at constant speed."""
    whole = int(time)
    return JointTrajectoryPoint(
        positions=[position],
        time_from_start=Duration(sec=whole, nanosec=round(1e9 * (time - whole))),
    )
