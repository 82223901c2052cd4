# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Motions drawn at random that are no stick-slip, and stick-slip of joints drawn at random, as an encoder sees them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from support import TrueStick

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, simulate
from stickslip_ros.monitoring.samples import Batch

FloatArray = NDArray[np.float64]
Shape = Callable[[FloatArray, float], FloatArray]

RATES = (50.0, 100.0, 200.0, 500.0)
RESOLUTIONS = (0.0, 1e-6, 2.6e-6, 2.5e-5, 1.2e-4, 3.8e-4, 1.5e-3)
NOISES = (0.0, 0.0, 1e-5, 5e-5, 2e-4)
_SETTLED = 0.5  # [s] before the first motion
_LEAST_SLIPS = 6


def between(generator: np.random.Generator, low: float, high: float) -> float:
    """Drawn between two bounds, evenly in its logarithm."""
    return math.exp(generator.uniform(math.log(low), math.log(high)))


def minimum_jerk(share: FloatArray, _: float) -> FloatArray:
    """Way over time, both from 0 to 1, of the motion of least jerk."""
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def trapezoid(share: FloatArray, accelerating: float) -> FloatArray:
    """Likewise of constant acceleration, speed and deceleration; the share of time that it accelerates."""
    speed = 1.0 / (1.0 - accelerating)
    begins, ends = 0.5 * speed / accelerating * share**2, 1.0 - 0.5 * speed / accelerating * (1.0 - share) ** 2
    return np.where(
        share < accelerating,
        begins,
        np.where(share > 1.0 - accelerating, ends, speed * (share - 0.5 * accelerating)),
    )


def step(share: FloatArray, _: float) -> FloatArray:
    """Likewise all at once."""
    return np.ones_like(share)


@dataclass(kw_only=True)
class _Move:
    """The next move of a program: how far [rad], how long, the pause after it [s], the share that it accelerates."""

    distance: float
    duration: float
    pause: float
    accelerating: float


class _AtRandom:
    """Any way, any duration, any pause."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator, self._accelerating = generator, generator.uniform(0.1, 0.5)

    def next(self) -> _Move:
        draw = self._generator
        return _Move(
            distance=draw.choice([-1, 1]) * between(draw, 0.005, 1.0),
            duration=between(draw, 0.15, 3.0),
            pause=between(draw, 0.05, 4.0),
            accelerating=self._accelerating,
        )


class _Planned:
    """Any way at the limits of speed and acceleration, with pauses about one duration."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._speed, self._acceleration = generator.uniform(0.2, 2.0), generator.uniform(1.0, 10.0)
        self._pause = between(generator, 0.1, 2.5)

    def next(self) -> _Move:
        draw, speed, acceleration = self._generator, self._speed, self._acceleration
        way = between(draw, 0.01, 1.0)
        reaches_speed = way > speed**2 / acceleration
        duration = way / speed + speed / acceleration if reaches_speed else 2.0 * math.sqrt(way / acceleration)
        return _Move(
            distance=draw.choice([-1, 1]) * way,
            duration=duration,
            pause=self._pause * math.exp(0.3 * draw.standard_normal()),
            accelerating=min(0.5, speed / acceleration / duration),
        )


class _Equal:
    """Equal steps: there and back with regular pauses, as a machine; or at a person's pace, who turns now and then."""

    def __init__(self, generator: np.random.Generator, *, by_a_person: bool) -> None:
        self._generator, self._by_a_person = generator, by_a_person
        self._way, self._duration = between(generator, 0.02, 0.8), between(generator, 0.2, 2.5)
        self._pause, self._accelerating = between(generator, 0.1, 2.5), generator.uniform(0.1, 0.5)
        self._one_way, self._made, self._sign = int(generator.integers(2, 13)), 0, 1

    def next(self) -> _Move:
        self._made += 1
        turns = self._made % self._one_way == 0
        pause = self._pause
        if self._by_a_person:
            turns = self._generator.random() < 0.125
            pause *= math.exp(0.5 * self._generator.standard_normal())
        elif turns:
            pause *= 3.0
        distance = self._sign * self._way
        self._sign *= -1 if turns else 1
        return _Move(distance=distance, duration=self._duration, pause=pause, accelerating=self._accelerating)


def _moves(
    generator: np.random.Generator,
    time: FloatArray,
    *,
    shape: Shape,
    program: Callable[[np.random.Generator], _AtRandom | _Planned | _Equal],
) -> FloatArray:
    """Moves with pauses between them."""
    moves, place, now = program(generator), generator.uniform(-1.0, 1.0), time[0] + _SETTLED
    places = np.full_like(time, place)
    while now < time[-1]:
        move = moves.next()
        begin, end = np.searchsorted(time, [now, now + move.duration])
        shares = (time[begin:end] - now) / move.duration
        places[begin:end] = place + move.distance * shape(shares, move.accelerating)
        place += move.distance
        places[end:] = place
        now += move.duration + move.pause
    return places


