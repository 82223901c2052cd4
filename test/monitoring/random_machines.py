# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Machines drawn at random, each off the paper's law in one way, and recordings of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from machines import (
    ARREST_POSITION,
    EXPONENTIAL,
    LUGRE,
    POSITION,
    Machine,
    drawn,
    simulate,
)
from random_joints import random_joint

from stickslip_ros.model.friction import Gains, Transmission
from stickslip_ros.model.transmission import SIDES
from stickslip_ros.monitoring.samples import Batch

DURATION = 40.0  # [s]
_RATES = (200.0, 250.0, 500.0, 1000.0)  # [Hz]
_SPEED_FACTORS = (0.4, 0.5, 2.0, 2.5)
_COUNTS = (20.0, 500.0)  # of the encoder in a slip
_RESOLUTIONS = (1e-6, 2e-4)  # [rad]
_LEAST_SLIPS, _LEAST_OF_A_DIRECTION = 10, 4
_LOST = 0.05
_CREEP = (0.01, 0.025)  # of a slip, that bristles yield elastically before it, and once more in creep
_COMPLIANCE = (-3.0, -1.7)  # decimal logarithm of a contact's compliance, of the controller's
# Decimal logarithms of a resonance [Hz], and of its ratio to the antiresonance: 5 to 40 Hz, loads of 0.4 to 8 motors.
_RESONANCE, _OF_ANTIRESONANCE = (0.7, 1.6), (0.08, 0.48)
_REBOUND = 0.1  # of the longest slip
_SHORTEST_STOP, _LONGEST_STOP = 0.5, 2.0  # [s]

