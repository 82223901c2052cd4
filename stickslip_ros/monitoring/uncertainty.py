# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A joint as it may be, given the errors of what was learnt, and how probable stick-slip is then."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import DimensionlessGroups, damping_reserve, dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.samples import FloatArray

_DRAWS = 32  # draws of each law that are integrated, 1


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """A joint as it may be: draws from what is known of it, under one friction law and under others.

    Attributes
    ----------
    joint : of arrays, one value a draw.
    stiffness : of the controller in each draw over the nominal one; 1 where the gains are known.
    weight : of this law. others : laws that the data do not exclude; the weights add up to 1.
    error_floor : least error probability of results, for a model that does not fit.
    """

    joint: Joint
    stiffness: FloatArray
    weight: float = 1.0
    others: tuple[Uncertainty, ...] = ()
    error_floor: float = 0.0

    def under(self, conditions: OperatingConditions) -> Uncertainty:
        """The same, as the conditions leave each joint."""
        others = tuple(other.under(conditions) for other in self.others)
        return replace(self, joint=conditions.applied_to(self.joint), others=others)

    def thinned(self) -> Uncertainty:
        """As many of the draws as can be integrated in time; of this law alone."""
        count = len(self.stiffness)
        every = slice(None, None, max(1, count // _DRAWS))

        def some(value: Real) -> FloatArray:
            return np.broadcast_to(np.asarray(value, dtype=float), (count,))[every]

        return replace(self, joint=each_number(self.joint, some), stiffness=self.stiffness[every], others=())

    def bounded(self, probability: float) -> float:
        """A probability of a result, no nearer to 0 and 1 than the least error probability allows; NaN stays NaN."""
        return min(max(probability, self.error_floor), 1.0 - self.error_floor)

    def drawn(self, gains: Gains) -> Gains:
        """Nominal gains as they are in each draw of this law, without integral action."""
        return Gains(stiffness=float(gains.stiffness) * self.stiffness, damping=gains.damping)

    def damping_error(self, gains: Gains, nominal: float) -> float:
        """Root mean square of ln(total damping / ``nominal`` [N·m·s/rad]) over draws and laws."""
        ratios = np.asarray(self.joint.total_damping(self.drawn(gains))) / max(nominal, TINY)
        square = self.weight * float(np.mean(np.log(np.maximum(ratios, TINY)) ** 2))
        return math.sqrt(square + sum(other.damping_error(gains, nominal) ** 2 for other in self.others))

    def groups(self, gains: Gains, velocity: float) -> DimensionlessGroups:
        """The dimensionless groups of the draws of this law, under nominal gains at a velocity [rad/s]."""
        return dimensionless_groups(self.joint, self.drawn(gains), velocity)

    def damping_reserves(self, gains: Gains, velocity: float) -> FloatArray:
        """Relative damping reserves ρ/ρ_c − 1 by integration, of some draws of this law; NaN without an answer."""
        groups = self.thinned().groups(gains, velocity)
        return np.asarray(damping_reserve(groups.damping_ratio, exact_critical_damping_ratio(groups)))

    def simulated(self, gains: Gains, velocity: float) -> FloatArray:
        """Whether each of some draws of this law sticks, 1 or 0, by simulation; NaN without an answer.

        For a contact that yields, which the dimensionless groups do not have. A joint on it may swing between near rest
        and several times its speed without ever standing: this counts as half.
        """
        some = self.thinned()

        def sticks(number: int) -> float:
            joint = each_number(some.joint, lambda value: np.asarray(value)[number])
            drawn = replace(gains, stiffness=float(gains.stiffness) * float(some.stiffness[number]))
            found = verdict(joint, drawn, velocity, detail=Detail.OUTCOME)
            if found.smooth is None:
                return 1.0 if found.unstable or float(joint.total_damping(drawn)) < 0.0 else math.nan
            return 0.5 if found.outcome is Outcome.SWINGS else float(not found.smooth)

        return np.array([sticks(number) for number in range(len(some.stiffness))])


def each_number(joint: Joint, change: Callable[[Real], FloatArray]) -> Joint:
    """The joint with every number changed."""
    values = {name: change(value) for name, value in joint.friction.numbers.items()}
    return Joint(
        inertia=change(joint.inertia),
        friction=joint.friction.changed(values),
        transmission=joint.transmission,
        actuation_delay=change(joint.actuation_delay),
    )


def stick_slip_probability(uncertainty: Uncertainty, gains: Gains, velocity: float) -> float:
    """Probability that stick-slip goes on by the exact condition, over draws and laws; NaN where there is no answer.

    A draw of negative damping in all, which swings by itself, counts as one that is not smooth.

    Parameters
    ----------
    gains : scalars, the nominal ones; without integral action. velocity : commanded [rad/s].
    """
    if gains.integral != 0 or not gains.stiffness > 0 or velocity == 0:
        return math.nan
    total = answered = 0.0
    for law in (uncertainty, *uncertainty.others):
        persists = law.simulated(gains, velocity) if not law.joint.friction.rigid else _persists(law, gains, velocity)
        known = np.isfinite(persists)
        if known.any():
            total += law.weight * float(persists[known].mean())
            answered += law.weight
    if answered == 0.0:
        return math.nan
    return uncertainty.bounded(total / answered)


def _persists(law: Uncertainty, gains: Gains, velocity: float) -> FloatArray:
    """Whether stick-slip of each of some draws of a law goes on, 1 or 0; NaN without an answer."""
    groups = law.thinned().groups(gains, velocity)
    ratio = np.asarray(groups.damping_ratio)
    damped = replace(groups, damping_ratio=np.maximum(ratio, 0.0))
    return np.where(ratio < 0.0, 1.0, np.asarray(cycle_persists(damped, full_accuracy=False)))
