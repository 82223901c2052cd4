# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A referee for hunting: a joint under PID control whose reference stands still, by small steps of one length.

It shares no code with ``stickslip_ros.model``: Heun steps that divide the lag, arrests and breakaways at the ends of
steps, lagged velocities from a ring. Nothing is decided early; a joint hunts if it still goes to and fro at the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.compilation import helper, kernel
from stickslip_ros.model.friction import Gains, Joint


@dataclass(frozen=True, kw_only=True)
class Late:
    """The last quarter of the motion: how often the slips changed direction, half of the travel [rad]."""

    turns: int
    amplitude: float

    @property
    def hunts(self) -> bool:
        """To and fro at least twice."""
        return self.turns >= 4


def late_motion(joint: Joint, gains: Gains, start: float, seconds: float, steps_a_radian: float = 300.0) -> Late:
    """The last quarter of so many seconds, from rest at ``start`` stretches of the spring that static friction holds.

    The contact is rigid or elastic; the law is the paper's.
    """
    friction = joint.friction
    elastic = 0.0 if friction.rigid else float(friction.presliding_stiffness)
    fastest = math.sqrt((float(gains.stiffness) + elastic) / float(joint.inertia))
    step = 1.0 / (max(fastest / 10.0, math.sqrt(float(gains.stiffness) / float(joint.inertia))) * steps_a_radian)
    lag = float(friction.lag)
    delay = math.ceil(lag / step) if lag > 0 else 0
    step = lag / delay if delay else step
    numbers = np.array(
        [
            joint.inertia, friction.coulomb, friction.stribeck, friction.stribeck_velocity, friction.rise_time,
            float(friction.viscous) + float(gains.damping), gains.stiffness, gains.integral, elastic,
            friction.presliding_damping,
        ],
        dtype=float,
    )  # fmt: skip
    offset = start * float(friction.coulomb + friction.stribeck) / float(gains.stiffness)
    turns, low, high = _move(numbers, offset, step, delay, round(seconds / step))
    return Late(turns=int(turns), amplitude=0.5 * (high - low))


@helper()
def _pull(x, v, integral, offset, numbers):
    """Force of the controller and of viscous friction."""
    return numbers[6] * (offset - x) + numbers[7] * integral - numbers[5] * v


@kernel()
def _move(numbers, offset, step, delay, count):
    inertia, coulomb, stribeck, slow, rise, elastic, soft = (
        numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[8], numbers[9],
    )  # fmt: skip
    past = np.zeros(delay + 1)
    x, v, integral, way, level = 0.0, 0.0, 0.0, 0.0, stribeck
    deflection = min(max(numbers[6] * offset, -coulomb - stribeck), coulomb + stribeck) / elastic if elastic else 0.0
    rested, rest_level, slipped_from, slid = 0.0, stribeck, 0.0, 0
    turns, last_way, low, high = 0, 0.0, np.inf, -np.inf
    for i in range(count):
        time = i * step
        if 4 * i > 3 * count:
            low, high = min(low, x), max(high, x)
        if way == 0.0:
            dwell = time - rested
            now = rest_level + (stribeck - rest_level) * dwell / (dwell + rise) if dwell > 0.0 else rest_level
            if elastic:
                force = _pull(x, v, integral, offset, numbers) - elastic * deflection - soft * v
                middle = v + 0.5 * step * force / inertia
                z, y = deflection + 0.5 * step * v, x + 0.5 * step * v
                force = _pull(y, middle, integral + 0.5 * step * (offset - x), offset, numbers)
                v += step * (force - elastic * z - soft * middle) / inertia
                integral += step * (offset - y)
                x += step * middle
                deflection += step * middle
                held = elastic * deflection
            else:
                integral += step * (offset - x)
                held = _pull(x, 0.0, integral, offset, numbers)
            if abs(held) > coulomb + now:
                way = 1.0 if held > 0.0 else -1.0
                level, slipped_from, slid = now, x, 0
                past[:] = 0.0
            continue
        lagged = past[(slid + 1) % (delay + 1)] if delay else v
        lagged_after = past[(slid + 2) % (delay + 1)] if delay > 1 else lagged
        past[slid % (delay + 1)] = v
        if slid < delay:
            lagged, lagged_after = 0.0, 0.0
        first = (
            _pull(x, v, integral, offset, numbers) - way * (coulomb + level / (1 + (lagged / slow) ** 2))
        ) / inertia
        x2, v2 = x + step * v, v + step * first
        if not delay:
            lagged_after = v2
        second = _pull(x2, v2, integral + step * (offset - x), offset, numbers)
        second = (second - way * (coulomb + level / (1 + (lagged_after / slow) ** 2))) / inertia
        integral += step * (offset - 0.5 * (x + x2))
        x += 0.5 * step * (v + v2)
        v += 0.5 * step * (first + second)
        slid += 1
        if v * way < 0.0 or (slid > 1 and v == 0.0):
            v = 0.0
            held = level / (1 + (lagged_after / slow) ** 2)
            deflection = way * (coulomb + held) / elastic if elastic else 0.0
            if elastic == 0.0 or elastic * abs(x - slipped_from) > level:
                rested, rest_level = time + step, held
                if 4 * i > 3 * count and way != last_way:
                    turns += 1
                last_way = way
            way = 0.0
    return turns, low, high
