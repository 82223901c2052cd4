# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a joint may have beyond the laws, as one more parameter of the fit: fitted where it shows, else part of errors.

Each such supplement is taken to be as likely as none before anything is seen, and of any size that its prior allows.
How much better it would explain the slips is known from the slopes of the residuals by its parameter, next to the fit
without it. If that is clearly worth a parameter, it is fitted with the rest. If not, slips may just not tell it from
the other parameters: their errors then have what it may make of them, by its probability.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import LinAlgError

from stickslip_ros.monitoring.friction._window_kernel import VISCOUS
from stickslip_ros.monitoring.friction.fit_errors import covariance_of
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, fitted_with_more, repeated
from stickslip_ros.monitoring.friction.late_controller import may_hide_a_delay
from stickslip_ros.monitoring.friction.slip_fit import Tolerances, evidence
from stickslip_ros.monitoring.friction.slip_problem import CURVATURE, LATE, PARAMETERS, SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import ForceSource
from stickslip_ros.monitoring.samples import FloatArray

# Twice the logarithm of a likelihood ratio. BIC asks for less than half as much; but whoever asks of so many slips, in
# study after study, is told so by noise now and then, and is better off with the wider errors.
_CLEARLY = 10.0
_MUCH = 0.98  # of the most that there can be
_LITTLE = 0.005  # of a slip, that a supplement may explain which the law leaves over
_FARTHEST = 2.0  # standard deviations before anything is seen


