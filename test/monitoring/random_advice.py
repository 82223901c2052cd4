# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Questions for advice drawn at random, and their answers by brute force, for the tests and the benchmark."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from random_joints import random_joint

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.outcome import outcomes
from stickslip_ros.model.steady_sliding import sliding_damping_ratio
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Criterion
from stickslip_ros.monitoring.advice.recommendation import Variant

_NO_DAMPING = 0.01  # damping ratio that counts as none, as the advice has it
_CANDIDATES = 40
_AROUND = np.array([0.97, 1.0, 1.1, 1.25])  # times the total damping: advice is steady with a little less and with more


@dataclass(frozen=True)
class AdviceCase:
    """A joint that sticks at this speed with these gains, and what advice must keep within."""

    joint: Joint
    gains: Gains
    velocity: float
    limits: AdviceLimits


def random_case(rng: np.random.Generator, condition: Criterion) -> AdviceCase:
    """A case; others are drawn until the joint sticks."""
    while True:
        joint, frequency = random_joint(rng)
        inertia = float(joint.inertia)
        velocity = float(joint.friction.stribeck_velocity) * 10.0 ** float(rng.uniform(-0.5, 0.5))
        ratio = float(rng.choice([0.0, rng.uniform(0.0, 0.3)]))
        gains = Gains(stiffness=inertia * frequency**2, damping=2.0 * ratio * inertia * frequency)
        if verdict(joint, gains, velocity, detail=Detail.SMOOTH).smooth:
            continue
        stiffness = float(gains.stiffness)
        limits = AdviceLimits(
            condition=condition,
            steady_sliding=condition is Criterion.EXACT,
            wanted_margin=float(rng.choice([0.0, 0.2, 0.5])),
            stiffness_range=(stiffness / rng.uniform(1.0, 20.0), stiffness * rng.uniform(1.0, 20.0)),
            damping_ratio_range=(0.0, float(rng.uniform(0.3, 3.0))),
            bandwidth=frequency * float(rng.uniform(2.0, 10.0)),
        )
        return AdviceCase(joint, gains, velocity, limits)


def clearly_less(best: Variant, case: AdviceCase) -> float:
    """A change that is clearly less than that of advice: by 2 %, or 0.1 where the advice changes one gain alone."""
    alone = best.stiffness == case.gains.stiffness or best.damping == case.gains.damping
    return min(0.98 * best.change, best.change - 0.1 * alone)


def brute_force(case: AdviceCase, within: float = 9.0, points: int = 60) -> float:
    """Least change, below ``within``, at which any point of a grid is feasible; infinite if none is.

    The grid is even in the logarithms of the stiffness and of the total damping.
    """
    joint, gains, limits = case.joint, case.gains, case.limits
    inertia, viscous, stiffness = float(joint.inertia), float(joint.friction.viscous), float(gains.stiffness)
    before = max(float(gains.damping) + viscous, 2.0 * _NO_DAMPING * math.sqrt(stiffness * inertia))
    low, high = (math.log(edge / stiffness) for edge in limits.stiffness_range)
    softer = np.linspace(max(low, -within / 3.0), min(high, within / 3.0), points)
    damped = np.concatenate([[0.0], np.linspace(-within, within, points)])
    stiffnesses, totals = np.meshgrid(stiffness * np.exp(softer), before * np.exp(damped), indexing="ij")
    groups = dimensionless_groups(joint, Gains(stiffness=stiffnesses[:, 0]), case.velocity)
    if limits.condition is Criterion.PAPER:
        critical = np.where(np.asarray(groups.lag) <= 2 * np.pi, critical_damping_ratio(groups), np.inf)
    else:
        critical = np.nan_to_num(np.asarray(exact_critical_damping_ratio(groups)), nan=np.inf)
    ratio = totals / (2.0 * np.sqrt(stiffnesses * inertia))
    damping = totals - viscous
    squared = (inertia * limits.bandwidth) ** 2 + viscous**2 - (stiffnesses / limits.bandwidth) ** 2
    wanted = 1.0 + limits.wanted_margin
    feasible = (damping >= 0) & (ratio >= wanted * critical[:, None]) & (ratio <= limits.damping_ratio_range[1])
    if limits.steady_sliding:
        # Disturbances of steady sliding decay, with 5 % to spare.
        feasible &= ratio >= 1.05 * np.asarray(sliding_damping_ratio(groups))[:, None]
    # The stiffness counts three times, in the logarithm.
    changes = np.hypot(*np.meshgrid(3.0 * softer, damped, indexing="ij"))
    feasible &= (damping**2 <= squared) & (changes < within)
    order = sorted(np.argwhere(feasible).tolist(), key=lambda index: changes[tuple(index)])
    for row, column in order[:_CANDIDATES]:
        # With a margin, the cycle dies with less damping too; a critical ratio is only known to a thousandth.
        less = wanted if limits.condition is Criterion.EXACT else 1.0
        stiffness, total = stiffnesses[row, column], totals[row, column]
        trial = Gains(stiffness=stiffness, damping=total / less - viscous)
        around = Gains(stiffness=stiffness, damping=total * _AROUND - viscous)
        steady = not limits.steady_sliding or outcomes(dimensionless_groups(joint, around, case.velocity)).steady.all()
        if steady and cycle_persists(dimensionless_groups(joint, trial, case.velocity)) == 0.0:
            return float(changes[row, column])
    return math.inf