def _constant(generator: np.random.Generator, time: FloatArray) -> FloatArray:
    """Constant speeds one after another, each for up to a hundred seconds."""
    velocities, now = np.zeros_like(time), time[0] + _SETTLED
    while now < time[-1]:
        velocities[np.searchsorted(time, now) :] = generator.choice([-1, 1]) * between(generator, 0.003, 1.0)
        now += between(generator, 10.0, 100.0)
    return np.cumsum(velocities) * (time[1] - time[0])


def _sine(generator: np.random.Generator, time: FloatArray) -> FloatArray:
    """One amplitude and period."""
    return between(generator, 0.01, 1.0) * np.sin(2.0 * math.pi * time / between(generator, 1.0, 20.0))


def human(generator: np.random.Generator, time: FloatArray) -> FloatArray:
    """Submovements of lognormal speed that overlap, with pauses, and tremor while they last."""
    velocities, now, interval = np.zeros_like(time), float(time[0]), time[1] - time[0]
    while now < time[-1]:
        way = generator.choice([-1, 1]) * between(generator, 0.005, 0.6)
        for _ in range(int(generator.integers(1, 4))):
            width, place = generator.uniform(0.2, 0.45), math.log(generator.uniform(0.12, 0.5))
            begin, end = np.searchsorted(time, [now + 1e-6, now + 3.0])
            since = time[begin:end] - now
            bell = np.exp(-((np.log(since) - place) ** 2) / (2.0 * width**2)) / (since * width * math.sqrt(2 * math.pi))
            velocities[begin:end] += way * math.exp(0.4 * generator.standard_normal()) * bell
            now += generator.uniform(0.15, 0.6)
        if generator.random() < 0.6:
            now += between(generator, 0.1, 4.0)
    tremor = 1e-4 * np.sin(2.0 * math.pi * 9.0 * time + generator.uniform(0.0, 6.0))
    return np.cumsum(velocities) * interval + np.where(np.abs(velocities) > 1e-3, tremor, 0.0)


SHAPES: dict[str, Shape] = {"minimum-jerk moves": minimum_jerk, "trapezoids": trapezoid, "commanded steps": step}
PROGRAMS: dict[str, Callable[[np.random.Generator], _AtRandom | _Planned | _Equal]] = {
    "at random": _AtRandom,
    "planned": _Planned,
    "equal steps with regular pauses": partial(_Equal, by_a_person=False),
    "equal steps at a person's pace": partial(_Equal, by_a_person=True),
}
TELEOPERATION, HAND_GUIDING = "teleoperation", "hand guiding"
REFERENCES: dict[str, Callable[[np.random.Generator, FloatArray], FloatArray]] = {
    "constant speed": _constant,
    "sine": _sine,
    **{
        f"{shape}, {program}": partial(_moves, shape=SHAPES[shape], program=PROGRAMS[program])
        for shape in SHAPES
        for program in PROGRAMS
    },
    TELEOPERATION: human,
    HAND_GUIDING: human,
}


def followed(time: FloatArray, references: FloatArray, *, frequency: float, damping_ratio: float) -> FloatArray:
    """Places of a joint under a good servo, a second-order system of this natural frequency [Hz]."""
    from scipy.signal import (
        cont2discrete,
        lfilter,
    )  # takes a second and a half of a core, in each process that collects tests

    omega = 2.0 * math.pi * frequency
    system = ([omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2])
    numerator, denominator, _ = cont2discrete(system, time[1] - time[0])
    places: FloatArray = references[0] + lfilter(numerator.ravel(), denominator, references - references[0])
    return places


def measured(generator: np.random.Generator, places: FloatArray, *, noise: float, resolution: float) -> FloatArray:
    """Places as a noisy sensor reads them in counts [rad]; 0 for none."""
    noisy = places + noise * generator.standard_normal(len(places))
    return resolution * np.round(noisy / resolution) if resolution > 0.0 else noisy


def random_motion(kind: str, generator: np.random.Generator, *, duration: float) -> Batch:
    """A motion of one of :data:`REFERENCES` that follows its reference, with rate, servo and encoder drawn at random.

    What is guided by hand has the position measured, now or one sample late, as its reference, and velocity 0.
    """
    rate = float(generator.choice(RATES))
    time = np.arange(round(duration * rate)) / rate
    noise, resolution = float(generator.choice(NOISES)), float(generator.choice(RESOLUTIONS))
    references = REFERENCES[kind](generator, time)
    if kind == HAND_GUIDING:
        position = measured(generator, references, noise=noise, resolution=resolution)
        late = int(generator.integers(0, 2))
        return Batch(
            time=time,
            position=position,
            reference_position=np.concatenate([position[:late], position[: len(position) - late]]),
            reference_velocity=np.zeros_like(position),
        )
    places = followed(
        time, references, frequency=generator.uniform(2.0, 10.0), damping_ratio=generator.uniform(0.7, 1.2)
    )
    if kind == TELEOPERATION:
        # The leader's position is measured too.
        references = references + generator.choice([0.0, 1e-5, 1e-4]) * generator.standard_normal(len(references))
    position = measured(generator, places, noise=noise, resolution=resolution)
    return Batch(time=time, position=position, reference_position=references)


