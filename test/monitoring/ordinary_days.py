# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Random days of random joints: moves of 0.03 to 2 rad, pauses, and slow stretches in which the joint sticks and slips.

Every joint follows the paper's friction law under P or PD control, as an encoder sees it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from random_motions import FloatArray, between, measured, minimum_jerk, trapezoid

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import EventKind, simulate
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

RATES = (100, 200, 500, 1000)  # [Hz]
PERIOD = 1e-3  # [s] of the simulation
LEAST_SAMPLES_AT_REST = 4
LEAST_COUNTS = 12.0
OVERLAP = 0.3  # of a slip: so much of it a cycle must cover to be it
_SETTLED_AFTER = 1.0  # [s] a pause must have lasted before the joint is to be called at rest
_STRETCHES = 3
_LONG_SLIDE = 3.0  # of the median slip's duration


@dataclass(frozen=True)
class TrueSlip:
    """A slip after a rest, as the integration met it; times [s], signed distance [rad]."""

    stopped: float
    breakaway: float
    arrest: float
    distance: float

    @property
    def dwell(self) -> float:
        """Time at rest before it [s]."""
        return self.breakaway - self.stopped


@dataclass(frozen=True, kw_only=True)
class OrdinaryDay:
    """A recording, and what is true of it.

    Attributes
    ----------
    slips : those in slow stretches that stood and moved for long enough to be seen; every : of the whole day.
    stretches : beginnings and ends of the slow ones [s]; moves, pauses : likewise.
    sticking : where slips follow one another, from the beginning of the second one to the end of the last [s].
    rate : [Hz]; counts : of the encoder in the median slip.
    """

    batch: Batch
    slips: tuple[TrueSlip, ...]
    every: tuple[TrueSlip, ...]
    stretches: tuple[tuple[float, float], ...]
    moves: tuple[tuple[float, float], ...]
    pauses: tuple[tuple[float, float], ...]
    sticking: tuple[tuple[float, float], ...]
    rate: int
    counts: float

    def watched(self, *, with_reference: bool) -> Batch:
        """The samples, with the reference or without."""
        if with_reference:
            return self.batch
        return Batch(time=self.batch.time, position=self.batch.position)


def _random_joint(generator: np.random.Generator) -> tuple[Joint, Gains, float]:
    """A joint that may stick, its gains, and a speed at which it is likely to."""
    inertia, omega = 10 ** generator.uniform(-1.5, 1.5), generator.uniform(5.0, 25.0)
    stribeck_velocity, momentum = 10 ** generator.uniform(-3.3, -1.5), inertia * omega
    friction = Friction(
        stribeck=generator.uniform(3.0, 10.0) * momentum * stribeck_velocity,
        stribeck_velocity=stribeck_velocity,
        lag=10 ** generator.uniform(-2.3, -1.5),
        rise_time=10 ** generator.uniform(-1.3, -0.3),
        viscous=generator.uniform(0.02, 0.1) * momentum,
        coulomb=generator.uniform(0.3, 3.0) * momentum * stribeck_velocity,
    )
    damping = momentum * float(generator.choice([0.0, generator.uniform(0.0, 0.6)]))
    gains = Gains(stiffness=momentum * omega, damping=damping)
    return Joint(inertia=inertia, friction=friction), gains, stribeck_velocity * generator.uniform(0.3, 1.5)


def _sticking(slips: list[TrueSlip]) -> list[tuple[float, float]]:
    """From the second slip on to the last one, where three or more follow one another; a long slide ends that."""
    if len(slips) < 3:
        return []
    longest = _LONG_SLIDE * float(np.median([one.arrest - one.breakaway for one in slips]))
    runs: list[list[TrueSlip]] = [[]]
    for one in slips:
        follows = bool(runs[-1]) and one.stopped == runs[-1][-1].arrest and one.distance * runs[-1][-1].distance > 0.0
        if one.arrest - one.breakaway > longest:
            runs.append([])
        elif follows:
            runs[-1].append(one)
        else:
            runs.append([one])
    return [(run[1].breakaway, run[-1].arrest) for run in runs if len(run) >= 3]


