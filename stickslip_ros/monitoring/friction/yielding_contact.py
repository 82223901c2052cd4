# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A contact that yields before it breaks away, which the paper's does not: the joint creeps at a slip's ends.

While such a joint stands it moves by the force on it over the contact's stiffness σ₀. It breaks away at the speed of
that creep, which in a slip's first moments is as much as what begins it, and springs back where it stops. In between
it slides as on a rigid contact. σ₀ is fitted with the rest, beginning with what the rests say of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stickslip_ros.monitoring.friction._window_kernel import INERTIA
from stickslip_ros.monitoring.friction.contact_knowledge import contact_of
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, fitted_with_more
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_solution import Solution, fit_again
from stickslip_ros.monitoring.samples import FloatArray

_PARAMETERS = 2  # parameters of a contact, 1: compliance and damping
# Dwell, periods of the swing on the contact: after a shorter one the joint has not come to rest.
_SETTLING_PERIODS = 2.0


def with_contact(first: FittedLaw, known: Mapping[int, tuple[float, float]]) -> FittedLaw:
    """The same law with a contact that yields, where the joint creeps and that explains the slips better (BIC).

    Where it does, but the joint does not come to rest on it, neither does.

    Parameters
    ----------
    known : mean and standard deviation of parameters' logarithms, by index.
    """
    fitted = first.problem.model.contact is not None
    contact = None if fitted or first.problem.normalised else contact_of(first.problem.windows)
    if contact is None:
        return first
    yielding = first.problem.with_contact(contact)
    found = fitted_with_more(first, yielding, _PARAMETERS, known, prior_evidence=True)
    if found is first or comes_to_rest(found.solution):
        return found
    return replace(first, unsettled=True)


def fit_with_contact(
    problem: SlipProblem, start: FloatArray, known: Mapping[int, tuple[float, float]]
) -> Solution | None:
    """The fit next to one of other slips of a joint whose contact yields; None if it is not as good as it should be."""
    contact = contact_of(problem.windows)
    if contact is None or problem.normalised:
        return None
    solution = fit_again(problem.with_contact(contact), start, known)
    return solution if solution is not None and comes_to_rest(solution) else None


def comes_to_rest(solution: Solution) -> bool:
    """Whether joints on such a contact have come to rest before they slip again: they swing on it for a while."""
    problem, parameters = solution.problem, solution.fit.parameters
    swing = 2.0 * math.pi * math.sqrt(math.exp(float(parameters[INERTIA])) * problem.compliance(parameters))
    return float(np.median(problem.dwells[problem.noise.usable])) > _SETTLING_PERIODS * swing
