# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled simulation of measured slips of a joint on a contact that yields as LuGre's; :mod:`.bristles` is its face.

    M x¨ = u(t) − σ₀ z − σ₁ z˙ − F_v x˙,    z˙ = x˙ − σ₀ |x˙| z / S,    S = F_k + F_s Ψ(x˙)

after Canudas de Wit, Olsson, Åström and Lischinsky, IEEE TAC 40(3), 1995: no lag, no rise of static friction, so that a
joint at rest has no memory of the slip before. A slip begins with the creep at rest: the forces balance, and the speed
is that at which the contact yields as the force rises. Fixed steps of the classical Runge-Kutta method.
"""

from __future__ import annotations

import math

from stickslip_ros.compilation import helper
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.model import _friction_law

# Order of the parameters, that of the table in `model.friction`; then a load.
PARAMETERS = (
    "inertia", "coulomb", "viscous", "stribeck", "stribeck_velocity", "presliding_stiffness", "presliding_damping",
)  # fmt: skip
INERTIA, COULOMB, VISCOUS, STRIBECK, STRIBECK_VELOCITY, STIFFNESS, BRISTLE_DAMPING, LOAD = range(8)

# Force of the creep at which a simulation begins, of the most that the contact holds, 1: nearer to it a small error of
# the force is a large one of the speed.
_BEGINS = 0.8
_LEAST_LEFT = 0.05  # what the contact could hold beyond the force, of the most, 1: at least, for the speed of the creep

_stribeck_friction = helper()(_friction_law.stribeck_friction)


@helper()
def _rates(law, plant, stiffness, damping, drive, x, v, z):
    """Acceleration, and rate of the deflection."""
    yields = plant[COULOMB] + _stribeck_friction(law, plant[STRIBECK], v / plant[STRIBECK_VELOCITY])
    deflecting = v - plant[STIFFNESS] * abs(v) * z / yields
    friction = plant[STIFFNESS] * z + plant[BRISTLE_DAMPING] * deflecting + (plant[VISCOUS] + damping) * v
    return (drive - plant[LOAD] - stiffness * x - friction) / plant[INERTIA], deflecting


@helper()
def _advanced(law, plant, stiffness, damping, drive, rise, time, longest, x, v, z):
    """Position, velocity and deflection after a time in which the drive rises steadily, and the number of steps."""
    count = max(1, math.ceil(time / longest))
    h = time / count
    for k in range(count):
        now = drive + rise * h * k
        middle, end = now + 0.5 * h * rise, now + h * rise
        a1, z1 = _rates(law, plant, stiffness, damping, now, x, v, z)
        v2 = v + 0.5 * h * a1
        a2, z2 = _rates(law, plant, stiffness, damping, middle, x + 0.5 * h * v, v2, z + 0.5 * h * z1)
        v3 = v + 0.5 * h * a2
        a3, z3 = _rates(law, plant, stiffness, damping, middle, x + 0.5 * h * v2, v3, z + 0.5 * h * z2)
        v4 = v + h * a3
        a4, z4 = _rates(law, plant, stiffness, damping, end, x + h * v3, v4, z + h * z3)
        x += h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
        v += h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        z += h * (z1 + 2.0 * z2 + 2.0 * z3 + z4) / 6.0
    return x, v, z, count


@compiled(nogil=True)
def simulate_bristles(
    parameters, law, directions, rests, gains, leads, firsts, edges, times, drives, longest, positions, velocities,
):  # fmt: skip
    """Simulate slip n over the nodes ``firsts[n]`` to ``edges[n + 1]``, by a Stribeck curve of ``_friction_law``.

    ``parameters`` and ``rests``, where each slip's simulation begins, have as many rows as there are variants. It
    begins up to ``leads[n]`` before the first node, where the force is ``_BEGINS`` of the most; ``drives`` are what the
    force on a joint at zero would be, without its velocity's part. ``longest`` : step. Fills the nodes from the first.

    Returns the number of steps.
    """
    total = 0
    for variant in range(parameters.shape[0]):
        plant = parameters[variant]
        most = plant[COULOMB] + plant[STRIBECK]
        for n in range(directions.shape[0]):
            first, last, direction = firsts[n], edges[n + 1] - 1, directions[n]
            stiffness, damping = gains[n, 0], gains[n, 1]
            x = rests[variant, n]
            rise = (drives[last] - drives[first]) / (times[last] - times[first])
            force = drives[first] - plant[LOAD] - stiffness * x
            lead = 0.0
            if direction * rise > 0.0:
                lead = min(max((direction * force - _BEGINS * most) / (direction * rise), 0.0), leads[n])
            force -= rise * lead
            left = max(1.0 - direction * force / most, _LEAST_LEFT)
            v = rise / (stiffness + plant[STIFFNESS] * left)
            z = (force - (damping + plant[VISCOUS] + plant[BRISTLE_DAMPING] * left) * v) / plant[STIFFNESS]
            if lead > 0.0:
                x, v, z, taken = _advanced(
                    law, plant, stiffness, damping, drives[first] - rise * lead, rise, lead, longest, x, v, z
                )
                total += taken
            positions[variant, first], velocities[variant, first] = x, v
            for i in range(first, last):
                time = times[i + 1] - times[i]
                x, v, z, taken = _advanced(
                    law, plant, stiffness, damping, drives[i], (drives[i + 1] - drives[i]) / time, time, longest,
                    x, v, z,
                )  # fmt: skip
                total += taken
                positions[variant, i + 1], velocities[variant, i + 1] = x, v
    return total
