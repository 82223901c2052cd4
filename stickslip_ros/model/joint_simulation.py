# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Integration of Eqs (4)-(6) in SI units: one joint under PID control that follows any sampled reference.

Presliding, which the paper leaves to later work: a joint at rest leans on an elastic contact, friction σ₀ z + σ₁ z˙
with the contact's deflection z. By "elasto_plastic" (Dupont, Hayward, Armstrong and Altpeter, IEEE TAC 47(5), 2002,
with the onset of yielding at its limit) the contact is elastic, z˙ = x˙, while σ₀ |z| ≤ F_k + F_s(t₂). There the joint
breaks away and slides by Eq. (4); where it arrests, the contact springs back from σ₀ |z| = F_k + F_s,a. With σ₀ → ∞
that is the paper's law. By "lugre" (Canudas de Wit and others, IEEE TAC 40(3), 1995) the contact yields all the time,
z˙ = x˙ − σ₀ |x˙| z/(F_k + F_s Ψ).

Cycles of steady motion, for any number of joints, are :mod:`stickslip_ros.model.simulation`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import _joint_kernel as kernel
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._friction_law import CONTACTS, LAWS, RIGID
from stickslip_ros.model._validation import require_finite, require_positive
from stickslip_ros.model.compensation import Compensation
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint

