# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Viscous friction that is no straight line over speed: F_v y˙ (1 - c + c y˙/v) in place of F_v y˙.

Grease thins, and oil is churned. F_v is reported at the speed v, at which friction takes as much as it does on average
in a slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.friction._window_kernel import VISCOUS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ScoredTerm
from stickslip_ros.monitoring.friction.late_controller import may_hide_a_delay
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem, SlipTerm, TermParameter, Variants
from stickslip_ros.monitoring.samples import FloatArray

_STD = 0.5  # prior standard deviation of the quadratic part of viscous friction, of it
_MOST_CURVED = 0.95  # quadratic part of viscous friction, of it, or what is missing there: at most
_SWIFT = 1.33  # speed, of the mean of a slip that is half a sine: friction takes as much there as on average


@dataclass(frozen=True, kw_only=True)
class CurvedViscous(SlipTerm):
    """Viscous friction of which a share goes with the square of the speed.

    Attributes
    ----------
    speed : v [rad/s], at which it is reported.
    """

    speed: float
    place = 3

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """The share c."""
        return {"curvature": TermParameter(std=_STD, lower=-_MOST_CURVED, upper=_MOST_CURVED)}

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """What goes with the square of the speed is no part of the damping."""
        squared = variants.parameters[:, problem.column["curvature"]] * variants.plants[:, VISCOUS]
        variants.drags = np.repeat(squared[:, None] / self.speed, problem.data.count, axis=1)
        variants.plants[:, VISCOUS] -= squared


@dataclass(frozen=True, kw_only=True)
class Curvature:
    """Viscous friction F_v y˙ (1 - c + c y˙/v) as it was fitted.

    Attributes
    ----------
    value, std : c, the share that goes with the square of the speed, and its standard error; negative where friction
        grows ever less. speed : v [rad/s], at which F_v is told.
    """

    value: float
    std: float
    speed: float

    def drawn(self, joint: Joint) -> Joint:
        """Joints as one of arrays, each with the viscous friction of another speed between none and v.

        A verdict is about a motion that is slower than the slips from which friction was learnt, by what is not known.
        """
        viscous = np.asarray(joint.friction.viscous)
        slower = np.random.default_rng(43).permutation((np.arange(len(viscous)) + 0.5) / len(viscous))  # share of v
        viscous = viscous * (1.0 - self.value * slower)
        return replace(joint, friction=replace(joint.friction, viscous=viscous))

    @property
    def text(self) -> str:
        """In words."""
        way = "more" if self.value > 0.0 else "less"
        return (
            f"viscous friction grows {way} than in proportion to the speed (curvature {self.value:+.2g} ± "
            f"{self.std:.1g}); its value is for {self.speed:.2g} rad/s"
        )


def curvature_of(fitted: FittedLaw, covariance: FloatArray) -> Curvature | None:
    """Of viscous friction over speed; None where it is taken for a straight line."""
    curved = fitted.problem.model.term(CurvedViscous)
    if curved is None:
        return None
    value, std = fitted.term_parameter("curvature", covariance)
    return Curvature(value=value, std=std, speed=curved.speed)


def _with_curve(fitted: FittedLaw) -> SlipProblem | None:
    """The problem with viscous friction that may be a curve: where it is hardly seen that is no question."""
    problem = fitted.problem
    if not fitted.may_lack_terms or problem.model.term(CurvedViscous) is not None or may_hide_a_delay(fitted):
        return None
    return problem.changed(model=problem.model.with_term(CurvedViscous(speed=_SWIFT * problem.data.usual_speed)))


CURVED_VISCOUS = ScoredTerm(
    name="curvature",
    added=_with_curve,
    explains_misfit=True,
)
