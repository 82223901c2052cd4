# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What becomes of a joint in the end, by integration of Eqs (4)-(6): it sticks, it swings, or it moves steadily.

The paper asks whether stick-slip dies out. A joint that does not stick may still swing about its speed for ever, and
what becomes of it may depend on how it began; a person calls smooth what moves steadily, however it began.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model import _outcome_kernel as kernel
from stickslip_ros.model._earlier_names import earlier_names
from stickslip_ros.model._friction_law import LAWS, stribeck_slope
from stickslip_ros.model.dimensionless import DimensionlessGroups, unwrapped
from stickslip_ros.model.exact import evaluate
from stickslip_ros.model.friction import Real
from stickslip_ros.model.steady_sliding import sliding_damping_ratio

_TOLERANCE = 2e-3  # error of a damping ratio, of it
_ROOM = 1.02  # factor on the least damping ratio at which a steady slide is stable, 1: the search begins there
_SPEEDS = np.geomspace(0.1, 10.0, 400)  # speeds, Stribeck velocities: friction falls fastest at one of them


class Outcome(str, Enum):
    """What becomes of a joint, the worst last."""

    STEADY = "steady"
    SWINGS = "swings"
    STICKS = "sticks"


# By number of the kernel; None where it cannot be decided in bounded work.
_OUTCOMES = {
    kernel.STEADY: Outcome.STEADY,
    kernel.SWINGS: Outcome.SWINGS,
    kernel.STICKS: Outcome.STICKS,
    kernel.UNDECIDED: None,
}
ORDER = [Outcome.STEADY, Outcome.SWINGS, None, Outcome.STICKS]


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """What becomes of each point by where it starts, with full static friction.

    Attributes
    ----------
    groups : the points. numbers : of the kernel, of the groups' common shape + (starts,).
    """

    groups: DimensionlessGroups
    numbers: NDArray[np.float64]

    @property
    def steady(self) -> NDArray[np.bool_]:
        """Whether each point moves steadily in the end, from every start."""
        return np.asarray(np.all(self.numbers == kernel.STEADY, axis=-1))

    @property
    def sticks(self) -> NDArray[np.bool_]:
        """Whether stick-slip goes on from any start at each point; False where that is not decided."""
        return np.asarray(np.any(self.numbers == kernel.STICKS, axis=-1))

    @property
    def stuck(self) -> Outcome | None:
        """Of one joint (scalars) that breaks away; None where that cannot be decided."""
        return _OUTCOMES[int(self.numbers[..., 0].item())]

    @property
    def sliding(self) -> Outcome | None:
        """Of one joint, the worst of those that begin at twice and at three times the speed; None likewise."""
        return _OUTCOMES[int(self.numbers[..., 1].item())]

    @property
    def disturbances_decay(self) -> bool:
        """Whether one joint is steady if it begins close enough to the speed."""
        return bool(self.groups.damping_ratio > sliding_damping_ratio(self.groups))

    @property
    def worst(self) -> Outcome | None:
        """Of one joint, the one that counts; None if it is not decided whether the other one is as bad."""
        return max(self.stuck, self.sliding, key=ORDER.index)

    @property
    def depends_on_start(self) -> bool:
        """Whether the outcome of one joint is another one from another start."""
        same = self.worst is Outcome.STEADY or not self.disturbances_decay
        return self.stuck is not self.sliding or not same


def outcomes(groups: DimensionlessGroups) -> Outcomes:
    """What becomes of each point: a millisecond; close to a boundary tens, with a long lag hundreds of them.

    ``STEADY`` keeps within 10 % of the commanded speed in the end; ``SWINGS`` does not, and does not stop.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.simulation.simulate_cycles`.
    """
    return Outcomes(groups=groups, numbers=evaluate(kernel.OUTCOME, groups))


def steady_damping_ratio(groups: DimensionlessGroups) -> Real:
    """Damping ratio ρ_steady from which on the joint moves steadily from every start, the other groups as they are.

    Where friction falls with speed at a slope of at most L everywhere, no swing without a stop outlasts a damping ratio
    of ½ L: the work ∮ f ẋ of a swing is at most L ∮ ẋ², that of damping 2ρ ∮ ẋ², whatever the lag. The search begins
    there and goes down, so that it finds the highest boundary if there are several.

    Parameters
    ----------
    groups : scalars or arrays that broadcast; the damping ratio is not used.

    Returns
    -------
    0 where a damping ratio of 0.01 is enough, NaN where even 20 is not or the integration is refused; of the groups'
    common shape.

    Raises
    ------
    InvalidParameterError
        As :func:`stickslip_ros.model.simulation.simulate_cycles`.
    """
    steepest = -float(np.min(stribeck_slope(LAWS[groups.law], 1.0, _SPEEDS)))
    guesses = 0.5 * steepest * np.asarray(groups.stribeck, dtype=float) * _ROOM
    return unwrapped(evaluate(kernel.STEADY_RATIO, groups.undamped, guesses, _TOLERANCE)[..., 0])


if not TYPE_CHECKING:
    __getattr__ = earlier_names(
        __name__,
        {
            "is_steady": ("outcomes(…).steady", lambda groups: outcomes(groups).steady),
            "ever_sticks": ("outcomes(…).sticks", lambda groups: outcomes(groups).sticks),
        },
    )
