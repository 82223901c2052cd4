# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Where in the plane of speed and stiffness a joint sticks, swings or moves steadily, exactly and by the paper."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.dimensionless import dimensionless_groups, stiffness_of_lag, stiffness_scale
from stickslip_ros.model.exact import Progress, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.steady_sliding import sliding_damping_ratio

_VELOCITIES = (0.05, 5.0)  # range of speeds, Stribeck velocities
_STIFFNESSES = (0.01, 1.0)  # range of stiffnesses, of M (F_s∞/(M x˙_s))²: F*_s∞ is 10 and 1 there
_ROOM = 2.0  # factor by which the range reaches beyond the operating point, 1
_TOLERANCE = 0.01  # error of the exact damping, of it; Eq. (43) suffices within it


@dataclass(frozen=True, kw_only=True)
class ExtinctionMap:
    """Critical damping of a joint over speed and stiffness.

    Attributes
    ----------
    velocity : x˙_d [rad/s], shape (n,). stiffness : k_p [N·m/rad], shape (m,).
    paper_damping, exact_damping : total damping k_v + F_v [N·m·s/rad] at which stick-slip ends, by Eq. (43) and by
        integration (to 1 %), shape (m, n); 0 where it ends undamped, NaN where there is no answer, as Eq. (43) has none
        of another friction law than the paper's.
    steady_damping : from which on small disturbances of steady sliding decay, and stick-slip has ended; of that shape.
        In one of a hundred cases a large swing goes on beyond it: :mod:`stickslip_ros.model.outcome` knows.
    own_damping : of the joint at each stiffness, its viscous friction F_v less what an actuation delay takes off
        [N·m·s/rad], shape (m,).
    """

    velocity: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    paper_damping: NDArray[np.float64]
    exact_damping: NDArray[np.float64]
    steady_damping: NDArray[np.float64]
    own_damping: NDArray[np.float64]

    def total_damping(self, damping: float) -> NDArray[np.float64]:
        """k_v and the joint's own damping together [N·m·s/rad] at each stiffness, shape (m, 1)."""
        return damping + self.own_damping[:, None]

    def missing_damping(self, damping: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Damping that k_v lacks to end stick-slip, and to move steadily [N·m·s/rad], shape (m, n); below 0 it is more
        than enough, NaN where there is no answer.
        """
        total = self.total_damping(damping)
        return self.exact_damping - total, self.steady_damping - total

    def outcomes(self, damping: float) -> NDArray[np.int64]:
        """0 where the joint sticks, 1 where it swings, 2 where it moves steadily, 3 without an answer, shape (m, n)."""
        to_slide, to_be_steady = self.missing_damping(damping)
        return np.select([to_slide > 0, self.unknown, to_be_steady > 0], [0, 3, 1], 2)

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Where the integration gives no answer, shape (m, n)."""
        return np.asarray(np.isnan(self.exact_damping) | np.isnan(self.steady_damping))

    @property
    def conservative(self) -> float:
        """Share of the points at which the damping k_v that Eq. (43) asks for is enough, to the 1 %."""
        known = np.isfinite(self.paper_damping) & np.isfinite(self.exact_damping)
        least = np.broadcast_to(self.own_damping[:, None], known.shape)
        paper = np.maximum(self.paper_damping[known], least[known])
        enough = paper >= (1.0 - _TOLERANCE) * self.exact_damping[known]
        return float(enough.mean()) if known.any() else math.nan


def map_axes(
    joint: Joint, *, velocity: float | None = None, stiffnesses: Iterable[float] = (), points: int = 8000
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Logarithmic axes of velocity [rad/s] and stiffness [N·m/rad] with about so many points between them.

    They span what Stribeck friction does to the joint, and around the operating point's velocity and stiffnesses; of
    these, what is not positive has no place on the map.
    """
    own = float(stiffness_scale(joint))
    low, high = (share * own for share in _STIFFNESSES)
    high = min(high, float(stiffness_of_lag(joint)))
    low = min(low, 0.01 * high)
    slow, fast = (share * float(joint.friction.stribeck_velocity) for share in _VELOCITIES)
    if velocity:
        slow, fast = min(slow, abs(velocity) / _ROOM), max(fast, abs(velocity) * _ROOM)
    for stiffness in stiffnesses:
        if not stiffness > 0:
            continue
        low, high = min(low, stiffness / _ROOM), max(high, stiffness * _ROOM)
    columns = max(2, round(math.sqrt(0.8 * points)))
    return np.geomspace(slow, fast, columns), np.geomspace(low, high, max(2, round(points / columns)))


def extinction_map(
    joint: Joint,
    velocity: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> ExtinctionMap:
    """Compute the map; ``workers`` threads share the integrations, ``progress`` is told points done and of all.

    Raises
    ------
    InvalidParameterError
        If an axis holds a value that is not finite and > 0.
    """
    groups = dimensionless_groups(joint, Gains(stiffness=stiffness[:, None]), velocity[None, :])
    unit = 2.0 * np.asarray(groups.natural_frequency) * joint.inertia  # k_v + F_v of a damping ratio of 1
    exact = exact_critical_damping_ratio(groups, tolerance=_TOLERANCE, workers=workers, progress=progress)
    return ExtinctionMap(
        velocity=velocity,
        stiffness=stiffness,
        paper_damping=unit * np.asarray(critical_damping_ratio(groups)),
        exact_damping=unit * np.asarray(exact),
        steady_damping=unit * np.maximum(np.asarray(exact), np.asarray(sliding_damping_ratio(groups))),
        own_damping=np.broadcast_to(np.asarray(joint.own_damping(stiffness), dtype=float), stiffness.shape),
    )
