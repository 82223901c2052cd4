# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Joints drawn at random and recordings of them, for the estimator's tests and benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import Event, EventKind, JointSimulation, Trajectory
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow, slip_window
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, FloatArray

DURATION, RATE = 30.0, 1000.0
_LEAST_SLIPS = 4  # at each of the two speeds
_SPEED_FACTORS = (0.4, 0.5, 2.0, 2.5)


@dataclass(frozen=True)
class RandomRecording:
    """A joint that sticks and slips from rest at two speeds, and what an encoder saw of it."""

    joint: Joint
    gains: Gains
    batch: Batch
    events: tuple[Event, ...]
    resolution: float
    speeds: tuple[float, float]

    def without_forces(self) -> Batch:
        """Position alone."""
        return Batch(time=self.batch.time, position=self.batch.position)

    def noisy(self, seed: int) -> Batch:
        """At 200 Hz, effort noise of 2 % of coulomb, 5 % of samples lost, stamps off by up to half a period."""
        rng = np.random.default_rng(seed)
        kept = np.arange(0, len(self.batch), 5)
        kept = kept[rng.random(len(kept)) > 0.05]
        batch = self.batch.where(kept)
        time = batch.time + rng.uniform(-0.5, 0.5, len(kept)) * 5.0 / RATE
        order = np.argsort(time)
        coulomb = float(self.joint.friction.coulomb)
        effort = float(self.gains.stiffness) * (batch.reference_position - batch.position)
        return Batch(
            time=time[order],
            position=batch.position,
            reference_position=batch.reference_position,
            effort=effort + 0.02 * coulomb * rng.standard_normal(len(kept)),
        )


def random_joint(rng: np.random.Generator) -> tuple[Joint, float]:
    """A joint and the natural frequency of its control [1/s]."""

    def between(low: float, high: float) -> float:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))

    inertia, frequency = between(0.01, 50.0), float(rng.uniform(5.0, 40.0))
    stribeck_velocity = between(1e-3, 3e-2)
    stribeck = between(0.5, 10.0) * inertia * frequency * stribeck_velocity
    friction = Friction(
        stribeck=stribeck,
        stribeck_velocity=stribeck_velocity,
        lag=between(0.005, 0.1),
        rise_time=between(0.05, 2.0),
        viscous=2.0 * between(0.003, 0.1) * inertia * frequency,
        coulomb=between(1.0, 6.0) * stribeck,
    )
    return Joint(inertia=inertia, friction=friction), frequency


def driven(joint: Joint, gains: Gains, speeds: tuple[float, float], seconds: float) -> tuple[FloatArray, Trajectory]:
    """References at one speed, then as long at the other, and the motion of the joint that follows them."""
    count = round(seconds * RATE)
    velocities = np.where(np.arange(count) < count // 2, *speeds)
    # The spring is nearly drawn already, so that the slowest joints slip within the record too.
    drawn = (float(joint.friction.coulomb) + 0.3 * float(joint.friction.stribeck)) / float(gains.stiffness)
    references = drawn + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / RATE
    return references, JointSimulation(joint, gains).advance(1.0 / RATE, references, velocities)


def random_recording(seed: int) -> RandomRecording:
    """A recording of some joint that sticks and slips at both speeds; others are drawn until one does."""
    rng = np.random.default_rng(seed)
    while True:
        joint, frequency = random_joint(rng)
        gains = Gains(stiffness=float(joint.inertia) * frequency**2)
        first = float(joint.friction.stribeck_velocity) * 10.0 ** rng.uniform(-0.5, 0.5)
        second = first * float(rng.choice(_SPEED_FACTORS))
        references, motion = driven(joint, gains, (first, second), DURATION)
        slips = [event for event in motion.events if event.kind is EventKind.ARREST]
        early = sum(event.time < 0.5 * DURATION for event in slips)
        if min(early, len(slips) - early) < _LEAST_SLIPS:
            continue
        begins = [event for event in motion.events if event.kind is EventKind.BREAKAWAY]
        ways = [end.position - begin.position for begin, end in zip(begins, slips, strict=False)]
        resolution = float(np.median(ways)) / math.exp(rng.uniform(math.log(20.0), math.log(500.0)))
        position = np.concatenate([[0.0], motion.position[:-1]])
        batch = Batch(
            time=np.concatenate([[0.0], motion.time[:-1]]),
            position=resolution * np.round(position / resolution),
            reference_position=references,
        )
        return RandomRecording(joint, gains, batch, motion.events, resolution, (first, second))


def cut_slips(batch: Batch, gains: Gains | None) -> tuple[list[SlipWindow], list[Cycle]]:
    """The slips of a recording as the monitor's detection finds them."""
    monitor = JointMonitor()
    cycles = monitor.process(batch) + monitor.finish()
    state = monitor.assessment()
    windows = [slip_window(batch, cycle, gains, resolution=state.resolution, noise=state.noise) for cycle in cycles]
    return [window for window in windows if window is not None], cycles


def later(window: SlipWindow, seconds: float) -> SlipWindow:
    """The same slip at a later time."""
    return replace(
        window,
        rest_begin=window.rest_begin + seconds,
        breakaway=window.breakaway + seconds,
        arrest=window.arrest + seconds,
        times=window.times + seconds,
    )
