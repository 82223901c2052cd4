# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Machines whose friction is not everywhere the same, drawn at random, and what a monitor learns of them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from machines import Machine, drawn, simulate
from random_joints import random_joint

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

LOAD, PLACE, EVEN, WEIGHT = "load", "position", "even", "weight"
KINDS = (LOAD, PLACE, WEIGHT, EVEN)  # friction grows with the load; varies; a load alone varies; nothing does
DURATION, TURNS, RATE = 80.0, 4, 250.0  # [s], ways there or back, [Hz]
_LEAST_SLIPS, _MOST_SLIPS = 40, 300


@dataclass(frozen=True, kw_only=True)
class VaryingRecording:
    """What an encoder saw; ``slips`` as of :class:`machines.Motion`."""

    machine: Machine
    gains: Gains
    speed: float
    batch: Batch
    slips: np.ndarray


def recorded(machine: Machine, gains: Gains, speed: float, resolution: float) -> VaryingRecording:
    """To and fro at one speed."""
    times = np.arange(round(DURATION * RATE)) / RATE
    velocities = np.where((times / DURATION * TURNS).astype(int) % 2 == 0, speed, -speed)
    references = drawn(machine, gains) + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / RATE
    motion = simulate(machine, gains, references, velocities, 1.0 / RATE)
    batch = Batch(
        time=times, position=resolution * np.round(motion.position / resolution), effort=motion.effort,
        reference_position=references, reference_velocity=velocities,
    )  # fmt: skip
    return VaryingRecording(machine=machine, gains=gains, speed=speed, batch=batch, slips=motion.slips)


def random_varying(seed: int, kind: str) -> VaryingRecording:
    """A recording of some machine that sticks and slips; the same seed gives the same joint of every kind, mostly."""
    for attempt in itertools.count():
        rng = np.random.default_rng((seed, attempt))
        joint, frequency = random_joint(rng)
        machine = Machine.of(joint)
        gains = Gains(stiffness=machine.inertia * frequency**2, damping=float(rng.uniform(0.0, 3.0)) * machine.viscous)
        speed = machine.stribeck_velocity * 10.0 ** rng.uniform(-0.2, 0.5)
        way = speed * DURATION / TURNS
        slope, share, rounds = rng.uniform(0.05, 0.15), rng.uniform(0.05, 0.2), rng.uniform(2.0, 5.0)
        # As much of a quarter of a turn as the joint goes changes the weight by a few times the Stribeck friction.
        weight = rng.uniform(2.0, 4.0) * machine.coulomb
        if kind in (LOAD, WEIGHT):
            machine = replace(machine, gravity=weight, bend=0.5 * math.pi / way)
        if kind == LOAD:
            machine = replace(machine, load_share=slope)
        if kind == PLACE:
            machine = replace(machine, ripple=share, stribeck_ripple=share, ripples=rounds / way)
        try:
            found = recorded(machine, gains, speed, 1e-5)
        except MemoryError:
            continue
        if _LEAST_SLIPS <= len(found.slips) <= _MOST_SLIPS:
            slip = float(np.median(np.abs(found.slips[:, 4] - found.slips[:, 1])))
            return recorded(machine, gains, speed, slip / 200.0)
    raise AssertionError


def learnt_monitor(recording: VaryingRecording, *, as_it_goes: bool = False) -> JointMonitor:
    """A monitor that has seen it all, and studies the slips at the end, or as they come, which takes longer."""
    monitor = JointMonitor(None, recording.gains, studies_at_once=as_it_goes, at_arrest=True)
    monitor.process(recording.batch)
    monitor.finish()
    monitor.learn()
    return monitor