def arriving(times: FloatArray, generator: np.random.Generator, wait: float) -> FloatArray:
    """Stamps of samples that wait to be sent together, for so long at the median [s], as their receiver notes them."""
    sent = times[0] + np.cumsum(0.25 * wait + generator.exponential(wait, int(4.0 * np.ptp(times) / wait) + 4))
    following = 5e-5 * np.arange(len(times))
    together: FloatArray = np.maximum.accumulate(sent[np.searchsorted(sent, times)] - following) + following
    return together


def without_reference(batch: Batch) -> Batch:
    """Position alone."""
    return Batch(time=batch.time, position=batch.position)


@dataclass(frozen=True, kw_only=True)
class RandomStickSlip:
    """A joint that sticks and slips at one speed, and what an encoder saw of it.

    Attributes
    ----------
    sticks : rests between slips, as the integration met them.
    rate : [Hz]; counts : of the encoder in the median slip; damping_ratio : of the controlled joint.
    """

    batch: Batch
    sticks: tuple[TrueStick, ...]
    rate: float
    counts: float
    damping_ratio: float


def random_stick_slip(seed: int, *, rate: float | None = None, longest: float = 40.0) -> RandomStickSlip:
    """Stick-slip of some joint; others are drawn until one sticks and slips often enough [Hz, s]."""
    generator = np.random.default_rng(seed)
    rate = float(generator.choice(RATES)) if rate is None else rate
    while True:
        # A dozen samples in a natural period, that there is something to be seen of a slip.
        frequency = between(generator, 0.5, min(8.0, rate / 12.0))
        omega, inertia, way = 2.0 * math.pi * frequency, between(generator, 0.05, 20.0), between(generator, 5e-4, 0.1)
        damping_ratio = float(generator.choice([0.0, generator.uniform(0.0, 0.4), generator.uniform(0.0, 1.2)]))
        force = 0.5 * inertia * omega**2 * way
        coulomb = generator.uniform(1.0, 4.0) * force
        speed = way * frequency * between(generator, 0.03, 1.0)
        friction = Friction(
            coulomb=coulomb,
            viscous=0.002 * coulomb / speed,
            stribeck=generator.uniform(0.8, 1.3) * force,
            stribeck_velocity=generator.uniform(0.3, 2.0) * speed,
            lag=generator.uniform(0.0, 0.1) / frequency,
            rise_time=generator.uniform(0.0, 0.5) / frequency,
        )
        joint = Joint(inertia=inertia, friction=friction)
        gains = Gains(stiffness=inertia * omega**2, damping=2.0 * damping_ratio * omega * inertia)
        # Whole periods of the integration between samples.
        every = max(math.ceil(1000.0 / rate), math.ceil(200.0 * frequency / rate))
        period = 1.0 / rate / every
        count = round(min(longest, 40.0 * way / speed + 2.0) / period)
        velocity = float(generator.choice([-1, 1])) * speed
        moves = period * np.arange(count) >= _SETTLED
        velocities = np.where(moves, velocity, 0.0)
        references = period * np.concatenate([[0.0], np.cumsum(velocities)[:-1]])
        trajectory = simulate(joint, gains, references, velocities, period=period)
        pairs = [(one, other) for one, other in itertools.pairwise(trajectory.events) if one.kind is EventKind.ARREST]
        if len(pairs) < _LEAST_SLIPS:
            continue
        counts = between(generator, 7.0, 3000.0)
        slips = [abs(other.position - one.position) for one, other in itertools.pairwise(one for one, _ in pairs)]
        resolution = float(np.median(slips)) / counts
        pick = slice(every - 1, None, every)
        position = trajectory.position[pick] + resolution * generator.uniform(0.0, 1.0)
        noise = float(generator.choice([0.0, 0.3])) * resolution
        batch = Batch(
            time=trajectory.time[pick],
            position=measured(generator, position, noise=noise, resolution=resolution),
            reference_position=(references + period * velocities)[pick],
        )
        sticks = tuple(TrueStick(one.time, other.time) for one, other in pairs)
        return RandomStickSlip(batch=batch, sticks=sticks, rate=rate, counts=counts, damping_ratio=damping_ratio)
