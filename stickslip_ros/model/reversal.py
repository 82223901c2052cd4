# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What friction does where the motion turns round: how long a joint stands, and how far it falls behind.

The joint is simulated by :mod:`stickslip_ros.model.joint_simulation`, with presliding if its friction has it. What is
measured of samples, simulated or recorded, is :func:`following_error`'s; so a prediction and a measurement are of the
same thing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_finite, require_positive
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import JointSimulation, Trajectory
from stickslip_ros.model.long_motion import UnstableLoopError, advanced, natural_period

FloatArray = NDArray[np.float64]

_SAMPLES = 64  # samples in the joint's natural period, or in a period of the reference, 1: at least
_MOST_SAMPLES = 2_000_000  # samples of a simulation, 1
# Simulated periods of a reference that repeats, 1; with integral action: the last reversals are evaluated.
_PERIODS, _PERIODS_OF_INTEGRAL = 2, 4
TURN = 1e-3  # way, of the reference's travel: after a shorter one the reference has not turned
_LEAST_SAMPLES = 3  # samples of a reference, 1: fewer have no reversal
_ROUNDING = 1e-9  # excess of a number of parts over an integer, 1: what rounding makes


@dataclass(frozen=True, kw_only=True)
class ReferenceMotion:
    """A sampled reference; between two samples it moves evenly.

    Attributes
    ----------
    period : between samples [s]. position : [rad], shape (n,).
    settles_at : time from which on it repeats what it did before, so that only what follows is looked at [s].

    Raises
    ------
    InvalidParameterError
        If the period is not > 0 or a position is not finite; if there are fewer than three.
    """

    period: float = field(metadata={"unit": "s"})
    position: FloatArray = field(metadata={"unit": "rad"})
    settles_at: float = field(default=0.0, metadata={"unit": "s"})

    def __post_init__(self) -> None:
        require_positive("period", self.period)
        require_finite("position", self.position)
        if np.ndim(self.position) != 1 or len(self.position) < _LEAST_SAMPLES:
            raise InvalidParameterError("position", f"at least {_LEAST_SAMPLES} samples", np.shape(self.position))

    @property
    def velocity(self) -> FloatArray:
        """Of each interval after a sample, 0 after the last [rad/s]; shape (n,)."""
        return np.append(np.diff(self.position), 0.0) / self.period


@dataclass(frozen=True, kw_only=True)
class Reversal:
    """What one reversal of the reference does to a joint.

    Attributes
    ----------
    time : at which the reference turns [s]. direction : +1 or −1, in which it goes on.
    standing : from the arrest to the breakaway in the new direction [s]; infinite if it does not break away before the
        reference turns again, 0 if it never stops.
    lost_motion : how far the reference moves on before the joint does [rad]; infinite and 0 likewise.
    peak_error : largest following error until the reference turns again [rad], the quadrant glitch of machine tools.
    running_error : the error that is left then, the median of the last quarter [rad].
    stops : how often the joint stops again, and goes on, before the reference turns.
    settles_after : time from the reversal to the last breakaway before the next one [s]; infinite if there is none.
    """

    time: float
    direction: int
    standing: float = field(metadata={"unit": "s"})
    lost_motion: float = field(metadata={"unit": "rad"})
    peak_error: float = field(metadata={"unit": "rad"})
    running_error: float = field(metadata={"unit": "rad"})
    stops: int
    settles_after: float = field(metadata={"unit": "s"})


def sine(amplitude: float, frequency: float, joint: Joint, gains: Gains) -> ReferenceMotion:
    """A sine about zero, which begins at its lowest point.

    Parameters
    ----------
    amplitude : [rad]. frequency : [Hz]. joint, gains : of the joint that follows, for the sampling.

    Raises
    ------
    InvalidParameterError
        If amplitude or frequency are not finite and > 0, or the frequency is so low that the motion takes too many
        samples, or so high that the friction's lag does.
    """
    phase, period = _phase(amplitude, frequency, joint, gains)
    position = -amplitude * np.cos(2.0 * math.pi * phase)
    return ReferenceMotion(period=period, position=position, settles_at=(phase[-1] - 1.25) / frequency)


def triangle(amplitude: float, frequency: float, joint: Joint, gains: Gains) -> ReferenceMotion:
    """To and fro at a constant speed of 4 amplitude·frequency; parameters and errors as of :func:`sine`."""
    phase, period = _phase(amplitude, frequency, joint, gains)
    position = amplitude * (4.0 * np.abs(phase - np.floor(phase + 0.5)) - 1.0)
    return ReferenceMotion(period=period, position=position, settles_at=(phase[-1] - 1.25) / frequency)


