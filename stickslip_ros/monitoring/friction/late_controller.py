# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A controller that acts late, as every sampled one does: it holds its effort for a period, and sends it later still.

A delay τ of the force of the gains is, to the first order, damping of −k_p τ and inertia of −k_v τ. With one speed,
and gains that are the same throughout, viscous friction and inertia take it up: then viscous friction is told with
it, F_v − k_p τ, which is what counts for the margin, and the error of the inertia has it. Where it takes away more
damping than friction gives, no friction can take it up: there it is fitted. Where speeds differ it is one of the
optional terms of :mod:`.model_selection`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.model._friction_law import HESS_SOOM
from stickslip_ros.model.friction import Joint
from stickslip_ros.monitoring.friction._window_kernel import HOLDING_FORCE, INERTIA, LEVEL, VISCOUS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, ModelTerm, ScoredTerm
from stickslip_ros.monitoring.friction.slip_problem import SlipModel, SlipProblem, SlipTerm, TermParameter, Variants
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

SPREAD_LIMIT = 4.0  # standard error of a logarithm, 1: a wider one means nothing
# Viscous friction, of its standard error: less is no friction to speak of, and its logarithm needs some.
LEAST_VISCOUS = 0.3
_LEAST = 1e-9  # viscous friction that is left, of all of it: at least
LATE = 1.5  # prior standard deviation of a controller's delay, sample intervals
_LATEST = 2.0  # longest delay, of `LATE`
_LONGEST_DELAY = 20.0  # longest delay of a controller, sample intervals
_LEAST_INERTIA = 0.1  # inertia that a delay leaves, of the inertia: at least
_NEXT_TO_NONE = math.log(3.0)  # above the least viscous friction that can be fitted: there may be less than none


@dataclass(frozen=True, kw_only=True)
class Delay(SlipTerm):
    """The controller's delay τ: the force of a time ago is that of now less its rate."""

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """τ in sample intervals."""
        return {"delay": TermParameter(std=LATE, lower=0.0, upper=_LONGEST_DELAY)}

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """k_p τ less damping, and k_v τ less inertia, by which all that is per inertia grows."""
        data = problem.data
        lighter, stiffness = _inertia_left(variants, problem), data.gains[:, 0]
        taken = _delays(variants, problem) * stiffness
        viscous = variants.plants[:, VISCOUS, None]
        damping = (variants.gains[:, :, 1] - taken + viscous) / lighter - viscous
        variants.gains = np.stack(np.broadcast_arrays(stiffness / lighter, damping), axis=2)
        late = taken[:, data.slip_of_node] * data.rates
        variants.drives = (variants.drives - late) / lighter[:, data.slip_of_node]
        variants.starts[:, :, LEVEL] /= lighter
        variants.drags = variants.drags / lighter
        variants.contacts = variants.contacts * np.stack([lighter, 1.0 / lighter], axis=2)
        variants.standing = (variants.standing - late[:, data.edges[:-1]]) / lighter
        variants.stopped = variants.stopped / lighter

    def correct(self, variants: Variants, problem: SlipProblem, positions: FloatArray, found: FloatArray) -> None:
        """Forces are what they are, not per share of the inertia."""
        found[:, :, HOLDING_FORCE] *= _inertia_left(variants, problem)


def _delays(variants: Variants, problem: SlipProblem) -> FloatArray:
    """τ of each variant [s], shape (variants, 1)."""
    return np.asarray(variants.parameters[:, problem.column["delay"], None] * problem.data.sample_interval)


def _inertia_left(variants: Variants, problem: SlipProblem) -> FloatArray:
    """Share of the inertia that the delay leaves in each slip, shape (variants, slips)."""
    taken = _delays(variants, problem) * problem.data.gains[:, 1]
    return np.asarray(np.maximum(1.0 - taken / variants.plants[:, INERTIA, None], _LEAST_INERTIA))


def model_of(
    windows: list[SlipWindow], law: int = HESS_SOOM, known: Mapping[int, tuple[float, float]] | None = None
) -> SlipModel:
    """The law alone, with the delay where gains change: else a delay τ is as good as less damping and inertia."""
    changing = len({window.gains for window in windows}) > 1
    shows = changing and windows[0].source is ForceSource.GAINS
    return SlipModel(law=law, known=known or {}, terms=(Delay(),) if shows else ())


