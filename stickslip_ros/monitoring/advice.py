# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Gains that would make the motion smooth by Eq. (43), with the least change."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_not_negative
from stickslip_ros.model.dimensionless import damping_for_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, stability_margin
from stickslip_ros.monitoring.samples import FloatArray

_SCAN_POINTS, _SCAN_POINTS_OF_DRAWS = 600, 120
_REFINEMENTS = 40
_BELIEVABLE = 100.0  # times the present gain: learnt friction is not known so far from where it was seen


@dataclass(frozen=True, kw_only=True)
class AdviceLimits:
    """What the advice must reach and keep within.

    Attributes
    ----------
    wanted_margin : by how much the damping ratio shall exceed the critical one, e.g. 0.2 for 20 %.
    confidence : probability with which it shall, where the joint is known with errors only.
    stiffness_range, damping_range : least and largest gain [N·m/rad], [N·m·s/rad].

    Raises
    ------
    InvalidParameterError
        If the margin is negative, the confidence not in [0.5, 1), or a range is not 0 <= least <= largest.
    """

    wanted_margin: float = 0.2
    confidence: float = 0.9
    stiffness_range: tuple[float, float] = field(default=(0.0, math.inf), metadata={"unit": "N·m/rad"})
    damping_range: tuple[float, float] = field(default=(0.0, math.inf), metadata={"unit": "N·m·s/rad"})

    def __post_init__(self) -> None:
        require_not_negative("wanted_margin", self.wanted_margin)
        if not 0.5 <= self.confidence < 1.0:
            raise InvalidParameterError("confidence", ">= 0.5 and < 1", self.confidence)
        for name in ("stiffness_range", "damping_range"):
            least, largest = getattr(self, name)
            if not 0 <= least <= largest:
                raise InvalidParameterError(name, "(least, largest) with 0 <= least <= largest", (least, largest))


@dataclass(frozen=True, kw_only=True)
class Uncertainty:
    """A joint as it may be: draws from what is known of it.

    Attributes
    ----------
    joint : of arrays, one value a draw.
    stiffness : of the controller in each draw over the nominal one; 1 where the gains are known.
    """

    joint: Joint
    stiffness: FloatArray


@dataclass(frozen=True, kw_only=True)
class Recommendation:
    """Gains to use, or why there are none.

    Attributes
    ----------
    stiffness : k_p [N·m/rad], damping : k_v [N·m·s/rad]; NaN if nothing within the limits helps.
    energy_margin : of Eq. (43) with these gains [M x˙_s²].
    reason : one sentence for a person.
    stiffness_factor, damping_factor : of the present stiffness, and of the damping of controller and viscous
        friction together: what is left of advice where the gains are unknown.
    """

    stiffness: float
    damping: float
    energy_margin: float
    reason: str
    stiffness_factor: float = math.nan
    damping_factor: float = math.nan

    @property
    def found(self) -> bool:
        """Whether there are gains to recommend."""
        return math.isfinite(self.stiffness)


def recommend(
    joint: Joint,
    gains: Gains,
    velocity: float,
    limits: AdviceLimits | None = None,
    uncertainty: Uncertainty | None = None,
    *,
    gains_known: bool = True,
) -> Recommendation:
    """The smaller of two changes that reaches the wanted margin: damping alone or stiffness alone.

    Changes are compared by the logarithm of the factor on k_p and on k_v + F_v.

    Parameters
    ----------
    joint, gains : scalars. velocity : commanded speed [rad/s].
    limits : defaults to AdviceLimits().
    uncertainty : the margin is to hold in the share ``limits.confidence`` of its draws; None for a joint known
        exactly.
    gains_known : False if the gains are per inertia: the advice then is in factors, and limits do not bind it.
    """
    limits = limits or AdviceLimits()
    if not gains_known:
        limits = replace(limits, stiffness_range=(0.0, math.inf), damping_range=(0.0, math.inf))
    margin = stability_margin(joint, gains, velocity)
    if not margin.applicable:
        return _none(f"no advice: {margin.reason}")
    case = _Case(joint, gains, velocity, limits, uncertainty)
    if case.enough(np.array([float(gains.stiffness)]))[0]:
        return _with(joint, gains, gains, velocity, "keep the gains: the wanted margin is reached")
    damping, stiffness = case.least_damping(), case.nearest_stiffness()
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
    advice = _with(joint, gains, best, velocity, "")
    factor = max(advice.stiffness_factor, advice.damping_factor) if uncertainty else 1.0
    if factor > _BELIEVABLE:
        return _none(
            f"no advice: it would be {kind} × {factor:.3g}, more than what was learnt of the friction can answer for"
        )
    return replace(advice, reason=_in_words(kind, gains, best, advice, gains_known=gains_known))


