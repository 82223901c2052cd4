# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The node `simulated_joint`: joints with friction, in place of hardware, and of the controller too if wanted."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_finite, require_not_negative, require_positive
from stickslip_ros.model.compensation import Compensation, usual_compensation
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation
from stickslip_ros.nodes.conversion import stamp
from stickslip_ros.nodes.node_parameters import follow_by, refuse_by
from stickslip_ros.nodes.running import run, wait_until_compiled
from stickslip_ros.settings.known_joints import KnownJoint, load_joint
from stickslip_ros.settings.parameter_table import GAINS

_PROFILES = ("hold", "move", "reverse")
_COMMANDS = ("reference", "effort")
_COMPENSATED = {"feedforward": "at the reference's speed", "feedback": "at the measured speed", "push": "by the error"}
_EFFORT_HOLDS = 0.2  # time without a commanded effort, s: a controller that has ended must not leave its effort
_TIMER_PERIOD = 0.01  # period of publishing, s: ten samples at 1 kHz cost little more than one
_TIMER_PERIOD_OF_A_DRIVE = 0.001  # period of a drive, s: another node's controller waits for the states
_LONGEST_CATCH_UP = 0.1  # time that is caught up after a pause of the process, s: the rest is skipped


class Reference:
    """Desired position of one joint, which holds, moves, or moves to and fro."""

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0
        self.profile = "move"
        self.reversal_period = 10.0
        self._phase = 0.0

    def advance(self, period: float, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions at the start of each of ``count`` periods [rad], and the velocities during them [rad/s]."""
        if self.profile == "hold":
            velocities = np.zeros(count)
        elif self.profile == "move":
            velocities = np.full(count, self.velocity)
        else:
            phases = (self._phase + period * np.arange(count)) % (2.0 * self.reversal_period)
            velocities = np.where(phases < self.reversal_period, self.velocity, -self.velocity)
            self._phase = (self._phase + period * count) % (2.0 * self.reversal_period)
        ways = period * velocities
        positions = self.position + np.concatenate(([0.0], np.cumsum(ways)[:-1]))
        self.position = float(positions[-1] + ways[-1])
        return positions, velocities


class SimulatedJoint(Node):
    """Node that integrates Eqs (4)-(6) and publishes the topics of a robot's driver and controller.

    With the parameter `command` set to effort the node is a driver alone; another node closes the loop by efforts.
    """

    def __init__(self) -> None:
        super().__init__("simulated_joint")
        self._declare("joints", ["joint1"], "names of the joints", read_only=True)
        self._declare("rate", 1000.0, "samples a second [Hz]", read_only=True)
        self._declare(
            "time_factor", 1.0, "simulated seconds a second; if not 1, /clock is published [1]", read_only=True
        )
        self._declare("seed", 1, "of the noise", read_only=True)
        self._declare(
            "command", "reference", "reference: the node has controllers of its own; effort: it takes efforts from "
            "joint_commands and applies them", read_only=True,
        )  # fmt: skip
        command = self.get_parameter("command").value
        if command not in _COMMANDS:
            raise InvalidParameterError("command", f"one of {', '.join(_COMMANDS)}", command)
        self._has_controllers = command == "reference"
        if self._has_controllers:
            self._declare(
                "feedforward_topic", "", "JointState whose effort the controllers add; none by default", read_only=True
            )
        self._names: list[str] = list(self.get_parameter("joints").value)
        rate = float(self.get_parameter("rate").value)
        self._period = 1.0 / rate if rate > 0 else math.nan
        self._time_factor = float(self.get_parameter("time_factor").value)
        require_positive("rate", rate)
        require_positive("time_factor", self._time_factor)
        if len(set(self._names)) < len(self._names) or not all(self._names):
            raise InvalidParameterError("joints", "one or more different names", self._names)
        seed = int(self.get_parameter("seed").value)
        require_not_negative("seed", seed)
        self._random = np.random.default_rng(seed)
        self._references = {name: Reference() for name in self._names}
        self._simulations = {name: self._create(name) for name in self._names}
        # Values given at the start are checked as values set later.
        self._check(list(self._parameters.values()))
        refuse_by(self, self._check)
        follow_by(self, self._apply)
        self._apply([])
        # Before the clock starts, or the first seconds would be missing.
        wait_until_compiled(self)
        period, nothing = self._period, np.zeros(0)
        for simulation in self._simulations.values():
            simulation.advance(period, nothing, nothing)
        qos = QoSProfile(depth=1000)
        self._states = self.create_publisher(JointState, "joint_states", qos)
        self._desired = self.create_publisher(JointState, "joint_references", qos) if self._has_controllers else None
        self._torques: dict[str, float] = {}
        self._commanded_at = -math.inf
        topic = str(self.get_parameter("feedforward_topic").value) if self._has_controllers else "joint_commands"
        if topic:
            self.create_subscription(JointState, topic, self._hear_efforts, 1)
        self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 10) if self._time_factor != 1.0 else None
        self._count = 0
        self._start_stamp = 1.0 if self._clock_publisher else time.time()
        self._start = time.monotonic()
        every = _TIMER_PERIOD if self._has_controllers else max(_TIMER_PERIOD_OF_A_DRIVE, self._period)
        self.create_timer(every, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _declare(self, name: str, default: object, text: str, *, read_only: bool = False) -> None:
        self.declare_parameter(name, default, ParameterDescriptor(description=text, read_only=read_only))

    def _create(self, name: str) -> JointSimulation:
        self._declare(f"model.{name}", "puma560_joint1", "known joint or path of a joint file", read_only=True)
        known = load_joint(self.get_parameter(f"model.{name}").value)
        if self._has_controllers:
            self._declare_controller(name, known)
        self._declare(f"encoder_resolution.{name}", known.encoder_resolution, "of the position; 0: exact [rad]")
        self._declare(f"velocity_noise.{name}", 0.0, "standard deviation [rad/s]")
        self._declare(f"effort_noise.{name}", 0.0, "standard deviation [N*m]")
        self._declare(f"load.{name}", 0.0, "constant torque against the controller [N*m]", read_only=True)
        load = float(self.get_parameter(f"load.{name}").value)
        require_finite(f"load.{name}", load)
        gains = known.gains if self._has_controllers else Gains(stiffness=0.0, damping=0.0)
        return JointSimulation(known.joint, gains, load=load)

    def _declare_controller(self, name: str, known: KnownJoint) -> None:
        """Declare the parameters of the node's own controller of a joint."""
        self._declare(f"gains.{name}.p", float(known.gains.stiffness), "stiffness [N*m/rad]")
        self._declare(f"gains.{name}.i", float(known.gains.integral), "integral gain [N*m/(rad*s)]")
        self._declare(f"gains.{name}.d", float(known.gains.damping), "damping [N*m*s/rad]")
        self._declare(f"velocity.{name}", known.velocity, "commanded velocity [rad/s]")
        self._declare(f"profile.{name}", "move", f"one of {', '.join(_PROFILES)}")
        self._declare(f"reversal_period.{name}", 10.0, "how long the profile 'reverse' moves one way [s]")
        for kind in _COMPENSATED:
            text = "share of the friction that the controller compensates"
            self._declare(f"{kind}.{name}", 0.0, f"{text}: {_COMPENSATED[kind]} [1]")

    def _check(self, parameters: list[Parameter]) -> None:
        """Refuse values that no controller or encoder can have."""
        for parameter in parameters:
            kind, _, _ = parameter.name.partition(".")
            name, value = parameter.name, parameter.value
            if kind == "profile" and value not in _PROFILES:
                raise InvalidParameterError(name, f"one of {', '.join(_PROFILES)}", value)
            if kind in ("gains", "velocity", "load"):
                require_finite(name, value)
            if kind in ("encoder_resolution", "velocity_noise", "effort_noise", *_COMPENSATED):
                require_not_negative(name, value)
            if kind == "reversal_period":
                require_positive(name, value)

    def _apply(self, _: list[Parameter]) -> None:
        if not self._has_controllers:
            return
        for name, simulation in self._simulations.items():
            for key, field in GAINS.items():
                value = float(self._value(f"gains.{name}.{key}"))
                if getattr(simulation.gains, field) != value:
                    simulation.gains = replace(simulation.gains, **{field: value})
            simulation.compensation = self._compensation(name, simulation.joint)
            reference = self._references[name]
            reference.velocity = float(self._value(f"velocity.{name}"))
            reference.profile = str(self._value(f"profile.{name}"))
            reference.reversal_period = float(self._value(f"reversal_period.{name}"))

    def _compensation(self, name: str, joint: Joint) -> Compensation | None:
        """Compensation of a controller that knows the friction and compensates a share of it; None for no share."""
        shares = {kind: float(self._value(f"{kind}.{name}")) for kind in _COMPENSATED}
        if not any(shares.values()):
            return None
        return usual_compensation(
            joint.friction,
            period=self._period,
            resolution=float(self._value(f"encoder_resolution.{name}")),
            **shares,
        )

    def _hear_efforts(self, message: JointState) -> None:
        """Apply a torque to each joint, until the next message or until none comes any more."""
        # The torque before is applied until now.
        self._tick()
        if len(message.effort) == len(message.name):
            self._torques |= {
                name: effort
                for name, effort in zip(message.name, message.effort, strict=True)
                if name in self._simulations and math.isfinite(effort)
            }
            self._commanded_at = time.monotonic()

    def _torque(self, name: str) -> float:
        if time.monotonic() - self._commanded_at > _EFFORT_HOLDS:
            return 0.0
        return self._torques.get(name, 0.0)

    def _value(self, name: str) -> float | str:
        return self.get_parameter(name).value  # type: ignore[no-any-return]

    def _tick(self) -> None:
        """Simulate and publish up to now."""
        due = int(self._time_factor * (time.monotonic() - self._start) / self._period) - self._count
        most = max(1, int(_LONGEST_CATCH_UP * self._time_factor / self._period))
        if due > most:
            self._start += (due - most) * self._period / self._time_factor
            due = most
        if due <= 0:
            return
        columns = {name: self._advance(name, due) for name in self._names}
        states, desired = JointState(name=self._names), JointState(name=self._names)
        for index in range(due):
            self._count += 1
            now = stamp(self._start_stamp + self._count * self._period)
            if self._clock_publisher is not None:
                self._clock_publisher.publish(ClockMessage(clock=now))
            desired.header.stamp = states.header.stamp = now
            desired.position, desired.velocity, states.position, states.velocity, states.effort = (
                [columns[name][column][index] for name in self._names] for column in range(5)
            )
            if self._desired is not None:
                self._desired.publish(desired)
            self._states.publish(states)

    def _advance(self, name: str, count: int) -> tuple[list[float], ...]:
        """Desired position and velocity, measured position, velocity and effort at the ends of the next periods."""
        positions, velocities = self._references[name].advance(self._period, count)
        trajectory = self._simulations[name].advance(self._period, positions, velocities, self._torque(name))
        resolution = float(self._value(f"encoder_resolution.{name}"))
        measured = trajectory.position
        if resolution > 0:
            measured = resolution * np.round(measured / resolution)
        velocity_noise = float(self._value(f"velocity_noise.{name}")) * self._random.standard_normal(count)
        effort_noise = float(self._value(f"effort_noise.{name}")) * self._random.standard_normal(count)
        columns = (
            positions + self._period * velocities,
            velocities,
            measured,
            trajectory.velocity + velocity_noise,
            trajectory.effort + effort_noise,
        )
        return tuple(column.tolist() for column in columns)


def main(args: list[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run(SimulatedJoint, args)
