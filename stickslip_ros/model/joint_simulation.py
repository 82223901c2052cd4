# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Integration of Eqs (4)-(6) in SI units: one joint under PID control that follows any sampled reference.

Cycles of steady motion, for any number of joints, are :mod:`stickslip_ros.model.simulation`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import _joint_kernel as kernel
from stickslip_ros.model._friction_law import LAWS
from stickslip_ros.model._validation import require_finite, require_positive
from stickslip_ros.model.friction import Gains, Joint

# Steps per radian of the fastest motion (natural frequency or viscous decay); the error of a slip is
# then below a millionth.
_STEPS_PER_RADIAN = 40.0


class EventKind(Enum):
    """What happened to the joint."""

    BREAKAWAY = "breakaway"
    ARREST = "arrest"


@dataclass(frozen=True, kw_only=True)
class Event:
    """A breakaway or an arrest as the integration met it.

    Attributes
    ----------
    time : [s]; position : [rad].
    direction : +1 or -1, of the slip that begins or ends.
    stribeck_level : F_s,b at breakaway, F_s,a at arrest [N·m].
    """

    kind: EventKind
    time: float
    position: float
    direction: int
    stribeck_level: float


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Samples at the end of every period; arrays of one length.

    Attributes
    ----------
    time : [s]; position : [rad]; velocity : [rad/s]; effort : of the controller [N·m].
    events : breakaways and arrests in these periods, in order of time.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    events: tuple[Event, ...]


class JointSimulation:
    """One joint with its controller, advanced by sampling periods; starts stuck with full static friction.

    Parameters
    ----------
    joint, gains : scalars only. ``gains`` may be replaced at any time between two calls of ``advance``.
    position : where the joint starts [rad].
    error_integral : what the controller's integral holds at the start [rad·s].
    load : constant torque against the controller [N·m].
    sampled : the controller sees the joint only at the start of each period and holds its effort through it.
    control_delay : a sampled controller's effort takes effect one period late.

    Raises
    ------
    InvalidParameterError
        If a value is not finite.
    """

    def __init__(
        self,
        joint: Joint,
        gains: Gains,
        *,
        position: float = 0.0,
        error_integral: float = 0.0,
        load: float = 0.0,
        sampled: bool = False,
        control_delay: bool = False,
    ) -> None:
        require_finite("position", position)
        require_finite("load", load)
        self.joint = joint
        self.load = load
        self.sampled = sampled
        self.control_delay = control_delay
        self._held = np.array([0.0, error_integral])
        self.gains = gains
        self._state = np.zeros(kernel.STATE_SIZE)
        self._state[kernel.POSITION] = position
        self._state[kernel.INTEGRAL] = error_integral
        self._state[kernel.LEVEL] = float(joint.friction.stribeck)
        self._history = np.zeros((0, 3))

    @property
    def gains(self) -> Gains:
        """The controller's gains; setting them takes effect with the next period."""
        return self._gains

    @gains.setter
    def gains(self, gains: Gains) -> None:
        for name in ("stiffness", "damping", "integral"):
            require_finite(name, getattr(gains, name))
        self._gains = gains

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._state[kernel.TIME])

    @property
    def position(self) -> float:
        """Position [rad]."""
        return float(self._state[kernel.POSITION])

    @property
    def stuck(self) -> bool:
        """Whether static friction holds the joint now."""
        return bool(self._state[kernel.DIRECTION] == 0.0)

    def advance(
        self, period: float, references: NDArray[np.float64], reference_velocities: NDArray[np.float64]
    ) -> Trajectory:
        """Integrate over ``len(references)`` periods [s].

        ``references[i]`` [rad] is the desired position at the start of period i; during the period it
        moves with ``reference_velocities[i]`` [rad/s].
        """
        require_positive("period", period)
        references = np.ascontiguousarray(references, dtype=float)
        reference_velocities = np.ascontiguousarray(reference_velocities, dtype=float)
        require_finite("references", references)
        require_finite("reference_velocities", reference_velocities)
        if references.shape != reference_velocities.shape or references.ndim != 1:
            raise ValueError(f"{references.shape=} but {reference_velocities.shape=}; both must be (n,)")
        parameters = self._parameters()
        step = self._step(parameters)
        self._make_room(step, period)
        start = self.time
        samples = np.empty((references.size, 3))
        events = np.empty((8 * references.size + 16, kernel.EVENT_COLUMNS))
        count = kernel.advance(
            self._state, self._history, parameters, self._held, self.sampled, self.control_delay,
            step, period, references, reference_velocities, samples, events,
        )  # fmt: skip
        return Trajectory(
            time=start + period * np.arange(1.0, references.size + 1.0),
            position=samples[:, 0],
            velocity=samples[:, 1],
            effort=samples[:, 2],
            events=tuple(_event(row) for row in events[: min(count, len(events))]),
        )

    def _parameters(self) -> NDArray[np.float64]:
        friction, gains = self.joint.friction, self._gains
        parameters = np.empty(kernel.PARAMETERS_SIZE)
        parameters[kernel.INERTIA] = self.joint.inertia
        parameters[kernel.COULOMB] = friction.coulomb
        parameters[kernel.VISCOUS] = friction.viscous
        parameters[kernel.STRIBECK] = friction.stribeck
        parameters[kernel.STRIBECK_VELOCITY] = friction.stribeck_velocity
        parameters[kernel.LAG] = friction.lag
        parameters[kernel.RISE_TIME] = friction.rise_time
        parameters[kernel.LAW] = LAWS[friction.law]
        parameters[kernel.STIFFNESS] = gains.stiffness
        parameters[kernel.DAMPING] = gains.damping
        parameters[kernel.INTEGRAL_GAIN] = gains.integral
        parameters[kernel.LOAD] = self.load
        return parameters

    @staticmethod
    def _step(parameters: NDArray[np.float64]) -> float:
        inertia = parameters[kernel.INERTIA]
        frequency = math.sqrt(abs(parameters[kernel.STIFFNESS]) / inertia)
        decay = abs(parameters[kernel.DAMPING] + parameters[kernel.VISCOUS]) / inertia
        # The kernel's steps end with the sampling periods and are no longer than the lag.
        return float(1.0 / (_STEPS_PER_RADIAN * max(frequency, decay, 1e-9)))

    def _make_room(self, step: float, period: float) -> None:
        """Let the ring hold the velocities of one lag, keeping what it has."""
        lag = float(self.joint.friction.lag)
        shortest = min(step, period)
        capacity = int(3 * lag / shortest) + 2 * int(lag / period) + 64
        if capacity <= len(self._history):
            return
        history = np.zeros((capacity, 3))
        head, count = int(self._state[kernel.HISTORY_HEAD]), int(self._state[kernel.HISTORY_COUNT])
        for index in range(head - count, head):
            history[index % capacity] = self._history[index % len(self._history)]
        self._history = history


def simulate(
    joint: Joint,
    gains: Gains,
    references: NDArray[np.float64],
    reference_velocities: NDArray[np.float64],
    *,
    period: float = 1e-3,
    load: float = 0.0,
) -> Trajectory:
    """Simulate a joint from rest at the first reference; see :meth:`JointSimulation.advance`."""
    simulation = JointSimulation(joint, gains, position=float(references[0]), load=load)
    return simulation.advance(period, references, reference_velocities)


def _event(row: NDArray[np.float64]) -> Event:
    return Event(
        kind=EventKind.BREAKAWAY if row[1] == kernel.BREAKAWAY else EventKind.ARREST,
        time=float(row[0]),
        direction=int(row[2]),
        position=float(row[3]),
        stribeck_level=float(row[4]),
    )
