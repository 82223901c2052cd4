# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A referee for contacts that give way: a joint pulled at a constant speed, by small steps of one length.

It shares no code with ``stickslip_ros.model``: symplectic Euler steps that divide the lag, the LuGre deflection by its
exact solution over a step, lagged velocities from a ring, events at the ends of steps. A slip begins where the applied
force exceeds what the contact holds for long; with an elastic contact where the contact's own force does.
"""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import kernel
from stickslip_ros.model.friction import Friction


def sticks(friction: Friction, inertia: float, stiffness: float, ratio: float, speed: float, fineness: float) -> bool:
    """Whether a joint of the damping ratio still stops, in the last tenth of 160 natural periods.

    It begins stuck, with the spring's force just what friction holds; ``fineness`` divides the steps.
    """
    frequency = math.sqrt(stiffness / inertia)
    contact = float(friction.presliding_stiffness)
    delay = math.ceil(float(friction.lag) * math.sqrt(contact / inertia) * fineness)
    numbers = np.array(
        [
            inertia, friction.coulomb, friction.stribeck, friction.stribeck_velocity, friction.rise_time,
            2.0 * ratio * inertia * frequency, stiffness, contact, friction.presliding_damping, friction.viscous,
        ],
        dtype=float,
    )  # fmt: skip
    step = float(friction.lag) / delay
    count = round(160.0 * 2.0 * math.pi / frequency / step)
    return bool(_stops(numbers, speed, step, delay, count, friction.contact == "lugre"))


def critical_ratio(friction: Friction, inertia: float, stiffness: float, speed: float, fineness: float) -> float:
    """The damping ratio at which it ceases to stop, to 0.3 %."""
    low, high = 0.0, 2.0
    while high - low > 0.003 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sticks(friction, inertia, stiffness, middle, speed, fineness) else (low, middle)
    return 0.5 * (low + high)


@kernel()
def _stops(numbers, speed, step, delay, count, creeping):
    inertia, coulomb, stribeck, slow, rise = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    damping, stiffness, contact, soft = numbers[5], numbers[6], numbers[7], numbers[8]
    controller = damping - numbers[9]  # what of the damping is the controller's: it acts on the error
    past = np.zeros(delay)
    z = (coulomb + stribeck) * 0.999 / contact
    offset = ((coulomb + stribeck) * 0.999 - controller * speed) / stiffness
    x, v, way = 0.0, 0.0, 0.0
    level, rest_level, rested, slipped_from, slid, late = stribeck, stribeck, 0.0, 0.0, 0, 0
    kept_level, kept_rested = stribeck, 0.0
    for i in range(count):
        time = i * step
        applied = stiffness * (offset + speed * time - x) + controller * speed - damping * v
        if way == 0.0:
            dwell = time - rested
            now = rest_level + (stribeck - rest_level) * dwell / (dwell + rise) if dwell > 0.0 else rest_level
            if creeping:
                begins = v != 0.0 and (applied if v > 0.0 else -applied) > coulomb + now
            else:
                begins = contact * abs(z) > coulomb + now
            if begins:
                way = (1.0 if v > 0.0 else -1.0) if creeping else (1.0 if z > 0.0 else -1.0)
                kept_level, kept_rested = rest_level, rested
                level, slipped_from, slid = now, x, 0
            held = coulomb + now
        if way != 0.0:
            lagged = past[slid % delay] if slid >= delay else 0.0
            past[slid % delay] = v
            slid += 1
            held = coulomb + level / (1.0 + (lagged / slow) ** 2)
        if creeping:
            steady = held / contact * (1.0 if v > 0.0 else -1.0)
            share = np.exp(-contact * abs(v) * step / held)
            following = steady + (z - steady) * share
            force = contact * following + soft * (following - z) / step
            z = following
        elif way == 0.0:
            force = contact * z + soft * v
        else:
            force = way * held
        v += step * (applied - force) / inertia
        x += step * v
        if way == 0.0 and not creeping:
            z += step * v
        if way != 0.0 and v * way < 0.0:
            if not creeping:
                z, v = way * held / contact, 0.0
            if contact * abs(x - slipped_from) > level:
                rest_level, rested = held - coulomb, time + step
                if 10 * i > 9 * count:
                    late += 1
            else:
                rest_level, rested = kept_level, kept_rested
            way = 0.0
    return late > 0