@dataclass(frozen=True, kw_only=True)
class DelayEstimate:
    """Estimate of a delay τ of the controller's force, which reduces the damping by k_p τ.

    With constant gains only the remaining damping is identifiable; then viscous friction is a guess, and the delay is
    the one that goes with the guess.

    Attributes
    ----------
    viscous : F_v, without the effect of the delay [N·m·s/rad]. spread : standard error of its logarithm.
    left : F_v − k_p τ [N·m·s/rad], negative where the delay takes more than there is. std : its standard error.
    stiffness : k_p at which that is left [N·m/rad]. longest : the longest delay that is thought possible [s].
    """

    viscous: float
    spread: float
    left: float
    std: float
    stiffness: float
    longest: float

    @property
    def missing_damping(self) -> float:
        """Damping that the delay takes beyond all viscous friction [N·m·s/rad]; 0 where some is left."""
        return max(-self.left, 0.0)

    @property
    def delay(self) -> float:
        """τ [s]."""
        return (self.viscous - self.left) / self.stiffness

    @property
    def delay_std(self) -> float:
        """Standard error of τ [s]."""
        return math.hypot(self.viscous * self.spread, self.std) / self.stiffness

    def applied_to(self, joint: Joint) -> Joint:
        """The joint with viscous friction and delay apart."""
        viscous, delay = self._apart(np.asarray(self.viscous), np.asarray(self.left))
        friction = replace(joint.friction, viscous=float(viscous))
        return replace(joint, friction=friction, actuation_delay=float(delay))

    def drawn(self, joint: Joint, normal: FloatArray) -> Joint:
        """Joints as one of arrays with viscous friction and delay apart, as the errors allow.

        Parameters
        ----------
        normal : two standard normal draws for each joint, shape (2, draws).
        """
        left = self.left + self.std * normal[1]
        viscous = self.viscous * np.exp(min(self.spread, SPREAD_LIMIT) * normal[0])
        viscous, delay = self._apart(np.minimum(viscous, left + self.stiffness * self.longest), left)
        return replace(joint, friction=replace(joint.friction, viscous=viscous), actuation_delay=delay)

    def _apart(self, viscous: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Viscous friction and delay that leave what is left; no force acts early."""
        viscous = np.maximum(viscous, np.maximum(left, _LEAST * self.viscous))
        return viscous, (viscous - left) / self.stiffness


def delay_estimate(problem: SlipProblem, parameters: FloatArray, covariance: FloatArray) -> DelayEstimate | None:
    """What the delay takes away at the latest gains, with errors; None of a problem whose delay does not show.

    Parameters
    ----------
    parameters : logarithms and what comes after them, shape (p,). covariance : shape (p + k, p + k).
    """
    if problem.model.term(Delay) is None:
        return None
    viscous, slopes = math.exp(parameters[VISCOUS]), _slopes_of_what_is_left(problem, parameters, len(covariance))
    return DelayEstimate(
        viscous=viscous,
        spread=math.sqrt(max(float(covariance[VISCOUS, VISCOUS]), 0.0)),
        left=viscous - _taken_by_an_interval(problem) * float(parameters[problem.column["delay"]]),
        std=math.sqrt(max(float(slopes @ covariance @ slopes), 0.0)),
        stiffness=problem.latest_gains[0],
        longest=_LATEST * LATE * problem.data.sample_interval,
    )


def at_the_latest_gains(
    problem: SlipProblem, parameters: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters and covariance with what a delay leaves of the viscous friction at the latest gains for viscous.

    The delay reduces the damping by k_p τ. Shapes (p,) and (p + k, p + k), as they were.
    """
    late = delay_estimate(problem, parameters, covariance)
    if late is None:
        return parameters, covariance
    slopes = np.eye(len(covariance))
    slopes[VISCOUS] = _slopes_of_what_is_left(problem, parameters, len(covariance))
    # Friction is not negative; the logarithm needs some.
    left = max(late.left, LEAST_VISCOUS * late.std, 1e-6 * late.viscous)
    slopes[VISCOUS] /= left
    changed = parameters.copy()
    changed[VISCOUS] = math.log(left)
    return changed, np.asarray(slopes @ covariance @ slopes.T)


def _slopes_of_what_is_left(problem: SlipProblem, parameters: FloatArray, size: int) -> FloatArray:
    """Of what is left of the viscous friction, over the parameters and what follows them, shape (size,)."""
    slopes = np.zeros(size)
    slopes[[VISCOUS, problem.column["delay"]]] = math.exp(parameters[VISCOUS]), -_taken_by_an_interval(problem)
    return slopes


def _taken_by_an_interval(problem: SlipProblem) -> float:
    """Damping that a delay of one sample interval takes off at the latest gains [N·m·s/rad]."""
    return problem.latest_gains[0] * problem.data.sample_interval


def may_hide_a_delay(fitted: FittedLaw) -> bool:
    """Whether viscous friction next to none may be more, less a delay that is not fitted."""
    problem, solution = fitted.problem, fitted.solution
    viscous = float(solution.fit.parameters[VISCOUS])
    next_to_none = viscous <= solution.prior.lower[VISCOUS] + _NEXT_TO_NONE
    return _may_be_late(problem) and next_to_none


def _may_be_late(problem: SlipProblem) -> bool:
    return problem.may_be_late and problem.model.term(Delay) is None


def _added(problem: SlipProblem) -> SlipProblem:
    return problem.changed(model=problem.model.with_term(Delay()))


def _less_viscous(problem: SlipProblem, parameters: FloatArray) -> FloatArray:
    """For each unit of a delay viscous friction is told by so much less: what the delay leaves of it counts."""
    reported_change = np.zeros(len(parameters))
    reported_change[VISCOUS] = -_taken_by_an_interval(problem) / math.exp(parameters[VISCOUS])
    return reported_change


HIDDEN_DELAY = ModelTerm(added=lambda fitted: _added(fitted.problem) if may_hide_a_delay(fitted) else None)
# In a slip a controller's delay is as good as damping, but at breakaway the force is that of a time ago: at another
# speed by another amount less.
LATE_CONTROLLER = ScoredTerm(
    name="delay",
    added=lambda fitted: _added(fitted.problem) if fitted.may_lack_terms and _may_be_late(fitted.problem) else None,
    reported_change=_less_viscous,
    lower=0.0,
)
