# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint of a joint_trajectory_controller moved along a trajectory, and whether it follows this and no other.

The controller refuses a trajectory without an answer, so that its log and the motion of the joint have to reveal it.
Time is that of the joint states' stamps, on a simulated clock too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from rcl_interfaces.msg import Log, ParameterType
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from stickslip_ros.errors import StickSlipError
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.nodes.gains.remote_parameters import RemoteParameters

LARGEST_LAG = 0.02  # distance from the trajectory, rad: a joint that is farther off is stopped
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
class Path:
    """Desired path of a joint: straight lines between positions [rad] at times [s] from the beginning."""

    times: FloatArray
    positions: FloatArray

    @staticmethod
    def of(steps: Sequence[Step], position: float, begin: float) -> Path:
        """Path of the steps from a position, after a rest of ``begin`` seconds."""
        durations = np.array([begin, *(step.duration for step in steps)])
        ways = np.array([0.0, *(step.velocity * step.duration for step in steps)])
        return Path(np.cumsum(durations), position + np.cumsum(ways))

    def off(self, time: float, position: float) -> float:
        """Distance of a position from the path, at a time or a moment before [rad]."""
        due = np.interp(np.linspace(time - _LATE, time, 6), self.times, self.positions)
        return max(position - float(due.max()), float(due.min()) - position, 0.0)

    def rests(self, time: float) -> bool:
        """Whether the path has not left its first position yet."""
        return bool(np.interp(time, self.times, self.positions) == self.positions[0]) and time < self.times[-1] / 2


class TrajectoryController:
    """A joint_trajectory_controller that is to move one of its joints while the others hold their positions.

    Parameters
    ----------
    node : has publisher and clients. name : fully qualified name of the controller's node. joint : joint to be moved.
    largest_lag : largest distance of the joint from its trajectory [rad].
    """

    def __init__(self, node: Node, name: str, joint: str, largest_lag: float = LARGEST_LAG) -> None:
        self.name, self._joint, self._largest_lag = name, joint, largest_lag
        self._node = node
        self._parameters = RemoteParameters(node, name)
        self._requested_at = -math.inf
        self.joints: tuple[str, ...] = ()
        self._sent: JointTrajectory | None = None
        self._path: Path | None = None
        self._farthest = 0.0
        self._complaints: list[str] = []
        self._other: str = ""
        self._publisher = node.create_publisher(JointTrajectory, f"{name}/joint_trajectory", 10)
        node.create_subscription(JointTrajectory, f"{name}/joint_trajectory", self._on_trajectory, 10)
        node.create_subscription(Log, "/rosout", self._on_log, _LOGGED)

    def poll(self, now: float) -> None:
        """Request the names of the joints until they are known; ``now`` is a steady time [s]."""
        self._parameters.poll(now)
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
        self._path = Path.of(steps, positions[self._joint], begin)
        self._farthest = 0.0
        self._send(self._path, positions)

    def hold(self, positions: Mapping[str, float]) -> None:
        """Command every joint to stay where it is."""
        # joint_trajectory_controller refuses an empty trajectory.
        self._send(Path(np.array([_STOP_TIME]), np.array([positions[self._joint]])), positions)

    def _send(self, path: Path, positions: Mapping[str, float]) -> None:
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
