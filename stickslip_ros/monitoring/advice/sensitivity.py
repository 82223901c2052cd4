# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Sensitivity of the margin to each parameter of the friction: what lubricant and mechanics could do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import nearest_to_zero
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.verdict import beyond_the_paper
from stickslip_ros.monitoring.advice.limits import Criterion, criterion_for
from stickslip_ros.monitoring.samples import FloatArray

PARAMETERS = ("stribeck", "stribeck_velocity", "lag", "rise_time", "viscous")
# Difference of the logarithm of a parameter, for the elasticity: the exact ratio is computed to 1e-3 only.
_STEP = {Criterion.PAPER: 1e-3, Criterion.EXACT: 0.05}
_LARGEST_FACTOR, _POINTS = 30.0, 41  # on a parameter, up and down; points between, by the logarithm
_BISECTIONS = 10  # of the logarithm between two points: to 2e-4


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """Sensitivity of the margin to one parameter of the friction, with the present gains.

    Attributes
    ----------
    parameter : its name in :class:`~stickslip_ros.model.friction.Friction`.
    elasticity : d ln(ρ/ρ_c) / d ln(parameter): by how many per cent ρ/ρ_c grows with one per cent more of it; NaN
        where no damping is needed at all.
    factor : the nearest factor on it that alone reaches the wanted margin, 1 if it is reached; NaN if none between
        1/30 and 30 does.
    """

    parameter: str
    elasticity: float
    factor: float


def sensitivities(
    joint: Joint,
    gains: Gains,
    velocity: float,
    conditions: OperatingConditions | None = None,
    *,
    wanted_margin: float = 0.2,
    condition: Criterion = Criterion.PAPER,
) -> tuple[Sensitivity, ...]:
    """Sensitivities of ρ/ρ_c to the friction's parameters, by Eq. (43) or exactly; the paper's conclusion in numbers.

    Coulomb friction is not among them: it cancels. All NaN where Eq. (43) does not apply; exactly for a joint of
    another friction law than the paper's. None at all beyond the paper's case (integral action, sampled control, a
    contact that yields, two masses): what changes the margin of a rigid joint under PD control may not change theirs.

    Parameters
    ----------
    joint, gains : scalars. velocity : [rad/s].
    """
    if beyond_the_paper(joint, gains, conditions or OperatingConditions()):
        return ()
    found = []
    condition = criterion_for(joint, condition)
    grid = np.linspace(-math.log(_LARGEST_FACTOR), math.log(_LARGEST_FACTOR), _POINTS)
    step = _STEP[condition]
    for parameter in PARAMETERS:

        def changed(logarithms: FloatArray, name: str = parameter) -> DimensionlessGroups:
            return _groups(joint, name, np.exp(logarithms), gains, velocity)

        def reached(logarithms: FloatArray) -> NDArray[np.bool_]:
            return _reached(changed(logarithms), 1.0 + wanted_margin, condition)

        below, above = _damping_over_critical(changed(np.array([-step, step])), condition)
        slope = math.log(above / below) / (2.0 * step) if 0 < below < math.inf and 0 < above < math.inf else math.nan
        found.append(
            Sensitivity(
                parameter=parameter,
                elasticity=slope,
                factor=_nearest_factor(reached, grid),
            )
        )
    return tuple(found)


def in_words(found: tuple[Sensitivity, ...]) -> str:
    """What would reach the wanted margin without a change of gains, for a person; "" if nothing is needed or helps."""
    words = [
        f"{one.parameter.replace('_', ' ')} × {one.factor:.2g}"
        for one in sorted(found, key=lambda one: abs(math.log(one.factor)) if one.factor > 0 else math.inf)
        if math.isfinite(one.factor) and one.factor != 1.0
    ]
    one = "one friction parameter changed"
    return f"Without new gains the joint would also be smooth if {one}: {', or '.join(words)}" if words else ""


def _groups(joint: Joint, parameter: str, factors: FloatArray, gains: Gains, velocity: float) -> DimensionlessGroups:
    values = {name: np.full(factors.shape, value) for name, value in joint.friction.numbers.items()}
    values[parameter] = values[parameter] * factors
    changed = replace(joint, friction=joint.friction.changed(values))
    return dimensionless_groups(changed, gains, velocity)


def _damping_over_critical(groups: DimensionlessGroups, condition: Criterion) -> FloatArray:
    """ρ/ρ_c, infinite where none is needed and NaN where there is no answer."""
    with np.errstate(all="ignore"):
        if condition is Criterion.EXACT:
            return np.asarray(groups.damping_ratio / np.asarray(exact_critical_damping_ratio(groups)))
        ratio = np.asarray(groups.damping_ratio) / np.asarray(critical_damping_ratio(groups))
        return np.where(np.asarray(groups.lag) <= 2.0 * math.pi, ratio, math.nan)


def _reached(groups: DimensionlessGroups, wanted: float, condition: Criterion) -> NDArray[np.bool_]:
    if condition is Criterion.EXACT:
        # With less damping by the wanted margin the cycle must die; that is sooner known than the critical ratio.
        ratio = np.asarray(groups.damping_ratio)
        persists = cycle_persists(replace(groups, damping_ratio=np.maximum(ratio, 0.0) / wanted))
        # Where the controller takes more damping away than the joint has, nothing is smooth.
        return np.equal(persists, 0.0) & (ratio >= 0.0)
    return np.asarray(_damping_over_critical(groups, condition) >= wanted)


def _nearest_factor(reached: Callable[[FloatArray], NDArray[np.bool_]], grid: FloatArray) -> float:
    if reached(np.zeros(1))[0]:
        return 1.0
    nearest = nearest_to_zero(reached, grid, _BISECTIONS)
    return math.nan if nearest is None else math.exp(nearest)