Velocities = Callable[[np.random.Generator, np.ndarray, list[float]], np.ndarray]
Change = Callable[[np.random.Generator, Machine, Gains], Machine]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One way of being off.

    Attributes
    ----------
    name : of the command line.
    velocities : commanded, at given times [s] and of given speeds [rad/s].
    change : what is not ideal in the machine.
    jitter : whether stamps are off by up to half a period, and samples lost.
    both_directions : whether slips in either direction are needed.
    sampled : whether the controller sees the joint with the samples, and holds an effort that acts up to a period late.
    """

    name: str
    velocities: Velocities
    change: Change
    jitter: bool = False
    both_directions: bool = False
    sampled: bool = False


@dataclass(frozen=True, kw_only=True)
class MachineRecording:
    """What an encoder saw of a machine.

    Attributes
    ----------
    speeds : commanded [rad/s], the first one first. resolution : of the encoder [rad].
    slips : rows as of :class:`machines.Motion`.
    """

    machine: Machine
    gains: Gains
    batch: Batch
    speeds: tuple[float, ...]
    resolution: float
    slips: np.ndarray

    @property
    def period(self) -> float:
        """From the first sample to the second [s]: that of all where stamps are even."""
        return float(self.batch.time[1] - self.batch.time[0])

    @property
    def delay(self) -> float:
        """By which the force of a controller that is sampled acts late, on average [s]: half a period, and more."""
        return 0.5 * self.period + self.machine.control_delay

    @property
    def one_way(self) -> bool:
        """Whether all slips have one direction."""
        ways = self.slips[:, ARREST_POSITION] - self.slips[:, POSITION]
        return bool((ways > 0).all() or (ways < 0).all())


def one_way(rng: np.random.Generator, times: np.ndarray, speeds: list[float]) -> np.ndarray:
    """One speed after the other, each as long."""
    return np.asarray(speeds)[np.minimum((times / DURATION * len(speeds)).astype(int), len(speeds) - 1)]


def to_and_fro(rng: np.random.Generator, times: np.ndarray, speeds: list[float]) -> np.ndarray:
    """Each speed forward, then back."""
    forward = (times / DURATION * 2 * len(speeds)).astype(int) % 2 == 0
    return np.where(forward, 1.0, -1.0) * one_way(rng, times, speeds)


def sine(rng: np.random.Generator, times: np.ndarray, speeds: list[float]) -> np.ndarray:
    """A sine of two to eight periods, whose highest speed is the first one."""
    return speeds[0] * np.cos(2.0 * math.pi * rng.integers(2, 9) * times / DURATION)


def triangle(rng: np.random.Generator, times: np.ndarray, speeds: list[float]) -> np.ndarray:
    """Two to six times to and fro at the first speed."""
    return np.where((times / DURATION * 2 * rng.integers(2, 7)).astype(int) % 2 == 0, speeds[0], -speeds[0])


def trapezoid(rng: np.random.Generator, times: np.ndarray, speeds: list[float]) -> np.ndarray:
    """Moves with ramps, and stops between them: two forward, two back, at one speed after the other."""
    moves = int(rng.integers(4, 9))
    move = DURATION / moves
    stop, ramp = rng.uniform(_SHORTEST_STOP, _LONGEST_STOP), rng.uniform(0.05, 0.3)
    number = np.minimum((times / move).astype(int), moves - 1)
    since = times - number * move
    shape = np.clip(np.minimum(since / ramp, (move - stop - since) / ramp), 0.0, 1.0)
    return np.where(number // 2 % 2 == 0, 1.0, -1.0) * np.asarray(speeds)[number % len(speeds)] * shape


def _as_it_is(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    return machine


def _loaded(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    return replace(machine, load=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.7)) * machine.coulomb)


def _on_bristles(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    # A slip is about twice as long as the Stribeck friction draws the spring.
    slip = 2.0 * machine.stribeck / float(gains.stiffness)
    stiffness = (machine.coulomb + machine.stribeck) / (rng.uniform(*_CREEP) * slip)
    return replace(
        machine, law=LUGRE, lag=0.0, rise_time=0.0, bristle_stiffness=stiffness,
        bristle_damping=math.sqrt(stiffness * machine.inertia),
    )  # fmt: skip


def _on_springs(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    stiffness = float(gains.stiffness) / 10.0 ** rng.uniform(*_COMPLIANCE)
    damping = float(rng.uniform(0.2, 1.0)) * math.sqrt(stiffness * machine.inertia)
    return replace(machine, bristle_stiffness=stiffness, bristle_damping=damping)


def _on_a_spring(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    resonance = 10.0 ** rng.uniform(*_RESONANCE)
    antiresonance = resonance / 10.0 ** rng.uniform(*_OF_ANTIRESONANCE)
    encoder = str(rng.choice(SIDES))
    return replace(
        machine, transmission=Transmission(resonance=resonance, antiresonance=antiresonance, encoder=encoder)
    )


def _dragged(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    # At the Stribeck velocity a tenth to a half as much as viscous friction; in a slip several times that.
    return replace(machine, drag=float(rng.uniform(0.1, 0.5)) * machine.viscous / machine.stribeck_velocity)


def _asymmetric(rng: np.random.Generator, machine: Machine, gains: Gains) -> Machine:
    return replace(machine, stribeck_asymmetry=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.03, 0.3)))


def _with(**changes: float) -> Change:
    return lambda rng, machine, gains: replace(machine, **changes)


CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition(name="base", velocities=one_way, change=_as_it_is),
        Condition(name="load_one_way", velocities=one_way, change=_loaded),
        Condition(name="load_both_ways", velocities=to_and_fro, change=_loaded, both_directions=True),
        Condition(name="asymmetric", velocities=to_and_fro, change=_asymmetric, both_directions=True),
        Condition(name="jitter_and_loss", velocities=one_way, change=_as_it_is, jitter=True),
        Condition(name="sine", velocities=sine, change=_as_it_is),
        Condition(name="triangle", velocities=triangle, change=_as_it_is),
        Condition(name="trapezoid", velocities=trapezoid, change=_as_it_is),
        Condition(name="drift", velocities=one_way, change=_with(drift=0.05 / 60.0)),
        Condition(name="ripple_20", velocities=one_way, change=_with(ripple=0.1, ripples=20.0)),
        Condition(name="ripple_200", velocities=one_way, change=_with(ripple=0.1, ripples=200.0)),
        Condition(name="exponential", velocities=one_way, change=_with(law=EXPONENTIAL)),
        Condition(name="lugre", velocities=one_way, change=_on_bristles),
        Condition(name="elastic_contact", velocities=one_way, change=_on_springs),
        Condition(name="scatter", velocities=one_way, change=_with(static_scatter=0.03)),
        Condition(name="drag", velocities=one_way, change=_dragged),
        Condition(name="two_masses", velocities=one_way, change=_on_a_spring),
        Condition(name="sampled", velocities=one_way, change=_as_it_is, sampled=True),
    )
}


def random_recording(seed: int, condition: Condition) -> MachineRecording:
    """A recording of some machine that sticks and slips; others are drawn until one does.

    The same seed gives the same joint under every condition, as long as it sticks and slips there too.
    """
    for attempt in itertools.count():
        found = _attempt(seed, attempt, condition)
        if found is not None:
            return found
    raise AssertionError


def _attempt(seed: int, attempt: int, condition: Condition) -> MachineRecording | None:
    # What a condition draws must not change what all have in common.
    rng, own = np.random.default_rng((seed, attempt)), np.random.default_rng((seed, attempt, 1))
    joint, frequency = random_joint(rng)
    machine = Machine.of(joint)
    gains = Gains(
        stiffness=machine.inertia * frequency**2,
        damping=float(rng.uniform(0.0, 3.0)) * machine.viscous,
    )
    rate = float(rng.choice(_RATES))
    first = machine.stribeck_velocity * 10.0 ** rng.uniform(-0.5, 0.5)
    count = int(rng.integers(1, 4))
    speeds = [first, *(first * rng.choice(_SPEED_FACTORS, size=2, replace=False)).tolist()][:count]
    fineness = rng.random()
    machine = condition.change(own, machine, gains)
    if condition.sampled:
        machine = replace(machine, sampled=True, control_delay=float(own.uniform(0.0, 1.0)) / rate)
    times = np.arange(round(DURATION * rate)) / rate
    velocities = condition.velocities(own, times, speeds)
    # The spring is nearly drawn already, so that the slowest joints slip within the record too.
    references = drawn(machine, gains) + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    motion = simulate(machine, gains, references, velocities, 1.0 / rate)
    ways = motion.slips[:, ARREST_POSITION] - motion.slips[:, POSITION]
    # Bristles rebound a little.
    slips = motion.slips[np.abs(ways) > _REBOUND * np.abs(ways).max(initial=0.0)]
    ways = slips[:, ARREST_POSITION] - slips[:, POSITION]
    fewest = min((ways > 0).sum(), (ways < 0).sum())
    if len(ways) < _LEAST_SLIPS or (condition.both_directions and fewest < _LEAST_OF_A_DIRECTION):
        return None
    slip = float(np.median(np.abs(ways)))
    finest, coarsest = max(_RESOLUTIONS[0], slip / _COUNTS[1]), min(_RESOLUTIONS[1], slip / _COUNTS[0])
    if finest > coarsest:
        return None
    resolution = coarsest * (finest / coarsest) ** fineness
    batch = Batch(
        time=times,
        position=resolution * np.round(motion.position / resolution),
        effort=motion.effort,
        reference_position=references,
        reference_velocity=velocities,
    )
    if condition.jitter:
        batch = batch.where(own.random(len(times)) >= _LOST)
        # Stamped late or early; the samples themselves keep their order.
        batch = replace(batch, time=np.sort(batch.time + own.uniform(-0.5, 0.5, len(batch)) / rate))
    return MachineRecording(
        machine=machine,
        gains=gains,
        batch=batch,
        speeds=tuple(speeds),
        resolution=resolution,
        slips=slips,
    )
