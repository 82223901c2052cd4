# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains that would make the motion smooth by Eq. (43), with the least change."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_not_negative
from stickslip_ros.model.dimensionless import damping_for_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, stability_margin

_SCAN_POINTS = 600
_REFINEMENTS = 40


@dataclass(frozen=True, kw_only=True)
class AdviceLimits:
    """What the advice must reach and keep within.

    Attributes
    ----------
    wanted_margin : by how much the damping ratio shall exceed the critical one, e.g. 0.2 for 20 %.
    stiffness_range, damping_range : least and largest gain [N·m/rad], [N·m·s/rad].

    Raises
    ------
    InvalidParameterError
        If the margin is negative or a range is not 0 <= least <= largest.
    """

    wanted_margin: float = 0.2
    stiffness_range: tuple[float, float] = field(default=(0.0, math.inf), metadata={"unit": "N·m/rad"})
    damping_range: tuple[float, float] = field(default=(0.0, math.inf), metadata={"unit": "N·m·s/rad"})

    def __post_init__(self) -> None:
        require_not_negative("wanted_margin", self.wanted_margin)
        for name in ("stiffness_range", "damping_range"):
            least, largest = getattr(self, name)
            if not 0 <= least <= largest:
                raise InvalidParameterError(name, "(least, largest) with 0 <= least <= largest", (least, largest))


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """Gains to use, or why there are none.

    Attributes
    ----------
    stiffness : k_p [N·m/rad], damping : k_v [N·m·s/rad]; NaN if nothing within the limits helps.
    energy_margin : of Eq. (43) with these gains [M x˙_s²].
    reason : one sentence for a person.
    """

    stiffness: float
    damping: float
    energy_margin: float
    reason: str

    @property
    def found(self) -> bool:
        """Whether there are gains to recommend."""
        return math.isfinite(self.stiffness)


def recommend(joint: Joint, gains: Gains, velocity: float, limits: AdviceLimits | None = None) -> Recommendation:
    """The smaller of two changes that reaches the wanted margin: damping alone or stiffness alone.

    Changes are compared by the logarithm of the factor on k_p and on k_v + F_v.

    Parameters
    ----------
    joint, gains : scalars. velocity : commanded speed [rad/s].
    limits : defaults to AdviceLimits().
    """
    limits = limits or AdviceLimits()
    margin = stability_margin(joint, gains, velocity)
    if not margin.applicable:
        return _none(f"no advice: {margin.reason}")
    if _enough(margin, limits.wanted_margin):
        return _with(joint, gains, velocity, "keep the gains: the wanted margin is reached")
    damping = _least_damping(joint, gains, margin, limits)
    stiffness = _nearest_stiffness(joint, gains, velocity, limits)
    candidates = []
    if damping is not None:
        viscous = float(joint.friction.viscous)
        change = math.log((damping + viscous) / max(float(gains.damping) + viscous, 1e-12))
        candidates.append((abs(change), Gains(stiffness=gains.stiffness, damping=damping), "damping"))
    if stiffness is not None:
        change = math.log(stiffness / float(gains.stiffness))
        candidates.append((abs(change), Gains(stiffness=stiffness, damping=gains.damping), "stiffness"))
    if not candidates:
        return _none(
            f"no gain alone reaches the wanted margin with stiffness in {_text(limits.stiffness_range)} N·m/rad "
            f"and damping in {_text(limits.damping_range)} N·m·s/rad"
        )
    _, best, kind = min(candidates, key=lambda candidate: candidate[0])
    old = float(gains.damping if kind == "damping" else gains.stiffness)
    new = float(best.damping if kind == "damping" else best.stiffness)
    verb = "raise" if new > old else "lower"
    unit = "N·m·s/rad" if kind == "damping" else "N·m/rad"
    return _with(joint, best, velocity, f"{verb} the {kind} from {old:.4g} to {new:.4g} {unit}")


def _enough(margin: StabilityMargin, wanted: float) -> bool:
    return bool(margin.smooth and margin.damping_ratio >= (1.0 + wanted) * margin.critical_damping_ratio)


def _least_damping(joint: Joint, gains: Gains, margin: StabilityMargin, limits: AdviceLimits) -> float | None:
    """k_v at the wanted margin: the critical damping ratio does not depend on k_v."""
    # A little above, so that rounding does not leave the margin a hair short.
    ratio = (1.0 + limits.wanted_margin) * float(margin.critical_damping_ratio) * (1.0 + 1e-9)
    needed = max(float(damping_for_ratio(joint, gains.stiffness, ratio)), limits.damping_range[0])
    return needed if needed <= limits.damping_range[1] else None


def _nearest_stiffness(joint: Joint, gains: Gains, velocity: float, limits: AdviceLimits) -> float | None:
    """k_p nearest to the present one, by factor, at which the wanted margin is reached with the present k_v."""
    present = float(gains.stiffness)
    low, high = max(limits.stiffness_range[0], present * 1e-4), min(limits.stiffness_range[1], present * 1e4)
    if not 0 < low <= high < math.inf:
        return None

    def enough(stiffness: np.ndarray) -> np.ndarray:
        margin = stability_margin(joint, Gains(stiffness=stiffness, damping=gains.damping), velocity)
        reserve = np.asarray(margin.damping_ratio) >= (1.0 + limits.wanted_margin) * np.asarray(
            margin.critical_damping_ratio
        )
        return np.asarray(margin.smooth & reserve)

    grid = np.geomspace(low, high, _SCAN_POINTS)
    good = np.flatnonzero(enough(grid))
    if len(good) == 0:
        return None
    nearest = int(good[np.argmin(np.abs(np.log(grid[good] / present)))])
    inside = grid[nearest]
    neighbour = nearest - 1 if inside > present else nearest + 1
    if not 0 <= neighbour < len(grid):
        return float(inside)
    outside = grid[neighbour]
    for _ in range(_REFINEMENTS):
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if enough(np.array([middle]))[0] else (inside, middle)
    return float(inside)


def _with(joint: Joint, gains: Gains, velocity: float, reason: str) -> Recommendation:
    margin = stability_margin(joint, gains, velocity)
    return Recommendation(
        stiffness=float(gains.stiffness),
        damping=float(gains.damping),
        energy_margin=float(margin.energy_margin),
        reason=reason,
    )


def _none(reason: str) -> Recommendation:
    return Recommendation(stiffness=math.nan, damping=math.nan, energy_margin=math.nan, reason=reason)


def _text(limits: tuple[float, float]) -> str:
    return f"{limits[0]:.4g} to {limits[1]:.4g}"
