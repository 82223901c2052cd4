# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A controller that acts late, as every sampled one does: it holds its effort for a period, and sends it later still.

A delay τ of the force of the gains is, to the first order, damping of −k_p τ and inertia of −k_v τ. With one speed,
and gains that are the same throughout, viscous friction and inertia take it up: then viscous friction is told with
it, F_v − k_p τ, which is what counts for the margin, and the error of the inertia has it. Where it takes away more
damping than friction gives, no friction can take it up: there it is fitted. Where speeds differ it is one of the
:mod:`.optional_terms`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from stickslip_ros.monitoring.friction._window_kernel import VISCOUS
from stickslip_ros.monitoring.friction.fitted_law import FittedLaw, fitted_with_more

_NEXT_TO_NONE = math.log(3.0)  # above the least viscous friction that can be fitted: there may be less than none


def with_delay(first: FittedLaw, known: Mapping[int, tuple[float, float]]) -> FittedLaw:
    """The same law with a controller that acts late, where that explains the slips better (BIC); else as it was.

    Tried only where viscous friction next to none is found.

    Parameters
    ----------
    known : mean and standard deviation of parameters' logarithms, by index.
    """
    return fitted_with_more(first, first.problem.with_delay(), 1, known) if may_hide_a_delay(first) else first


def may_hide_a_delay(fitted: FittedLaw) -> bool:
    """Whether viscous friction next to none may be more, less a delay that is not fitted."""
    problem, solution = fitted.problem, fitted.solution
    viscous = float(solution.fit.parameters[VISCOUS])
    next_to_none = viscous <= solution.prior.lower[VISCOUS] + _NEXT_TO_NONE
    return problem.may_be_late and not problem.model.delay_shows and next_to_none
