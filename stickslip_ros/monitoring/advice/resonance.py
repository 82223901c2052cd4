# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains that leave the resonance of motor and load with too little damping: what they allow at a given stiffness.

A controller that sees the motor damps the resonance, unless it is late; one that sees the load excites it. So every
mode of the linear loop is to keep half of the damping ratio that the spring has by itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from stickslip_ros.model.bisection import bisected
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Friction, Gains, Joint, Transmission
from stickslip_ros.model.loop_modes import least_modal_damping
from stickslip_ros.monitoring.samples import FloatArray

_KEPT = 0.5  # least damping ratio of a mode, of the spring's
# Stiffnesses and dampings that are tried, as natural frequencies of the rigid joint in units of the resonance, and as
# damping ratios of the rigid joint; bisections between two of the latter, to a hundredth.
_FREQUENCIES, _RATIOS, _BISECTIONS = np.geomspace(1e-3, 3.0, 160), np.geomspace(3e-3, 30.0, 40), 6


@dataclass(frozen=True, kw_only=True)
class DampingLimits:
    """Damping ratios of the rigid joint that are allowed at its natural frequencies [rad/s].

    Attributes
    ----------
    resonance : [Hz]. inertia : of both masses [kg·m²].
    frequencies, least, largest : arrays of one shape; where no ratio is allowed, the least is infinite.
    """

    resonance: float
    inertia: float
    frequencies: FloatArray
    least: FloatArray
    largest: FloatArray

    def at(self, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and largest damping k_v [N·m·s/rad] at stiffnesses [N·m/rad], by the stricter of two neighbours."""
        frequency = np.sqrt(stiffness / self.inertia)
        place = np.searchsorted(self.frequencies, frequency)
        one, other = (np.clip(place + step, 0, len(self.frequencies) - 1) for step in (-1, 0))
        unit = 2.0 * self.inertia * frequency
        least = np.maximum(self.least[one], self.least[other])
        return (
            np.where(least > 0, unit * least, -math.inf),
            unit * np.minimum(self.largest[one], self.largest[other]),
        )

    def in_words(self, gains: Gains) -> str:
        """Which damping excites the resonance at the stiffness of gains."""
        stiffness = float(gains.stiffness)
        (least,), (largest,) = self.at(np.array([stiffness]))
        parts = [f"below {least:.4g}"] if least > 0 else []
        parts += [f"above {largest:.4g}"] if largest < math.inf else []
        if least > largest:
            damping = "any damping"
        else:
            damping = f"damping {' or '.join(parts)} N·m·s/rad" if parts else "no damping"
        return f"at {self.resonance:.4g} Hz, which {damping} excites at a stiffness of {stiffness:.4g} N·m/rad"


def damping_limits(joint: Joint, conditions: OperatingConditions) -> DampingLimits | None:
    """What a resonance allows (scalars); None for a rigid joint."""
    if joint.transmission is None:
        return None
    controller = OperatingConditions(
        controller_period=conditions.controller_period, control_delay=conditions.control_delay
    )
    numbers = (float(joint.inertia), float(joint.friction.viscous), float(joint.actuation_delay))
    return _damping_limits(*numbers, joint.transmission, controller)


@lru_cache(maxsize=16)
def _damping_limits(
    inertia: float, viscous: float, delay: float, transmission: Transmission, conditions: OperatingConditions
) -> DampingLimits:
    friction = Friction(stribeck=0.0, stribeck_velocity=1.0, viscous=viscous)
    joint = Joint(inertia=inertia, friction=friction, transmission=transmission, actuation_delay=delay)
    frequencies = 2.0 * math.pi * transmission.resonance * _FREQUENCIES
    kept = _KEPT * min(transmission.spring_damping, 1.0)

    def damped(ratios: FloatArray) -> FloatArray:
        """Whether every mode is, at each frequency, with ratios of its row."""
        unit = frequencies.reshape(-1, *[1] * (ratios.ndim - 1)) * inertia
        stiffness, damping = np.broadcast_arrays(unit**2 / inertia, 2.0 * ratios * unit)
        return np.asarray(least_modal_damping(joint, Gains(stiffness=stiffness, damping=damping), conditions) >= kept)

    good = damped(np.broadcast_to(_RATIOS, (len(frequencies), len(_RATIOS))))
    # The longest run of ratios that do, at each frequency: the places before its first and after its last one.
    edges = np.diff(np.pad(good, ((0, 0), (1, 1))).astype(int), axis=1)
    least, largest = np.full(len(frequencies), math.inf), np.full(len(frequencies), -math.inf)
    ends = np.zeros((2, len(frequencies)), dtype=int)
    for row, edge in enumerate(edges):
        runs = np.column_stack([np.flatnonzero(edge > 0), np.flatnonzero(edge < 0)])
        if len(runs):
            ends[:, row] = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    some = ends[1] > ends[0]
    for found, inside, outside, beyond in (
        (least, ends[0], ends[0] - 1, 0.0),
        (largest, ends[1] - 1, ends[1], math.inf),
    ):
        last = len(_RATIOS) - 1
        good_one, bad_one = (np.log(_RATIOS[np.clip(ends, 0, last)]) for ends in (inside, outside))
        good_one, _ = bisected(lambda logarithms: damped(np.exp(logarithms)), good_one, bad_one, _BISECTIONS)
        open_end = (outside < 0) | (outside > last)
        found[some] = np.where(open_end, beyond, np.exp(good_one))[some]
    return DampingLimits(
        resonance=transmission.resonance, inertia=inertia, frequencies=frequencies, least=least, largest=largest
    )