def _phase(amplitude: float, frequency: float, joint: Joint, gains: Gains) -> tuple[FloatArray, float]:
    """Periods of the reference that have passed at each sample, and the sampling period [s]."""
    require_positive("amplitude", amplitude)
    require_positive("frequency", frequency)
    require_positive("stiffness", gains.stiffness)
    natural = _SAMPLES * _finest(joint, gains)
    # Corners fall on samples: a quarter of a period is a whole number of them.
    quarter = max(1, math.ceil(_SAMPLES / 4 * max(1.0, 1.0 / (frequency * natural))))
    periods = _PERIODS_OF_INTEGRAL if gains.integral else _PERIODS
    count = 4 * quarter * periods
    if count > _MOST_SAMPLES:
        least = 1.0 / (natural * _MOST_SAMPLES / (_SAMPLES * periods))
        raise InvalidParameterError("frequency", f">= {least:.2g} Hz, as the joint is so quick", frequency)
    period = 1.0 / (4 * quarter * frequency)
    # The simulation remembers the velocities of one lag.
    lag = float(joint.friction.lag)
    if lag > _MOST_SAMPLES * period:
        most = _MOST_SAMPLES / (4 * quarter * lag)
        raise InvalidParameterError("frequency", f"<= {most:.2g} Hz, as friction has a lag", frequency)
    return np.arange(count + 1.0) / (4 * quarter), period


def through(times: FloatArray, positions: FloatArray, joint: Joint, gains: Gains) -> ReferenceMotion:
    """Straight from one given point to the next, sampled finely enough for the joint, however far apart they are.

    Parameters
    ----------
    times : [s], each later than the one before. positions : [rad]; both of shape (n,). joint, gains : that follow.

    Raises
    ------
    InvalidParameterError
        If there are fewer than three points, times do not grow, or the motion takes too many samples.
    """
    require_positive("stiffness", gains.stiffness)
    if len(times) < _LEAST_SAMPLES or not (np.diff(times) > 0).all():
        raise InvalidParameterError("times", "three or more, each later than the one before", np.shape(times))
    period = _finest(joint, gains)
    span = float(times[-1] - times[0])
    count = math.ceil(span / period)
    if count > _MOST_SAMPLES:
        raise InvalidParameterError(
            "times", f"of {_MOST_SAMPLES * period:.3g} s at most, as the joint is so quick", span
        )
    even = np.linspace(times[0], times[-1], max(count, _LEAST_SAMPLES) + 1)
    return ReferenceMotion(period=span / (len(even) - 1), position=np.interp(even, times, positions))


def _finest(joint: Joint, gains: Gains) -> float:
    """Sampling period that shows what the joint does [s]."""
    return natural_period(joint, gains) / _SAMPLES


def turning_points(reference: FloatArray, least: float) -> list[tuple[int, int]]:
    """Where a motion turns by more than ``least`` [rad]: index of the last sample at the extreme, and the way on.

    One that rests at its extreme turns where it leaves.
    """
    steps = np.sign(np.diff(reference))
    moves = np.flatnonzero(steps)
    corners = moves[1:][np.diff(steps[moves]) != 0.0]  # each begins a way back
    found: list[tuple[int, int]] = []
    low = high = way = 0
    for at in [*corners.tolist(), len(reference) - 1]:
        low = at if reference[at] <= reference[low] else low
        high = at if reference[at] >= reference[high] else high
        if way >= 0 and reference[high] - reference[at] > least:
            found += [(high, -1)] if way else []
            way, low = -1, at
        elif way <= 0 and reference[at] - reference[low] > least:
            found += [(low, 1)] if way else []
            way, high = 1, at
    return found


