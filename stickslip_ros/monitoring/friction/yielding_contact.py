# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A contact that yields before it breaks away, which the paper's does not: the joint creeps at a slip's ends.

While such a joint stands it moves by the force on it over the contact's stiffness σ₀. It breaks away at the speed of
that creep, which in a slip's first moments is as much as what begins it, and springs back where it stops. In between
it slides as on a rigid contact. σ₀ is fitted with the rest, beginning with what the rests say of it: from
where a joint stands early in a rest it moves to where it stands towards the end. How far a contact yields is told as a
share of how far the controller's spring does, k_p/σ₀.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction._window_kernel import COMPLIANCE, INERTIA
from stickslip_ros.monitoring.friction.fitted_law import ModelTerm
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem, SlipTerm, TermParameter, Variants
from stickslip_ros.monitoring.friction.slip_solution import Solution, fit_again
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.friction.trend import Trend
from stickslip_ros.monitoring.samples import FloatArray

# Of the controller's spring: a contact that yields more is not one that slips begin on; slips do not show less.
_MOST_COMPLIANCE, _LEAST_COMPLIANCE = 0.2, 1e-4
_DAMPING_RATIO = 0.5  # damping ratio of a contact that yields, 1: prior mean and standard deviation
_MOST_DAMPING = 2.0  # damping ratio of a contact, 1: at most
LEAST_RESTS = 6  # rests that a compliance is estimated from, 1: at least
_SHOWN = 2.0  # compliance, standard errors: with less the rests do not show it
_UNSEEN = 2.0  # creep of all rests together that may pass unseen, counts
_LEAST_ERROR = 0.3  # error, of the compliance: what is seen at rest is not all that yields when the joint breaks away
# Dwell, periods of the swing on the contact: after a shorter one the joint has not come to rest.
_SETTLING_PERIODS = 2.0


@dataclass(frozen=True, kw_only=True)
class YieldingContact(SlipTerm):
    """Contact that creeps with the force while the joint stands; all slips are :meth:`.SlipWindow.between_creep`.

    Attributes
    ----------
    mean, std : of the prior of its compliance, in ``unit``.
    unit : compliance of the spring that the slips are pulled by [rad/(N·m)].
    """

    mean: float
    std: float
    unit: float
    place = 1

    @property
    def parameters(self) -> dict[str, TermParameter]:
        """Compliance in ``unit``, and damping ratio."""
        return {
            "compliance": TermParameter(mean=self.mean, std=self.std, lower=_LEAST_COMPLIANCE, upper=_MOST_COMPLIANCE),
            "damping_ratio": TermParameter(mean=_DAMPING_RATIO, std=_DAMPING_RATIO, lower=0.0, upper=_MOST_DAMPING),
        }

    def apply(self, variants: Variants, problem: SlipProblem) -> None:
        """Compliance and damping of the contact, and where the joint stood: where it was not seen to, at the nodes."""
        data = problem.data
        inertia = variants.plants[:, INERTIA]
        compliances = np.maximum(variants.parameters[:, problem.column["compliance"]], _LEAST_COMPLIANCE) * self.unit
        dampings = 2.0 * variants.parameters[:, problem.column["damping_ratio"]] * np.sqrt(inertia / compliances)
        variants.contacts = np.repeat(np.stack([compliances, dampings], axis=1)[:, None], data.count, axis=1)
        before, after = data.drives_before, data.drives_after
        ends = data.drives[data.last_observed]
        variants.standing = np.where(np.isfinite(before), before, data.drives[data.edges[:-1]])[None]
        variants.stopped = (np.where(np.isfinite(after), after, ends) - ends)[None]

    def correct(self, variants: Variants, problem: SlipProblem, positions: FloatArray, found: FloatArray) -> None:
        """Where the joint stands after a slip is a mean over a time in which it creeps on."""
        softness = variants.contacts[:, :, COMPLIANCE]
        softness = softness / (1.0 + softness * variants.gains[:, :, 0])
        positions[:, problem.data.last_observed] += softness * variants.stopped


def fit_with_contact(problem: SlipProblem, start: FloatArray) -> Solution | None:
    """The fit next to one of other slips of a joint whose contact yields; None if it is not as good as it should be."""
    yielding = _added(problem)
    solution = fit_again(yielding, start) if yielding is not None else None
    return solution if solution is not None and _comes_to_rest(solution) else None


def _comes_to_rest(solution: Solution) -> bool:
    """Whether joints on such a contact have come to rest before they slip again: they swing on it for a while."""
    problem, parameters = solution.problem, solution.fit.parameters
    contact = problem.model.term(YieldingContact)
    assert contact is not None
    compliance = float(parameters[problem.column["compliance"]]) * contact.unit
    swing = 2.0 * math.pi * math.sqrt(math.exp(float(parameters[INERTIA])) * compliance)
    return float(np.median(problem.data.dwells[problem.noise.usable])) > _SETTLING_PERIODS * swing


def _added(problem: SlipProblem) -> SlipProblem | None:
    if problem.data.normalised or problem.model.term(YieldingContact) is not None:
        return None
    contact = contact_of(problem.data.windows)
    if contact is None:
        return None
    # A trend has to be fitted anew.
    model = problem.model.without(Trend).with_term(contact)
    return problem.changed([window.between_creep() for window in problem.data.windows], model=model)


def contact_of(windows: list[SlipWindow]) -> YieldingContact | None:
    """The contact by the rests before the slips; None where they do not show that it yields."""
    ways, forces = [], []
    for window in windows:
        early, late = window.arrived, window.before
        if early is not None and late is not None:
            ways.append(late.position - early.position)
            forces.append(late.drive - early.drive - _stiffness(window) * ways[-1])
    way, force = np.array(ways), np.array(forces)
    count, size = len(way), float(force @ force)
    if count < LEAST_RESTS or size <= 0.0:
        return None
    compliance = float(way @ force) / size
    off = way - compliance * force
    # A creep of so little that no rest shows a count of it.
    unseen = _UNSEEN * max(window.resolution for window in windows) / math.sqrt(count * size)
    std = max(math.sqrt(float(off @ off) / (count - 1) / size), unseen)
    unit = spring_compliance(windows)
    mean, std = max(compliance, 0.0) / unit, math.hypot(std, _LEAST_ERROR * compliance) / unit
    if mean <= _SHOWN * std or not _LEAST_COMPLIANCE < mean < _MOST_COMPLIANCE:
        return None
    return YieldingContact(mean=mean, std=std, unit=unit)


def spring_compliance(windows: list[SlipWindow]) -> float:
    """Compliance of the spring that slips are pulled by [rad/(N·m)]: of the gains, or as the effort falls in a slip."""
    stiffness = max(_stiffness(window) for window in windows)
    if stiffness > 0.0:
        return 1.0 / stiffness
    falls = [max(float(np.ptp(window.forces)), TINY) for window in windows]
    return float(np.median([abs(window.slip_distance) / fall for window, fall in zip(windows, falls, strict=True)]))


def _stiffness(window: SlipWindow) -> float:
    return float(window.gains.stiffness) if window.gains is not None else 0.0


# Creep at rest is evidence enough. A joint that does not come to rest on the contact does not without the term either.
YIELDING_CONTACT = ModelTerm(
    added=lambda fitted: _added(fitted.problem), parameters=2, prior_evidence=True, settles=_comes_to_rest
)
