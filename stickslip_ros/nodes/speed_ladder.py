# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Experiment that excites all of a joint's friction: at rest, slow, faster, and the same way back; of a simulated joint
or one of a joint_trajectory_controller.

Such a controller refuses a trajectory without an answer, so that its log and the motion of the joint have to reveal it.
Time is that of the joint states' stamps, on a simulated clock too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from rcl_interfaces.msg import Log, ParameterType
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.errors import InvalidParameterError, StickSlipError
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray, ReferencePairing
from stickslip_ros.nodes.gains.gain_intake import ControllerGains
from stickslip_ros.nodes.gains.remote_parameters import PATIENCE, RemoteParameters
from stickslip_ros.nodes.intake.arrivals import JointStateTopic
from stickslip_ros.nodes.intake.refusals import Refusals
from stickslip_ros.nodes.running import turn

_QUEUE = 10_000  # depth of a queue, messages: ten seconds at 1 kHz
_SPIN = 0.02  # duration of one spin, s: Ctrl-C and progress are no later
_CONNECT_LIMIT = 20.0  # time until joint and controller are found, s: discovery takes seconds
_ANSWER_LIMIT = 5.0  # time until an answer, s: a node that is busy answers within it
_SETTLE = 0.5  # time recorded before the first step and after the last, s: the joint rests in it
_SILENCE = 1.0  # time without a new stamp, s: the position is not known any more
_STILL, _HOLD_LIMIT = 0.3, 3.0  # time between a hold and a check that the joint stands, and limit of all holds, s
_STANDS = 1e-3  # displacement of a joint that stands, rad: encoders move by less meanwhile
_LARGEST_LAG = 0.02  # distance from the trajectory, rad: a joint that is farther off is stopped
_REQUEST_EVERY = 1.0  # time between two requests of the parameter `joints`, s: a slow controller is not flooded
_STOP_TIME = 0.2  # duration of the trajectory that holds the joints, s: they stop softly
_LATE = 0.25  # delay of controller and joint states, s: a position due meanwhile is accepted
_OF_LAG = 0.25  # displacement of a joint that is to rest, largest lags: encoders and settling move it by less
_MOVED = 0.1  # displacement of a joint that has moved, largest lags
_LOGGED = 1000  # depth of the queue of /rosout, messages: many nodes write there
_LINES = 3  # number of quoted lines of the log, 1: the first ones have the cause
_ERROR = 40  # severity of an error in rcl_interfaces/Log, whose constant has another type in wheels


class ExperimentError(StickSlipError, RuntimeError):
    """An experiment that cannot begin or go on; the text has the reason."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a ladder: velocity [rad/s], 0 for a rest, and duration [s]."""

    velocity: float
    duration: float


@dataclass(frozen=True)
class _Path:
    """Desired path of a joint: straight lines between positions [rad] at times [s] from the beginning."""

    times: FloatArray
    positions: FloatArray

    @staticmethod
    def of(steps: Sequence[Step], position: float, begin: float) -> _Path:
        """Path of the steps from a position, after a rest of ``begin`` seconds."""
        durations = np.array([begin, *(step.duration for step in steps)])
        ways = np.array([0.0, *(step.velocity * step.duration for step in steps)])
        return _Path(np.cumsum(durations), position + np.cumsum(ways))

    def off(self, time: float, position: float) -> float:
        """Distance of a position from the path, at a time or a moment before [rad]."""
        due = np.interp(np.linspace(time - _LATE, time, 6), self.times, self.positions)
        return max(position - float(due.max()), float(due.min()) - position, 0.0)

    def rests(self, time: float) -> bool:
        """Whether the path has not left its first position yet."""
        return bool(np.interp(time, self.times, self.positions) == self.positions[0]) and time < self.times[-1] / 2


