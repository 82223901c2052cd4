# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Verdicts, reversals, hunting and compensation of `python -m tools.answers`, each by its index."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
import random_joints
import random_points

from stickslip_ros.model.compensation_effect import compensation_effect, largest_harmless_share
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import damping_for_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.hunting import hunting, largest_non_hunting_integral, least_quiet_stiffness
from stickslip_ros.model.long_motion import natural_period
from stickslip_ros.model.margin import lowest_smooth_velocity, stability_margin
from stickslip_ros.model.reversal import reversals, sine, triangle
from stickslip_ros.model.verdict import verdict as verdict_on
from stickslip_ros.monitoring.advice.compensations import compensations
from stickslip_ros.settings.known_joints import load_joint

Answer = dict[str, Any]

SEED = 37  # of every random generator: the number of the issue
OF_A_KIND = 20  # verdicts of each kind: ten kinds make two hundred
KNOWN = load_joint("puma560_joint1")
CONTACTS = ("elasto_plastic", "lugre", "rigid")
HUNTS = Gains(stiffness=630.0, integral=1000.0)


def plain(value: Any) -> Any:
    """Dataclasses, enumerations, arrays and numpy's numbers as JSON has them; NaN and infinity stay."""
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, tuple | list):
        return [plain(one) for one in value]
    return {name: plain(one) for name, one in value.items()} if isinstance(value, dict) else value


def with_contact(joint: Joint, stiffness: float, contact: str) -> Joint:
    """The joint on a contact of this stiffness [N·m/rad], with half of its critical damping."""
    damping = 0.5 * math.sqrt(stiffness * float(joint.inertia))
    friction = replace(joint.friction, presliding_stiffness=stiffness, presliding_damping=damping, contact=contact)
    return replace(joint, friction=friction)


VERDICTS = (
    *("paper",) * 4, "other law", "delayed", "elasto_plastic", "lugre", "integral", "sampled",
)  # fmt: skip


def verdict(index: int) -> Answer:
    """Margin of Eq. (43) and exact verdict on a random joint, rigid or not, under one kind of control."""
    kind, rng = VERDICTS[index // OF_A_KIND % len(VERDICTS)], np.random.default_rng((SEED, index))
    if kind == "paper":
        ratio = 10.0 ** rng.uniform(-2.0, 0.2)
        joint, gains, velocity = _random_points(len(VERDICTS) * OF_A_KIND).joint(index, ratio)
    else:
        joint, frequency = random_joints.random_joint(rng)
        velocity = float(joint.friction.stribeck_velocity) * 10.0 ** rng.uniform(-0.7, 0.7)
        gains = Gains(stiffness=float(joint.inertia) * frequency**2)
        gains = replace(gains, damping=float(damping_for_ratio(joint, gains.stiffness, rng.uniform(0.05, 0.6))))
    stiffness, conditions = float(gains.stiffness), OperatingConditions()
    if kind == "other law":
        joint = replace(joint, friction=replace(joint.friction, law="exponential"))
    elif kind == "delayed":
        joint = replace(joint, actuation_delay=rng.uniform(0.0, 0.8) * float(joint.total_damping(gains)) / stiffness)
    elif kind in ("elasto_plastic", "lugre"):
        joint = with_contact(joint, stiffness * 10.0 ** rng.uniform(1.3, 3.0), kind)
    elif kind == "integral":
        gains = replace(
            gains, integral=rng.uniform(0.02, 0.3) * stiffness * 2.0 * math.pi / natural_period(joint, gains)
        )
    elif kind == "sampled":
        period = natural_period(joint, gains) / rng.uniform(20.0, 200.0)
        conditions = OperatingConditions(controller_period=period, control_delay=index % 2 == 0)
    return {
        "case": kind,
        "margin": plain(stability_margin(joint, gains, velocity)),
        "lowest_smooth_velocity": plain(lowest_smooth_velocity(joint, gains)),
        "exact": plain(verdict_on(joint, gains, float(velocity), conditions)),
    }


@cache
def _random_points(count: int) -> random_points.RandomJoints:
    return random_points.random_joints(count, SEED)


def reversal(index: int) -> Answer:
    """Reversals of a sine or a triangle, followed by a random joint whose contact is rigid or elastic."""
    rng = np.random.default_rng((SEED, index))
    joint, frequency = random_joints.random_joint(rng)
    momentum = float(joint.inertia) * frequency
    gains = Gains(stiffness=momentum * frequency, damping=rng.uniform(0.5, 1.5) * momentum)
    contact = CONTACTS[index % 3]
    if contact != "rigid":
        joint = with_contact(joint, 30.0 * float(gains.stiffness), contact)
    stretch = float(joint.friction.coulomb) / float(gains.stiffness)
    conditions = OperatingConditions(load=0.5 * float(joint.friction.coulomb)) if index % 4 == 3 else None
    reference = (sine, triangle)[index % 2](stretch * rng.uniform(3.0, 30.0), rng.uniform(0.05, 0.5), joint, gains)
    return {"case": contact, "reversals": plain(reversals(joint, gains, reference, conditions))}


def hunting_case(index: int) -> Answer:
    """Hunting about a reference that stands still: the known joint first, then random ones."""
    joint, rng = KNOWN.joint, np.random.default_rng((SEED, index))
    gains, conditions = HUNTS, None
    if index < 6:
        gains = replace(HUNTS, integral=(30.0, 100.0, 300.0, 450.0, 1000.0, 3000.0)[index])
    elif index < 10:
        joint = with_contact(joint, (1e4, 1e5)[index // 8], CONTACTS[index % 2])
    elif index == 10:
        conditions, gains = (
            OperatingConditions(controller_period=0.01, control_delay=True),
            replace(HUNTS, damping=20.0),
        )
    else:
        joint, frequency = random_joints.random_joint(rng)
        stiffness = float(joint.inertia) * frequency**2
        gains = Gains(stiffness=stiffness, integral=rng.uniform(0.05, 0.5) * stiffness * frequency)
    contact = "rigid" if joint.friction.rigid else joint.friction.contact
    found = {
        "case": f"{contact}, k_p {float(gains.stiffness):.4g}, k_i {float(gains.integral):.4g}",
        "hunting": plain(hunting(joint, gains, conditions)),
    }
    if index in (2, 4):
        found["largest_quiet_integral"] = largest_non_hunting_integral(joint, gains)
        found["least_quiet_stiffness"] = least_quiet_stiffness(joint, gains)
    return found


def compensation(index: int) -> Answer:
    """What a share of each kind of compensation does to the known joint, calm or sticking, and how much is harmless."""
    gains = (Gains(stiffness=2016.0), Gains(stiffness=2016.0, damping=150.0))[index // 4 % 2]
    kinds = compensations(KNOWN.joint, gains, OperatingConditions(), resolution=KNOWN.encoder_resolution)
    name, share = list(kinds)[index % 4], (0.5, 1.2)[index // 8 % 2]
    conditions = OperatingConditions(compensation=kinds[name](share))
    found = {"case": f"{name} {share:g}", "effect": plain(compensation_effect(KNOWN.joint, gains, 0.005, conditions))}
    if index < 4:
        harmless = largest_harmless_share(KNOWN.joint, gains, 0.005, OperatingConditions(), kinds[name])
        found["largest_harmless_share"] = harmless
    return found