# Steps per radian of the fastest motion (natural frequency or viscous decay); the error of a slip is
# then below a millionth.
_STEPS_PER_RADIAN = 40.0
# Presliding stiffness over k_p, above which a contact is rigid: its deflection is lost in the rounding of positions.
_RIGID_CONTACT = 1e9
_REMEMBERED = 600  # velocities of a slip that are kept, 1: at least; a creeping contact has its own steps


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
    event_rows : of the kernel, a row each of :attr:`events`, shape (m, 5).
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    event_rows: NDArray[np.float64]

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Breakaways and arrests in these periods, in order of time; made when asked for, as there may be millions."""
        return tuple(_event(row) for row in self.event_rows)

    @property
    def breakaway_levels(self) -> NDArray[np.float64]:
        """F_s,b of each breakaway [N·m]."""
        levels: NDArray[np.float64] = self.event_rows[self.event_rows[:, 1] == at.BREAKAWAY, 4]
        return levels

    @property
    def last_event(self) -> float:
        """Time of the last breakaway or arrest [s]; NaN if there is none."""
        return float(self.event_rows[-1, 0]) if len(self.event_rows) else math.nan

    def slips(self) -> NDArray[np.float64]:
        """Breakaway, arrest (infinite for the last, if it goes on) and direction of each slip, shape (m, 3)."""
        rows = self.event_rows
        begins = np.flatnonzero(rows[:, 1] == at.BREAKAWAY)
        ends = np.full(len(begins), math.inf)
        # Each slip ends before the next one begins.
        stopped = begins + 1 < len(rows)
        ends[stopped] = rows[begins[stopped] + 1, 0]
        return np.column_stack([rows[begins, 0], ends, rows[begins, 2]])


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
    compensation : torques that the controller adds; it looks at the joint once a period of ``advance``, and its own
        period counts for nothing but its filter.

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
        compensation: Compensation | None = None,
    ) -> None:
        require_finite("position", position)
        require_finite("load", load)
        self.joint = joint
        self.load = load
        self.sampled = sampled
        self.control_delay = control_delay
        self._held = np.array([0.0, error_integral, position, 0.0])
        self.compensation = compensation
        self.gains = gains
        self._state = np.zeros(at.STATE_SIZE)
        self._state[at.POSITION] = self._state[at.LOAD_POSITION] = position
        self._state[at.INTEGRAL] = error_integral
        self._state[at.LEVEL] = float(joint.friction.stribeck)
        self._history = np.zeros((0, 3))

    @classmethod
    def under(
        cls,
        joint: Joint,
        gains: Gains,
        conditions: OperatingConditions,
        *,
        position: float = 0.0,
        carried: float | None = None,
    ) -> JointSimulation:
        """Simulation under operating conditions, with an integral that carries a torque [N·m], the load by default."""
        carried = conditions.load if carried is None else carried
        return cls(
            joint, gains, position=position, load=conditions.load,
            error_integral=carried / float(gains.integral) if gains.integral else 0.0,
            sampled=conditions.controller_period > 0,
            control_delay=conditions.control_delay, compensation=conditions.compensation,
        )  # fmt: skip

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
    def compensation(self) -> Compensation | None:
        """What the controller adds; setting it takes effect with the next period."""
        return self._compensation

    @compensation.setter
    def compensation(self, compensation: Compensation | None) -> None:
        self._compensation = compensation
        self._compensating = np.zeros(at.COMPENSATION_SIZE) if compensation is None else compensation.numbers

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._state[at.TIME])

    @property
    def position(self) -> float:
        """Position of the motor [rad]."""
        return float(self._state[at.POSITION])

    @property
    def stuck(self) -> bool:
        """Whether static friction holds the joint now."""
        return bool(self._state[at.DIRECTION] == 0.0)

    @property
    def deflection(self) -> float:
        """Of a contact that gives way [rad]."""
        return float(self._state[at.DEFLECTION])

    @property
    def stribeck_level(self) -> float:
        """F_s of the slip, or at the beginning of the present rest [N·m]."""
        return float(self._state[at.LEVEL])

    def advance(
        self,
        period: float,
        references: NDArray[np.float64],
        reference_velocities: NDArray[np.float64],
        torque: float = 0.0,
    ) -> Trajectory:
        """Integrate over ``len(references)`` periods [s].

        ``references[i]`` [rad] is the desired position at the start of period i; during the period it
        moves with ``reference_velocities[i]`` [rad/s]. ``torque`` [N·m] is what somebody tells the controller to add.
        """
        require_positive("period", period)
        references = np.ascontiguousarray(references, dtype=float)
        reference_velocities = np.ascontiguousarray(reference_velocities, dtype=float)
        require_finite("references", references)
        require_finite("reference_velocities", reference_velocities)
        if references.shape != reference_velocities.shape or references.ndim != 1:
            raise ValueError(f"{references.shape=} but {reference_velocities.shape=}; both must be (n,)")
        parameters = self._parameters()
        if self.time == 0.0 and not self._rigid:
            self._lean_on_contact(references[0], reference_velocities[0])
        step = self._step(parameters)
        self._make_room(step, period)
        start = self.time
        samples = np.empty((references.size, 3))
        events = np.empty((8 * references.size + 16, at.EVENT_COLUMNS))
        added = np.full(references.size, float(torque))
        if self._compensation is not None and self._compensation.feedforward > 0:
            added += self._compensation.feedforward_torque(reference_velocities)
        count = kernel.advance(
            self._state, self._history, parameters, self._held, self.sampled, self.control_delay,
            step, period, references, reference_velocities, added, self._compensating, samples, events,
        )  # fmt: skip
        return Trajectory(
            time=start + period * np.arange(1.0, references.size + 1.0),
            position=samples[:, 0],
            velocity=samples[:, 1],
            effort=samples[:, 2],
            event_rows=events[: min(count, len(events))].copy(),
        )

    def _parameters(self) -> NDArray[np.float64]:
        friction, gains, transmission = self.joint.friction, self._gains, self.joint.transmission
        parameters = np.empty(at.PARAMETERS_SIZE)
        parameters[at.INERTIA] = self.joint.inertia
        parameters[at.COULOMB] = friction.coulomb
        parameters[at.VISCOUS] = friction.viscous
        parameters[at.STRIBECK] = friction.stribeck
        parameters[at.STRIBECK_VELOCITY] = friction.stribeck_velocity
        parameters[at.LAG] = friction.lag
        parameters[at.RISE_TIME] = friction.rise_time
        parameters[at.LAW] = LAWS[friction.law]
        parameters[at.CONTACT] = RIGID if self._rigid else CONTACTS[friction.contact]
        parameters[at.PRESLIDING_STIFFNESS] = 0.0 if self._rigid else friction.presliding_stiffness
        parameters[at.PRESLIDING_DAMPING] = friction.presliding_damping
        parameters[at.STIFFNESS] = gains.stiffness
        parameters[at.DAMPING] = gains.damping
        if not self.sampled:
            parameters[at.DAMPING] -= gains.stiffness * self.joint.actuation_delay
        parameters[at.INTEGRAL_GAIN] = gains.integral
        parameters[at.LOAD] = self.load
        parameters[at.LOAD_INERTIA :] = 0.0
        if transmission is not None:
            inertia = float(self.joint.inertia)
            parameters[at.INERTIA], parameters[at.LOAD_INERTIA] = transmission.masses(inertia)
            parameters[at.SPRING], parameters[at.SPRING_DAMPING] = transmission.spring(inertia)
            parameters[at.ON_LOAD] = transmission.on_load
        return parameters

    @property
    def _rigid(self) -> bool:
        friction, stiffness = self.joint.friction, abs(float(self._gains.stiffness))
        return friction.rigid or 0.0 < _RIGID_CONTACT * stiffness < float(friction.presliding_stiffness)

    def _lean_on_contact(self, reference: float, reference_velocity: float) -> None:
        """Let an elastic contact carry what the controller begins with, as far as it can; nothing rings then."""
        friction, gains = self.joint.friction, self._gains
        error = reference - self.position
        effort = float(
            gains.stiffness * error + gains.damping * reference_velocity + gains.integral * self._state[at.INTEGRAL]
        )
        self._held[at.EFFORT] = effort
        most = float(friction.coulomb + friction.stribeck)
        self._state[at.DEFLECTION] = min(max(effort - self.load, -most), most) / float(friction.presliding_stiffness)

    @staticmethod
    def _step(parameters: NDArray[np.float64]) -> float:
        inertia = parameters[at.INERTIA]
        frequency = math.sqrt(abs(parameters[at.STIFFNESS]) / inertia)
        decay = abs(parameters[at.DAMPING] + parameters[at.VISCOUS]) / inertia
        if parameters[at.SPRING] > 0:
            # No mode is faster than the sum of all that springs do to the motor and to the load.
            each = 1.0 / inertia + 1.0 / parameters[at.LOAD_INERTIA]
            contact = parameters[at.PRESLIDING_STIFFNESS] / inertia
            frequency = math.sqrt(frequency**2 + parameters[at.SPRING] * each + contact)
            decay += parameters[at.SPRING_DAMPING] * each + parameters[at.PRESLIDING_DAMPING] / inertia
        # The kernel's steps end with the sampling periods and are no longer than the lag.
        return float(1.0 / (_STEPS_PER_RADIAN * max(frequency, decay, 1e-9)))

    def _make_room(self, step: float, period: float) -> None:
        """Let the ring hold the velocities of one lag, keeping what it has."""
        lag = float(self.joint.friction.lag)
        shortest = min(step, period)
        capacity = int(3 * lag / shortest) + 2 * int(lag / period) + _REMEMBERED
        if capacity <= len(self._history):
            return
        history = np.zeros((capacity, 3))
        head, count = int(self._state[at.HISTORY_HEAD]), int(self._state[at.HISTORY_COUNT])
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
        kind=EventKind.BREAKAWAY if row[1] == at.BREAKAWAY else EventKind.ARREST,
        time=float(row[0]),
        direction=int(row[2]),
        position=float(row[3]),
        stribeck_level=float(row[4]),
    )