def _in_words(kind: str, gains: Gains, best: Gains, advice: Recommendation, *, gains_known: bool) -> str:
    if not gains_known:
        factor = advice.damping_factor if kind == "damping" else advice.stiffness_factor
        note = " (controller's and joint's together)" if kind == "damping" else ""
        return f"{kind} × {factor:.3g}{note}"
    old = float(gains.damping if kind == "damping" else gains.stiffness)
    new = float(best.damping if kind == "damping" else best.stiffness)
    verb = "raise" if new > old else "lower"
    unit = "N·m·s/rad" if kind == "damping" else "N·m/rad"
    return f"{verb} the {kind} from {old:.4g} to {new:.4g} {unit}"


class _Case:
    """One joint, or the draws of one, at one speed: what reaches the wanted margin."""

    def __init__(
        self, joint: Joint, gains: Gains, velocity: float, limits: AdviceLimits, uncertainty: Uncertainty | None
    ) -> None:
        self._joint = uncertainty.joint if uncertainty else joint
        self._ratios = uncertainty.stiffness if uncertainty else np.ones(1)
        self._share = limits.confidence if uncertainty else 1.0
        self._gains, self._velocity, self._limits = gains, velocity, limits
        self._wanted = 1.0 + limits.wanted_margin

    def _margin(self, stiffness: FloatArray) -> StabilityMargin:
        """Margins with the present damping, shape (len(stiffness), draws)."""
        gains = Gains(stiffness=stiffness[:, None] * self._ratios, damping=self._gains.damping)
        return stability_margin(self._joint, gains, self._velocity)

    def enough(self, stiffness: FloatArray) -> NDArray[np.bool_]:
        """Whether the wanted margin is reached with the present damping, shape (len(stiffness),)."""
        margin = self._margin(stiffness)
        reached = np.asarray(margin.damping_ratio) >= self._wanted * np.asarray(margin.critical_damping_ratio)
        return np.asarray(np.mean(np.asarray(margin.smooth) & reached, axis=1) >= self._share)

    def least_damping(self) -> float | None:
        """k_v at the wanted margin: the critical damping ratio does not depend on k_v."""
        stiffness = np.array([float(self._gains.stiffness)])
        # A little above, so that rounding does not leave the margin a hair short.
        ratio = self._wanted * np.asarray(self._margin(stiffness).critical_damping_ratio)[0] * (1.0 + 1e-9)
        needed = damping_for_ratio(self._joint, stiffness * self._ratios, ratio)
        enough = float(np.quantile(np.broadcast_to(needed, self._ratios.shape), self._share, method="higher"))
        enough = max(enough, self._limits.damping_range[0])
        return enough if enough <= self._limits.damping_range[1] else None

    def nearest_stiffness(self) -> float | None:
        """k_p nearest to the present one, by factor, at which the wanted margin is reached with the present k_v."""
        present = float(self._gains.stiffness)
        least, largest = self._limits.stiffness_range
        low, high = max(least, present * 1e-4), min(largest, present * 1e4)
        if not 0 < low <= high < math.inf:
            return None
        grid = np.geomspace(low, high, _SCAN_POINTS if len(self._ratios) == 1 else _SCAN_POINTS_OF_DRAWS)
        good = np.flatnonzero(self.enough(grid))
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
            inside, outside = (middle, outside) if self.enough(np.array([middle]))[0] else (inside, middle)
        return float(inside)


def _with(joint: Joint, present: Gains, gains: Gains, velocity: float, reason: str) -> Recommendation:
    margin = stability_margin(joint, gains, velocity)
    viscous = float(joint.friction.viscous)
    return Recommendation(
        stiffness=float(gains.stiffness),
        damping=float(gains.damping),
        energy_margin=float(margin.energy_margin),
        reason=reason,
        stiffness_factor=float(gains.stiffness) / float(present.stiffness),
        damping_factor=(float(gains.damping) + viscous) / max(float(present.damping) + viscous, 1e-300),
    )


def _none(reason: str) -> Recommendation:
    return Recommendation(stiffness=math.nan, damping=math.nan, energy_margin=math.nan, reason=reason)


def _text(limits: tuple[float, float]) -> str:
    return f"{limits[0]:.4g} to {limits[1]:.4g}"
