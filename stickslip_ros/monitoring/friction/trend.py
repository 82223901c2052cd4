# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Friction that changes steadily while slips are observed, as a joint's does that warms up.

Fitted where the balance of forces shows it, and kept where it explains more than its two parameters are worth (BIC):
the kinetic friction grows by so much from the first slip to the last, Stribeck and viscous friction by a share.
Parameters and kinetic friction are those at the last slip. Where only speeds are known there is no trend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip_ros.monitoring.friction._window_kernel import HOLDING_FORCE, LEVEL, VISCOUS
from stickslip_ros.monitoring.friction.dry_friction import LEAST_SLIPS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ModelTerm
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem, SlipTerm, TermParameter, Variants
from stickslip_ros.monitoring.samples import FloatArray

_STD = 0.1  # prior standard deviation of a trend from the first slip to the last, of the Stribeck friction


@dataclass(frozen=True, kw_only=True)
class FrictionGrowth(SlipTerm):
    """Stribeck friction that grows by a share of what it has by Eq. (6)."""

    place = 2

    def share(self, variants: Variants, problem: SlipProblem) -> FloatArray:
        """By how much it has grown in each slip, shape (variants, slips)."""
        (name,) = self.parameters
        assert problem.covariate is not None
        return np.asarray(variants.parameters[:, problem.column[name], None] * problem.covariate)

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """At every breakaway there is so much more of it."""
        variants.starts[:, :, LEVEL] *= 1.0 + self.share(variants, problem)

    def correct(self, variants: Variants, problem: SlipProblem, positions: FloatArray, found: FloatArray) -> None:
        """What has grown is no part of the kinetic friction, which is what holds less the level by Eq. (6)."""
        share = self.share(variants, problem)
        found[:, :, HOLDING_FORCE] -= share * variants.levels
        # A further growth is a share of what there is with this one.
        variants.levels = variants.levels * (1.0 + share)


@dataclass(frozen=True, kw_only=True)
class Trend(FrictionGrowth):
    """Friction that changes steadily from the first slip to the last, viscous friction by the same share."""

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """The share."""
        return {"trend": TermParameter(std=_STD)}

    def covariate(self, problem: SlipProblem) -> FloatArray:
        """The time."""
        return problem.data.since

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """Viscous friction is more damping, its quadratic part more drag."""
        super().apply(variants, problem)
        share = self.share(variants, problem)
        variants.gains = np.repeat(variants.gains, len(variants.plants), axis=0)
        variants.gains[:, :, 1] += share * variants.plants[:, VISCOUS, None]
        variants.drags = variants.drags * (1.0 + share)


def _shows(first: FittedLaw) -> bool:
    """Whether a straight line over time explains enough of the kinetic friction for a trend to be tried."""
    problem, used = first.problem, first.problem.noise.usable
    count = int(used.sum())
    if count < LEAST_SLIPS:
        return False
    misfits, columns = first.solution.fit.misfits[used], problem.balance[used]
    steady, changing = (
        misfits - one @ np.linalg.lstsq(one, misfits, rcond=None)[0]
        for one in (columns, np.column_stack([columns, problem.data.since[used]]))
    )
    return bool(float(steady @ steady) > count ** (1.0 / count) * float(changing @ changing))


def _added(fitted: FittedLaw) -> SlipProblem | None:
    if fitted.problem.data.normalised or fitted.solution.tolerance > 0 or not _shows(fitted):
        return None
    return fitted.problem.changed(model=fitted.problem.model.with_term(Trend()))


TREND = ModelTerm(added=_added, parameters=2)
