# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stribeck friction that differs by direction: F_s∞ (1 + a d) in place of F_s∞, with d = ±1 of the motion.

Coulomb friction that differs by direction is a constant load, which no motion distinguishes from it. Stribeck friction
that differs makes slips and rests of one direction longer, most of which a longer rise time explains as well. F_s∞ is
reported for the direction in which it is larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.monitoring.friction._window_kernel import STRIBECK
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ScoredTerm
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem, TermParameter, Variants
from stickslip_ros.monitoring.friction.trend import FrictionGrowth
from stickslip_ros.monitoring.samples import FloatArray

_STD = 0.1  # prior standard deviation of a, 1
_MOST = 0.9  # size of a, 1: at most


@dataclass(frozen=True, kw_only=True)
class AsymmetricStribeck(FrictionGrowth):
    """Stribeck friction of which there is more in one direction than in the other."""

    place = 4

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """The share a."""
        return {"asymmetry": TermParameter(std=_STD, lower=-_MOST, upper=_MOST)}

    def share(self, variants: Variants, problem: SlipProblem) -> FloatArray:
        """By a more in slips in positive direction, by a less in the others."""
        return np.asarray(variants.parameters[:, problem.column["asymmetry"], None] * problem.data.directions)


@dataclass(frozen=True, kw_only=True)
class Asymmetry:
    """Stribeck friction by direction as it was fitted.

    Attributes
    ----------
    value, std : a, by which F_s∞ is larger in positive direction than the mean of both, as a share, and its standard
        error; negative where it is larger in the other.
    """

    value: float
    std: float

    @property
    def text(self) -> str:
        """In words."""
        larger, other = ("positive", "negative") if self.value > 0.0 else ("negative", "positive")
        less = 1.0 - abs(self.value)
        ratio = 2.0 * abs(self.value) / less
        return (
            f"Stribeck friction is {100.0 * ratio:.2g} ± {200.0 * self.std / less**2:.1g} % larger in {larger} than in "
            f"{other} direction; values are for the {larger}"
        )


def asymmetry_of(fitted: FittedLaw, covariance: FloatArray) -> Asymmetry | None:
    """Of the Stribeck friction; None where it is taken for the same in both directions."""
    if fitted.problem.model.term(AsymmetricStribeck) is None:
        return None
    value, std = fitted.term_parameter("asymmetry", covariance)
    return Asymmetry(value=value, std=std)


def in_the_worse_direction(
    problem: SlipProblem, parameters: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters and covariance with the Stribeck friction of the direction in which it is larger.

    Shapes (p,) and (p + k, p + k), as they were.
    """
    if problem.model.term(AsymmetricStribeck) is None:
        return parameters, covariance
    column = problem.column["asymmetry"]
    share = float(parameters[column])
    changed, slopes = parameters.copy(), np.eye(len(covariance))
    changed[STRIBECK] += math.log1p(abs(share))
    slopes[STRIBECK, column] = math.copysign(1.0 / (1.0 + abs(share)), share)
    return changed, np.asarray(slopes @ covariance @ slopes.T)


def _with_asymmetry(fitted: FittedLaw) -> SlipProblem | None:
    """The problem with the term, where there are slips of both directions."""
    problem = fitted.problem
    both = problem.data.directions.min() < problem.data.directions.max()
    if not both or not fitted.may_lack_terms or problem.model.term(AsymmetricStribeck) is not None:
        return None
    return problem.changed(model=problem.model.with_term(AsymmetricStribeck()))


ASYMMETRY = ScoredTerm(name="asymmetry", added=_with_asymmetry)
