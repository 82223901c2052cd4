# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Motor and load on a spring, integrated by scipy's DOP853 from event to event: it shares no code with the kernels.

The friction, of the paper's law with memory and a rise, is at the motor. While that sticks, the load rings.
"""

from __future__ import annotations

import bisect
import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853
from scipy.optimize import brentq

from stickslip_ros.model.friction import Friction, Gains, Joint, Transmission
from stickslip_ros.model.outcome import Outcome

_WITHIN = 7  # places within a step at which an event is looked for
BREAKAWAY, ARREST = 1.0, -1.0


@dataclass(frozen=True, kw_only=True)
class RandomJoint:
    """A joint of two masses under PD control, that breaks away at a speed."""

    joint: Joint
    gains: Gains
    velocity: float

    @property
    def natural_period(self) -> float:
        """Of the controller's stiffness and both masses [s]."""
        return 2.0 * math.pi * math.sqrt(float(self.joint.inertia) / float(self.gains.stiffness))

    @property
    def start(self) -> float:
        """Where the reference begins, so that the joint breaks away at once [rad]."""
        friction = self.joint.friction
        force = float(friction.coulomb) + (1.0 + 1e-9) * float(friction.stribeck)
        return (force - float(self.gains.damping) * self.velocity) / float(self.gains.stiffness)


def random_joint(rng: np.random.Generator, encoder: str, damping: tuple[float, float] = (0.0, 0.1)) -> RandomJoint:
    """With a resonance of 5 to 40 Hz."""

    def between(low: float, high: float) -> float:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    inertia, frequency, stribeck_velocity = between(0.05, 20.0), rng.uniform(4.0, 25.0), between(2e-3, 3e-2)
    stribeck = between(0.5, 6.0) * inertia * frequency * stribeck_velocity
    friction = Friction(
        stribeck=stribeck,
        stribeck_velocity=stribeck_velocity,
        lag=between(0.01, 0.08),
        rise_time=between(0.05, 1.5),
        viscous=2.0 * between(0.003, 0.08) * inertia * frequency,
        coulomb=between(1.0, 5.0) * stribeck,
    )
    resonance = between(5.0, 40.0)
    transmission = Transmission(resonance=resonance, antiresonance=resonance / between(1.2, 3.0), encoder=encoder)
    return RandomJoint(
        joint=Joint(inertia=inertia, friction=friction, transmission=transmission),
        gains=Gains(stiffness=inertia * frequency**2, damping=2.0 * rng.uniform(*damping) * inertia * frequency),
        velocity=stribeck_velocity * 10.0 ** rng.uniform(-0.4, 0.4),
    )


def motion(one: RandomJoint, duration: float, tolerance: float = 1e-9) -> tuple[np.ndarray, np.ndarray]:
    """Events (time, kind, the motor's x, Stribeck level) and steps (time, then motor and load, each x and x˙)."""
    friction, transmission, velocity = one.joint.friction, one.joint.transmission, one.velocity
    names = ("coulomb", "stribeck", "stribeck_velocity", "lag", "rise_time", "viscous")
    coulomb, stribeck, scale, lag, rise_time, viscous = (float(getattr(friction, name)) for name in names)
    motor = float(one.joint.inertia) * (transmission.antiresonance / transmission.resonance) ** 2
    load = float(one.joint.inertia) - motor
    swing = 2.0 * math.pi * transmission.antiresonance
    spring, spring_damping = load * swing**2, 2.0 * transmission.spring_damping * load * swing
    stiffness, damping = float(one.gains.stiffness), float(one.gains.damping)
    seen = 2 if transmission.encoder == "load" else 0
    exact = tolerance * velocity * np.array([0.1, 1.0, 0.1, 1.0])
    time, state, level, since = 0.0, np.zeros(4), stribeck, 0.0
    events, steps = [], []

    def drive(time, state):
        twist = spring * (state[0] - state[2]) + spring_damping * (state[1] - state[3])
        ahead = one.start + velocity * time - state[seen]
        return stiffness * ahead + damping * (velocity - state[seen + 1]) - twist

    def load_acceleration(state):
        return (spring * (state[0] - state[2]) + spring_damping * (state[1] - state[3])) / load

    def risen(time):
        return level + (stribeck - level) * (time - since) / (time - since + rise_time)

    def rests(_, state):
        return np.array([0.0, 0.0, state[3], load_acceleration(state)])

    def excess(time, state):
        return abs(drive(time, state)) - coulomb - risen(time)

    def until(slopes, ends, bound, first=None, longest=math.inf, kept=None):
        """Follow to a time, or to where something rises through zero: whether it did."""
        nonlocal time, state
        solver = DOP853(
            slopes, time, state, bound, rtol=tolerance, atol=exact, max_step=min(longest, 0.6 / swing), first_step=first
        )
        while solver.status == "running":
            solver.step()
            within = solver.dense_output()
            if kept is not None:
                kept[0].append(solver.t_old)
                kept[1].append(within)
            places = np.linspace(solver.t_old, solver.t, _WITHIN)
            for low, high in itertools.pairwise(places):
                if ends(high, within(high)) > 0.0:
                    at_once = ends(low, within(low)) >= 0.0
                    time = low if at_once else brentq(lambda t: ends(t, within(t)), low, high, xtol=1e-14)  # noqa: B023
                    state = within(time)
                    return True
            time, state = solver.t, solver.y.copy()
            steps.append([time, *state])
        return False

    while time < duration:
        if excess(time, state) <= 0.0 and not until(rests, excess, duration):
            break
        direction, level, since = math.copysign(1.0, drive(time, state)), risen(time), time
        events.append([time, BREAKAWAY, state[0], level])
        kept: tuple[list, list] = ([], [])

        def shape(time):
            if time - since <= lag:  # noqa: B023
                return 1.0
            piece = kept[1][bisect.bisect_right(kept[0], time - lag) - 1]  # noqa: B023
            return 1.0 / (1.0 + (piece(time - lag)[1] / scale) ** 2)

        def slides(time, state):
            held = direction * (coulomb + level * shape(time)) + viscous * state[1]  # noqa: B023
            return np.array([state[1], (drive(time, state) - held) / motor, state[3], load_acceleration(state)])

        def back(_, state):
            return -direction * state[1]  # noqa: B023

        # At breakaway and one lag later the friction has a kink.
        bounds = [bound for bound in (time + lag, time + 2.0 * lag) if bound < duration]
        stopped = any(
            until(slides, back, bound, min(1e-7, bound - time), 0.999 * lag, kept) for bound in [*bounds, duration]
        )
        if not stopped:
            break
        state[1] = 0.0
        level, since = level * shape(time), time
        events.append([time, ARREST, state[0], level])
    return np.array(events), np.array(steps)


def outcome(one: RandomJoint, periods: float = 40.0) -> Outcome | None:
    """What becomes of it, by the last fifth of so many natural periods; None where that is not clear."""
    duration = periods * one.natural_period
    events, steps = motion(one, duration, 1e-7)
    if (events[events[:, 1] == ARREST, 0] > 0.8 * duration).any():
        return Outcome.STICKS
    departure = np.abs(steps[:, [2, 4]] / one.velocity - 1.0).max(axis=1)
    before, after = (
        departure[(steps[:, 0] > low * duration) & (steps[:, 0] <= high * duration)].max()
        for low, high in ((0.4, 0.6), (0.8, 1.0))
    )
    if after <= 0.1 and after <= max(before, 1e-6):
        return Outcome.STEADY
    return Outcome.SWINGS if 0.9 < after / before < 1.1 else None