def ordinary_day(seed: int) -> OrdinaryDay:
    """A day; others are drawn until the joint sticks in its slow stretches."""
    generator = np.random.default_rng(seed)
    while True:
        joint, gains, speed = _random_joint(generator)
        pieces: list[FloatArray] = [np.zeros(round(generator.uniform(0.3, 2.0) / PERIOD))]
        kinds: list[str] = ["pause"]
        slip = 4.0 * speed * 2.0 * math.pi / math.sqrt(float(gains.stiffness) / float(joint.inertia))
        for _ in range(_STRETCHES):
            for _ in range(int(generator.integers(0, 4))):
                way, fastest = between(generator, 0.03, 2.0), generator.uniform(0.2, 1.0)
                count = max(round(1.9 * way / fastest / PERIOD), 2)
                share = np.arange(1, count + 1) / count
                shape = minimum_jerk(share, 0.0) if generator.random() < 0.5 else trapezoid(share, 0.25)
                pieces += [
                    generator.choice([-1, 1]) * way * shape,
                    np.zeros(round(between(generator, 0.3, 4.0) / PERIOD)),
                ]
                kinds += ["move", "pause"]
            duration = min(generator.uniform(3.0, 25.0) * slip / speed, 30.0)
            pieces += [
                generator.choice([-1, 1]) * speed * PERIOD * np.arange(1, round(duration / PERIOD) + 1),
                np.zeros(round(between(generator, 0.3, 4.0) / PERIOD)),
            ]
            kinds += ["slow", "pause"]
        references, begins, place = [], [], 0.0
        for piece in pieces:
            begins.append(PERIOD * sum(len(one) for one in references))
            references.append(place + piece)
            place = float(references[-1][-1])
        begins.append(PERIOD * sum(len(one) for one in references))
        reference = np.concatenate(references)
        velocity = np.gradient(reference, PERIOD)
        trajectory = simulate(joint, gains, reference, velocity, period=PERIOD)
        spans = {kind: [] for kind in ("move", "pause", "slow")}
        for kind, begin, end in zip(kinds, begins[:-1], begins[1:], strict=True):
            spans[kind].append((begin, end))
        rate = int(generator.choice(RATES))
        counts = between(generator, LEAST_COUNTS, 3000.0)
        every = [
            TrueSlip(stick.time, breakaway.time, arrest.time, arrest.position - breakaway.position)
            for stick, breakaway, arrest in zip(
                trajectory.events[:-2], trajectory.events[1:-1], trajectory.events[2:], strict=True
            )
            if stick.kind is EventKind.ARREST
        ]
        slips, sticking = [], []
        for begin, end in spans["slow"]:
            own = [one for one in every if begin <= one.breakaway < end]
            slips += [one for one in own if one.dwell >= LEAST_SAMPLES_AT_REST / rate]
            sticking += _sticking(own)
        if len(slips) < 6:
            continue
        resolution = float(np.median([abs(one.distance) for one in slips])) / counts
        pick = slice(None, None, round(1.0 / (rate * PERIOD)))
        noise = float(generator.choice([0.0, 0.3])) * resolution
        position = trajectory.position[pick] + resolution * generator.uniform()
        batch = Batch(
            time=trajectory.time[pick],
            position=measured(generator, position, noise=noise, resolution=resolution),
            reference_position=(reference + PERIOD * velocity)[pick],
        )
        seen = tuple(one for one in slips if abs(one.distance) >= LEAST_COUNTS * resolution)
        return OrdinaryDay(
            batch=batch, slips=seen, every=tuple(every), stretches=tuple(spans["slow"]), moves=tuple(spans["move"]),
            pauses=tuple(spans["pause"]), sticking=tuple(sticking), rate=rate, counts=counts,
        )  # fmt: skip


@dataclass
class DayTally:
    """Slips there were and were found, cycles that are none, and for how long the status was right [s].

    Attributes
    ----------
    outside : cycles outside of the slow stretches; false : of these, those that cover no slip of the simulation.
    """

    slips: int = 0
    found: int = 0
    cycles: int = 0
    outside: int = 0
    false: int = 0
    right: float = 0.0
    judged: float = 0.0

    @property
    def recall(self) -> float:
        """Share of the slips that were found."""
        return self.found / self.slips if self.slips else math.nan

    def add(self, other: DayTally) -> None:
        """Add another tally."""
        for name in ("slips", "found", "cycles", "outside", "false", "right", "judged"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


def is_found(slip: TrueSlip, cycles: list[Cycle]) -> bool:
    """Whether one of the cycles covers a slip."""
    least = OVERLAP * (slip.arrest - slip.breakaway)
    return any(min(cycle.arrest, slip.arrest) - max(cycle.breakaway, slip.breakaway) > least for cycle in cycles)


def watch_day(day: OrdinaryDay, *, with_reference: bool) -> DayTally:
    """What a monitor finds in a day that knows nothing of the joint."""
    monitor = JointMonitor()
    batch = day.watched(with_reference=with_reference)
    cycles = monitor.process(batch) + monitor.finish()
    outside = [
        cycle for cycle in cycles
        if not any(cycle.breakaway < end and cycle.arrest > begin for begin, end in day.stretches)
    ]  # fmt: skip
    tally = DayTally(
        slips=len(day.slips),
        found=sum(is_found(slip, cycles) for slip in day.slips),
        cycles=len(cycles),
        outside=len(outside),
        false=sum(not any(is_found(slip, [cycle]) for slip in day.every) for cycle in outside),
    )
    wanted = [(span, {Status.STICK_SLIP}) for span in day.sticking]
    wanted += [(span, set(Status) - {Status.STICK_SLIP}) for span in day.moves]
    wanted += [((begin + _SETTLED_AFTER, end), {Status.AT_REST}) for begin, end in day.pauses]
    for (begin, end), right in wanted:
        tally.judged += max(end - begin, 0.0)
        for segment in monitor.segments:
            if segment.status in right:
                tally.right += max(min(segment.end, end) - max(segment.start, begin), 0.0)
    return tally
