# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Reversals: one, and a map of 400, against scipy's Radau on the same LuGre joint."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.timing import best, once
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.reversal import reversal_map, reversals, sine
from stickslip_ros.settings.known_joints import load_joint

_WORKERS = 2
_GAINS = Gains(stiffness=6300.0, damping=200.0)
_AMPLITUDE, _FREQUENCY = 0.1, 0.2


def run() -> None:
    """All of it."""
    rigid = load_joint("puma560_joint1").joint
    friction = replace(rigid.friction, presliding_stiffness=2e4, presliding_damping=300.0, lag=0.0, rise_time=0.0)
    soft = replace(rigid, friction=replace(friction, contact="elasto_plastic"))
    lugre = replace(rigid, friction=replace(friction, contact="lugre"))
    reference = sine(_AMPLITUDE, _FREQUENCY, rigid, _GAINS)
    turns = 2 * 2 - 1  # in two periods
    times = {name: best(lambda joint=joint: reversals(joint, _GAINS, reference)) / turns  # type: ignore[misc]
             for name, joint in (("rigid", rigid), ("elastic", soft), ("LuGre", lugre))}  # fmt: skip
    theirs = once(lambda: _by_radau(lugre)) / turns
    said = ", ".join(f"{name} {1e3 * seconds:.1f} ms" for name, seconds in times.items())
    print(f"a reversal                        {said}; LuGre {theirs / times['LuGre']:.0f} x solve_ivp (Radau, 1e-6)")
    references = [
        sine(amplitude, frequency, rigid, _GAINS)
        for amplitude in np.geomspace(0.01, 0.5, 20)
        for frequency in np.geomspace(0.02, 0.5, 20)
    ]
    seconds = once(lambda: reversal_map(rigid, _GAINS, references, workers=_WORKERS))
    print(f"a map of 400 reversals            {seconds:8.2f} s by {_WORKERS} threads")


def _by_radau(joint: Joint) -> NDArray[np.float64]:
    friction, inertia = joint.friction, float(joint.inertia)
    s0, s1 = float(friction.presliding_stiffness), float(friction.presliding_damping)
    kinetic, excess, viscous = float(friction.coulomb), float(friction.stribeck), float(friction.viscous)
    scale, rate = float(friction.stribeck_velocity), 2.0 * math.pi * _FREQUENCY
    spring, damper = float(_GAINS.stiffness), float(_GAINS.damping)

    def right(time: float, y: NDArray[np.float64]) -> list[float]:
        x, v, z = y
        yields = kinetic + excess / (1.0 + (v / scale) ** 2)
        deflecting = v - s0 * abs(v) * z / yields
        target, speed = -_AMPLITUDE * math.cos(rate * time), _AMPLITUDE * rate * math.sin(rate * time)
        force = spring * (target - x) + damper * (speed - v)
        return [v, (force - s0 * z - s1 * deflecting - viscous * v) / inertia, deflecting]

    found = solve_ivp(right, (0.0, 2.0 / _FREQUENCY), [-_AMPLITUDE, 0.0, 0.0], method="Radau", rtol=1e-6, atol=1e-9)
    return np.asarray(found.y)