@dataclass(frozen=True, kw_only=True)
class Supplement:
    """One kind of them.

    Attributes
    ----------
    may_be : whether it is a question for a fit. added : to a problem. column : of its parameter, in a problem with it.
    told : by how much parameters are told otherwise for each unit of it, of a problem without it and its parameters.
    std : of its parameter, whose mean is zero, before anything is seen. lower : which it is not below.
    explains_misfit : whether it is also tried where nothing explains the slips, if a few of them promise something.
    """

    may_be: Callable[[FittedLaw], bool]
    added: Callable[[SlipProblem], SlipProblem]
    column: Callable[[SlipProblem], int]
    told: Callable[[SlipProblem, FloatArray], FloatArray]
    std: float
    lower: float
    explains_misfit: bool


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What slips say of a supplement's parameter, by a fit without it and the slopes there.

    Attributes
    ----------
    value, std : of the parameter, with what was thought of it before: ``prior``, a standard deviation.
    moves : of parameters and kinetic friction as they are told, for each unit of it, shape (p + k,).
    gain : by how much twice the logarithm of the likelihood is more with it.
    """

    value: float
    std: float
    prior: float
    moves: FloatArray
    gain: float

    @property
    def probability(self) -> float:
        """Of there being such a thing, if that is as likely as not before anything is seen."""
        odds = 0.5 * (self.value / self.std) ** 2 + math.log(self.std / self.prior)
        return 1.0 / (1.0 + math.exp(min(-odds, 700.0)))

    @property
    def covariance(self) -> FloatArray:
        """Of what it may make of parameters and kinetic friction, shape (p + k, p + k)."""
        return np.asarray(self.probability * (self.value**2 + self.std**2) * np.outer(self.moves, self.moves))


def with_supplements(
    first: FittedLaw, known: Mapping[int, tuple[float, float]], beside: FittedLaw | None = None
) -> FittedLaw:
    """The same law with what explains the slips clearly better, what explains most first; else as it was.

    With it goes what others may make of its parameters and kinetic friction. Where the law does not fit, what is left
    over says nothing of them.

    Parameters
    ----------
    known : mean and standard deviation of parameters' logarithms, by index.
    beside : another law's fit of the same slips. Without a curve in that there is none in this: a wrong law with a
        curve explains much.
    """
    fitted = first
    straight = beside is not None and beside.problem.curved_at is None
    tried: set[Supplement] = {CURVED_VISCOUS} if straight else set()
    asked = _asked(fitted)
    while (best := _most_promising(fitted, {one: asked[one] for one in asked if one not in tried})) is not None:
        tried.add(best)
        found = fitted_with_more(fitted, best.added(fitted.problem), 1, known, promises=asked[best] is not None)
        if found is not fitted and not _at_its_bound(found, best):
            fitted = found
            asked = _asked(fitted)
    covariance = sum((said.covariance for said in asked.values() if said is not None), start=np.zeros(()))
    return replace(fitted, by_supplements=np.asarray(covariance))


def _asked(fitted: FittedLaw) -> dict[Supplement, Evidence | None]:
    """The supplements that are a question for a fit, each with what the slips say of it, None if nothing."""
    return {one: _evidence(fitted, one) for one in SUPPLEMENTS if one.may_be(fitted)}


def _most_promising(fitted: FittedLaw, left: Mapping[Supplement, Evidence | None]) -> Supplement | None:
    """What of those left is worth a fit; None if nothing is."""
    gains = {one: said.gain for one, said in left.items() if said is not None and said.gain > _CLEARLY}
    if gains:
        return max(gains, key=lambda one: gains[one])
    # With an effort that is wrong slips might be explained that should not be; and where much is left over a look is in
    # vain.
    problem = fitted.problem
    little = 0.0 < fitted.solution.tolerance < _LITTLE * float(np.median(problem.distances))
    if not little or problem.windows[0].source is not ForceSource.GAINS:
        return None
    return next((one for one, said in left.items() if said is None and one.explains_misfit), None)


def _at_its_bound(fitted: FittedLaw, supplement: Supplement) -> bool:
    """Whether its parameter would be more than there can be: then something else is the cause."""
    column, prior = supplement.column(fitted.problem), fitted.solution.prior
    value = fitted.solution.fit.parameters[column]
    return bool(abs(value) > _MUCH * prior.upper[column])


def _evidence(fitted: FittedLaw, supplement: Supplement) -> Evidence | None:
    """What the slips of a fit say of a supplement that it has not; None where nothing can be said."""
    problem, solution = fitted.problem, fitted.solution
    if solution.tolerance > 0.0:
        return None
    fit, prior, more = solution.fit, solution.prior, supplement.added(problem)
    solution.hand_to(more)
    column = supplement.column(more)
    try:
        said = evidence(
            more, Tolerances(balance=solution.balance_error, level=solution.link_error),
            parameters=np.insert(fit.parameters, column, 0.0), kinetic=fit.kinetic, unknowns=fit.unknowns, iterations=0,
        )  # fmt: skip
    except LinAlgError:
        return None
    others = np.delete(np.arange(len(said.gradient)), column)
    moves = -covariance_of(said.information[np.ix_(others, others)], prior) @ said.information[others, column]
    # Residuals that say the same count once.
    alike = repeated(problem, solution)
    own = max(float(said.information[column, column] + said.information[column, others] @ moves), 0.0) / alike
    # A fit ends a little off its valley's floor, and a delay goes along that of viscous friction.
    pull = said.gradient[others]
    pull[: len(fit.parameters)] += prior.information @ (prior.mean - fit.parameters)
    slope = float(said.gradient[column] + moves @ pull) / alike
    std = 1.0 / math.sqrt(own + supplement.std**-2)
    value = max(slope * std**2, supplement.lower)
    gain = (value / std) ** 2
    # Slopes reach no further.
    value = min(max(value, -_FARTHEST * supplement.std), _FARTHEST * supplement.std)
    moves[: len(fit.parameters)] += supplement.told(problem, fit.parameters)
    return Evidence(value=value, std=std, prior=supplement.std, moves=moves, gain=gain)


def _may_have_more(fitted: FittedLaw) -> bool:
    """Whether there is more to ask: not where only speeds are known, or what is taken off is only nearly right."""
    return not (fitted.problem.normalised or fitted.surroundings is not None or fitted.swings)


def _may_be_curved(fitted: FittedLaw) -> bool:
    """Whether viscous friction may be no straight line: where it is hardly seen that is no question."""
    return _may_have_more(fitted) and fitted.problem.curved_at is None and not may_hide_a_delay(fitted)


def _may_be_late(fitted: FittedLaw) -> bool:
    return _may_have_more(fitted) and fitted.problem.may_be_late and not fitted.problem.delay_shows


def _left_by_a_delay(problem: SlipProblem, parameters: FloatArray) -> FloatArray:
    """For each unit of a delay viscous friction is told by so much less: what the delay leaves of it counts."""
    told = np.zeros(len(parameters))
    told[VISCOUS] = -problem.taken_by_an_interval / math.exp(parameters[VISCOUS])
    return told


# Grease thins, and oil is churned: F_v y˙ (1 - c + c y˙/v) in place of F_v y˙. F_v is told at the speed v, at which
# friction takes as much as it does on average in a slip.
CURVED_VISCOUS = Supplement(
    may_be=_may_be_curved,
    added=SlipProblem.with_curvature,
    column=lambda problem: problem.curvature_column,
    told=lambda problem, parameters: np.zeros(len(parameters)),
    std=CURVATURE,
    lower=-math.inf,
    explains_misfit=True,
)
# In a slip a controller's delay is as good as damping, but at breakaway the force is that of a time ago: at another
# speed by another amount less.
LATE_CONTROLLER = Supplement(
    may_be=_may_be_late,
    added=SlipProblem.with_delay,
    column=lambda problem: PARAMETERS,
    told=_left_by_a_delay,
    std=LATE,
    lower=0.0,
    explains_misfit=False,
)
SUPPLEMENTS = (CURVED_VISCOUS, LATE_CONTROLLER)