def following_error(reference: FloatArray, position: FloatArray, direction: int) -> tuple[float, float]:
    """Peak and running error of the samples from one reversal to the next, in the direction of the motion [rad]."""
    errors = direction * (reference - position)
    return float(np.max(errors)), float(np.median(errors[-max(1, len(errors) // 4) :]))


def reversals(
    joint: Joint, gains: Gains, reference: ReferenceMotion, conditions: OperatingConditions | None = None
) -> tuple[Reversal, ...]:
    """Reversals of a reference, by integration of Eqs (4)-(6); parameters and errors as of :func:`followed`.

    A reference whose samples are further apart than what the joint does is sampled more finely.
    """
    reference = sampled(reference, joint, gains, conditions)
    motion = followed(joint, gains, reference, conditions)
    return _reversals(reference, motion.position, motion.slips())


def followed(
    joint: Joint, gains: Gains, reference: ReferenceMotion, conditions: OperatingConditions | None = None
) -> Trajectory:
    """The motion of a joint that follows a reference, sampled at the end of each of its periods; scalars only.

    The joint starts at rest at the reference's first sample, with full static friction.

    Parameters
    ----------
    conditions : load, sampled control and compensation; they look at the joint once a period of the reference.

    Raises
    ------
    InvalidParameterError
        If the stiffness is not > 0 or a gain is not finite.
    UnstableLoopError
        If the motion grows without end.
    """
    require_positive("stiffness", gains.stiffness)
    conditions = conditions or OperatingConditions()
    simulation = JointSimulation.under(joint, gains, conditions, position=float(reference.position[0]))
    reach = float(np.ptp(reference.position))
    return advanced(simulation, conditions, reference.period, reference.position[:-1], reference.velocity[:-1], reach)


def _reversals(reference: ReferenceMotion, position: FloatArray, slips: FloatArray) -> tuple[Reversal, ...]:
    times = reference.period * np.arange(len(reference.position))
    turns = turning_points(reference.position, TURN * float(np.ptp(reference.position)))
    begins, ends, ways = slips.T
    found = []
    for number, (index, direction) in enumerate(turns):
        following = turns[number + 1][0] if number + 1 < len(turns) else len(times) - 1
        if times[index] < reference.settles_at or following - index < _LEAST_SAMPLES:
            continue
        # Sample i of the motion is at the end of period i.
        peak, running = following_error(
            reference.position[index + 1 : following + 1], position[index:following], direction
        )
        start, end = float(times[index]), float(times[following])
        inside = np.flatnonzero((ways == direction) & (ends > start) & (begins <= end))
        standing = lost = settles = math.inf
        stops = 0
        if len(inside):
            first = inside[0]
            breakaway = float(begins[first])
            standing = breakaway - float(ends[first - 1]) if first > 0 else breakaway
            lost = direction * (float(np.interp(breakaway, times, reference.position)) - reference.position[index])
            lost = max(float(lost), 0.0) if breakaway > start else 0.0
            stops = len(inside) - 1
            settles = max(float(begins[inside[-1]]) - start, 0.0)
        found.append(
            Reversal(
                time=start, direction=direction, standing=standing, lost_motion=lost, peak_error=peak,
                running_error=running, stops=stops, settles_after=settles,
            )
        )  # fmt: skip
    return tuple(found)


def sampled(
    reference: ReferenceMotion, joint: Joint, gains: Gains, conditions: OperatingConditions | None = None
) -> ReferenceMotion:
    """The same reference, sampled as a controller of the conditions does, or as finely as the joint asks for.

    Raises
    ------
    InvalidParameterError
        If the stiffness is not > 0, or there would be too many samples.
    """
    require_positive("stiffness", gains.stiffness)
    end = reference.period * (len(reference.position) - 1)
    if conditions is not None and conditions.period > 0:
        period = conditions.period
        count = math.floor(end / period)
        name = "controller_period"
    else:
        # A whole part of the given period keeps what was given among the samples.
        parts = math.ceil(reference.period / _finest(joint, gains) - _ROUNDING)
        if parts <= 1:
            return reference
        period, count, name = reference.period / parts, parts * (len(reference.position) - 1), "reference.period"
    if count >= _MOST_SAMPLES:
        raise InvalidParameterError(name, f">= {end / _MOST_SAMPLES:.2g} s for so long a motion", period)
    times = period * np.arange(count + 1.0)
    position = np.interp(times, reference.period * np.arange(len(reference.position)), reference.position)
    return ReferenceMotion(period=period, position=position, settles_at=reference.settles_at)


def reversal_map(
    joint: Joint,
    gains: Gains,
    references: Sequence[ReferenceMotion],
    conditions: OperatingConditions | None = None,
    *,
    workers: int = 1,
) -> list[tuple[Reversal, ...]]:
    """:func:`reversals` of many references, by several threads: the integration holds no lock of Python's.

    None of those where the motion grows without end.
    """

    def of(reference: ReferenceMotion) -> tuple[Reversal, ...]:
        try:
            return reversals(joint, gains, reference, conditions)
        except UnstableLoopError:
            return ()

    with ThreadPoolExecutor(max_workers=max(1, workers)) as pool:
        return list(pool.map(of, references))
