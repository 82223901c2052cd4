# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Motor and load on a spring, as a harmonic drive or a belt makes them, integrated apart from the package's kernels."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stickslip_ros.model.friction import Friction, Gains
from stickslip_ros.monitoring.samples import FloatArray


def motor_positions(
    friction: Friction, gains: Gains, velocity: float, *, masses: tuple[float, float], resonance: float,
    duration: float, rate: float = 200.0,
) -> FloatArray:  # fmt: skip
    """Position of the motor [rad] under friction of the paper's law, at samples; the load swings at ``resonance`` [Hz].

    The controller has the motor's encoder, a reference at constant velocity [rad/s], and holds the load level with it.
    """
    motor, load = masses
    stiffness = (2.0 * math.pi * resonance) ** 2 * motor * load / (motor + load)
    period = min(1e-4, float(friction.lag) / 40.0)
    steps = round(1.0 / rate / period)
    loop = np.array([float(gains.stiffness), float(gains.damping), velocity])
    names = ("coulomb", "viscous", "stribeck", "stribeck_velocity", "lag", "rise_time")
    values = np.array([float(getattr(friction, name)) for name in names])
    damping = 0.06 * math.sqrt(stiffness * motor * load / (motor + load))
    return _integrated(loop, values, np.array([motor, load, stiffness, damping]), 1.0 / rate / steps, steps,
                       np.empty(round(duration * rate)))  # fmt: skip


@njit(cache=True)
def _integrated(loop, friction, masses, step, steps, positions):  # type: ignore[no-untyped-def]
    coulomb, viscous, stribeck, stribeck_velocity, lag, rise_time = friction
    motor, load, stiffness, damping = masses
    past = np.zeros(int(lag / step) + 1)
    position = speed = load_position = load_speed = rested = 0.0
    level = left = stribeck
    stuck, latest = True, 0
    for n in range(positions.shape[0] * steps):
        time = n * step
        torque = stiffness * (position - load_position) + damping * (speed - load_speed)
        drive = loop[0] * (loop[2] * time - position) + loop[1] * (loop[2] - speed) - torque
        next_load_speed = load_speed + torque / load * step
        before = past[latest]
        next_speed = 0.0
        if stuck:
            rested += step
            level = stribeck - (stribeck - left) * rise_time / (rise_time + rested)
            if abs(drive) > coulomb + level:
                stuck = False
                past[:] = 0.0
                next_speed = math.copysign((abs(drive) - coulomb - level) / motor * step, drive)
        else:
            held = coulomb + level / (1.0 + (before / stribeck_velocity) ** 2)
            next_speed = speed + (drive - math.copysign(held, speed) - viscous * speed) / motor * step
            if next_speed * speed <= 0.0:
                next_speed, stuck, rested = 0.0, True, 0.0
                left = level / (1.0 + (before / stribeck_velocity) ** 2)
        position += 0.5 * (speed + next_speed) * step
        load_position += 0.5 * (load_speed + next_load_speed) * step
        speed, load_speed = next_speed, next_load_speed
        past[latest] = abs(speed)
        latest = (latest + 1) % past.shape[0]
        if n % steps == 0:
            positions[n // steps] = position
    return positions