class _TrajectoryController:
    """A joint_trajectory_controller that is to move one of its joints while the others hold their positions.

    Parameters
    ----------
    node : has publisher and subscriptions. parameters : of the controller's node. joint : joint to be moved.
    largest_lag : largest distance of the joint from its trajectory [rad].
    """

    def __init__(self, node: Node, parameters: RemoteParameters, joint: str, largest_lag: float) -> None:
        self.name, self._joint, self._largest_lag = parameters.remote, joint, largest_lag
        self._node, self._parameters = node, parameters
        self._requested_at = -math.inf
        self.joints: tuple[str, ...] = ()
        self._sent: JointTrajectory | None = None
        self._path: _Path | None = None
        self._farthest = 0.0
        self._complaints: list[str] = []
        self._other: str = ""
        self._publisher = node.create_publisher(JointTrajectory, f"{self.name}/joint_trajectory", 10)
        node.create_subscription(JointTrajectory, f"{self.name}/joint_trajectory", self._on_trajectory, 10)
        node.create_subscription(Log, "/rosout", self._on_log, _LOGGED)

    def poll(self, now: float) -> None:
        """Request the names of the joints until they are known; ``now`` is a steady time [s]."""
        if not self.joints and self._parameters.ready() and now > self._requested_at + _REQUEST_EVERY:
            self._requested_at = now
            self._parameters.get(["joints"], now, self._on_joints)

    def _on_joints(self, values: Any) -> None:
        if not values:
            return
        if values[0].type != ParameterType.PARAMETER_STRING_ARRAY or not values[0].string_array_value:
            raise ExperimentError(
                f"{self.name} has no parameter 'joints' with the names of its joints; it must be a "
                "joint_trajectory_controller"
            )
        self.joints = tuple(values[0].string_array_value)
        if self._joint not in self.joints:
            raise ExperimentError(f"{self._joint} is none of the joints of {self.name}: {', '.join(self.joints)}")

    def missing(self, positions: Mapping[str, float]) -> str:
        """What is missing before a trajectory can be sent, in words, "" if nothing is."""
        if self._publisher.get_subscription_count() < (2 if self._listens() else 1):
            return f"its controller: {self.name} does not listen to trajectories"
        if not self.joints:
            return f"its controller: {self.name} does not tell its parameter 'joints'"
        unknown = [name for name in self.joints if not math.isfinite(positions.get(name, math.nan))]
        return f"joint_states, of these joints of {self.name}: {', '.join(unknown)}" if unknown else ""

    def _listens(self) -> bool:
        """Whether this node's own subscription is counted too."""
        topic = self._publisher.topic_name
        own = self._node.get_fully_qualified_name()
        return any(
            f"{info.node_namespace.rstrip('/')}/{info.node_name}" == own
            for info in self._node.get_subscriptions_info_by_topic(topic)
        )

    def refuse_motion(self, before: Mapping[str, float], after: Mapping[str, float]) -> None:
        """Refuse to begin while a joint moves: a trajectory would stop it, or oppose the cause of its motion.

        Raises
        ------
        ExperimentError
            If a joint moves.
        """
        for name in self.joints:
            way = abs(after[name] - before[name])
            if way > _MOVED * self._largest_lag:
                raise ExperimentError(f"{name} moves already ({way:.2g} rad meanwhile): stop what moves it first")

    def begin(self, steps: Sequence[Step], positions: Mapping[str, float], begin: float) -> None:
        """Send the steps as one trajectory from where the joints are, after a rest of ``begin`` seconds."""
        self._path = _Path.of(steps, positions[self._joint], begin)
        self._farthest = 0.0
        self._send(self._path, positions)

    def hold(self, positions: Mapping[str, float]) -> None:
        """Command every joint to stay where it is."""
        # joint_trajectory_controller refuses an empty trajectory.
        self._send(_Path(np.array([_STOP_TIME]), np.array([positions[self._joint]])), positions)

    def _send(self, path: _Path, positions: Mapping[str, float]) -> None:
        message = JointTrajectory(joint_names=list(self.joints))
        for time, position in zip(path.times.tolist(), path.positions.tolist(), strict=True):
            # Without velocities the controller follows straight lines, at constant speed.
            there = [position if name == self._joint else positions[name] for name in self.joints]
            whole = int(time)
            after = Duration(sec=whole, nanosec=min(round(1e9 * (time - whole)), 999_999_999))
            message.points.append(JointTrajectoryPoint(positions=there, time_from_start=after))
        self._sent = message
        self._publisher.publish(message)

    def wait_for_delivery(self, limit: float) -> None:
        """Wait until the controller has the trajectory, ``limit`` seconds at most."""
        from rclpy.duration import Duration as Time

        self._publisher.wait_for_all_acked(Time(seconds=limit))

    def check(self, time: float, position: float) -> None:
        """Check the joint's position [rad], ``time`` seconds after the beginning.

        Raises
        ------
        ExperimentError
            If the joint is off its trajectory, another trajectory was sent, or the controller has logged an error.
        """
        path = self._path
        assert path is not None
        self._farthest = max(self._farthest, abs(position - float(path.positions[0])))
        if self._other:
            raise ExperimentError(self._other)
        if self._complaints:
            raise ExperimentError(f"{self.name} says: {'; '.join(self._complaints[:_LINES])}")
        off = path.off(time, position)
        if path.rests(time) and off > _OF_LAG * self._largest_lag:
            raise ExperimentError(f"{self._joint} moves by {off:.2g} rad while it is to rest: something else moves it")
        if off <= self._largest_lag:
            return
        far = f"{off:.2g} rad from its trajectory, more than --largest-lag ({self._largest_lag:g} rad)"
        if self._farthest < _MOVED * self._largest_lag:
            raise ExperimentError(
                f"{self._joint} does not move and is {far}: {self.name} has refused the trajectory or is inactive, or "
                "the joint sticks as firmly as that"
            )
        raise ExperimentError(
            f"{self._joint} is {far}: something else moves it, {self.name} has given up, or its control is as soft as "
            "that"
        )

    def _on_trajectory(self, message: JointTrajectory) -> None:
        if self._sent is not None and message != self._sent:
            self._other = f"another trajectory was sent to {self.name}"

    def _on_log(self, message: Log) -> None:
        logger = self.name.strip("/").replace("/", ".")
        own = message.name == logger or message.name.startswith(f"{logger}.")
        if self._path is not None and own and message.level >= _ERROR:
            self._complaints.append(message.msg.strip())


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
        self, joint: str, *, simulated: str = "", controller: str = "", largest_lag: float = _LARGEST_LAG
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
        self._parameters = self._controller_gains.parameters
        self._controller = _TrajectoryController(self, self._parameters, joint, largest_lag) if controller else None

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
            before, until = dict(self._positions), monotonic() + _SETTLE
            # Again and again: a joint that swings may be back by then.
            while monotonic() < until:
                self._turn()
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
        return "" if self._parameters.ready(to_set=True) else "its controller"

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
        self, controller: _TrajectoryController, steps: list[Step], report: Callable[[float, str], None]
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
        values = {f"velocity.{self._joint}": velocity, f"profile.{self._joint}": "move" if velocity else "hold"}
        answers: list[Any] = []
        self._parameters.set(values, monotonic() + _ANSWER_LIMIT - PATIENCE, answers.append)
        while not answers:
            self._turn()
        if answers[0] is None:
            raise ExperimentError(f"{self._simulated} has not answered for {_ANSWER_LIMIT:g} s")
        if not answers[0].successful:
            raise ExperimentError(f"{self._simulated} refused velocity {velocity:g}: {answers[0].reason}")

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
