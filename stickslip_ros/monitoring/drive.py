# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stiffness and damping of a controller that nobody told, as the effort shows them in the slips.

Within a slip the effort of PD control is k_p (x_d − x) − k_v x˙ and a constant: a straight line over what the
fitted slip says of position and velocity, which unlike the encoder's have no noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.monitoring.friction.late_controller import LATE
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

# Slips that gains are estimated from, 1: at most, since somebody may have turned the gains after earlier ones.
_LATEST = 12
_LEAST = 3  # slips that gains are estimated from, 1: at least
_WEIGHT = 1.0 / 6.0  # weight of one more slip, 1: after a dozen nothing is left of gains that hold no more
_LARGEST_ERROR = 0.2  # standard error, of the stiffness: with more the effort does not fall with the position
_LEAST_NODES = 6  # nodes of a slip that gains are estimated from, 1: at least
_OF_MEDIAN = 1.2533  # standard error of a median, of that of a mean


@dataclass(frozen=True, kw_only=True)
class DriveGains:
    """Gains in force, in the units of the effort; they need not be those that the drive calls its gains.

    Attributes
    ----------
    stiffness, damping : k_p [N·m/rad] and k_v [N·m·s/rad]; the latter may be negative where the effort comes late, and
        the friction's viscous part is then too large by as much.
    stiffness_std, damping_std : standard errors.
    late_damping : standard deviation of what a late effort adds to the friction's viscous part and takes from k_v
        [N·m·s/rad]: k_p times a usual delay, or all of a k_v that is negative.
    """

    stiffness: float
    damping: float
    stiffness_std: float
    damping_std: float
    late_damping: float

    def followed_by(self, seen: FloatArray) -> DriveGains:
        """With one more slip, which showed k_p and k_v of shape (2,); NaN if it did not."""
        if not (np.isfinite(seen).all() and seen[0] > 0):
            return self
        return replace(
            self,
            stiffness=self.stiffness + _WEIGHT * (float(seen[0]) - self.stiffness),
            damping=self.damping + _WEIGHT * (float(seen[1]) - self.damping),
        )


def drive_gains(problem: SlipProblem, parameters: FloatArray, unknowns: FloatArray) -> DriveGains | None:
    """The gains that the latest slips show; None if the effort does not fall with the position as PD control has it.

    Parameters
    ----------
    problem : slips whose effort is known. parameters, unknowns : that fit them.
    """
    seen = gains_in_slips(problem, parameters, unknowns)
    seen = seen[problem.noise.usable & np.isfinite(seen).all(axis=1)][-_LATEST:]
    if len(seen) < _LEAST:
        return None
    stiffness, damping = np.median(seen, axis=0).tolist()
    errors = _OF_MEDIAN * np.std(seen, axis=0, ddof=1) / math.sqrt(len(seen))
    if not (stiffness > 0 and errors[0] <= _LARGEST_ERROR * stiffness):
        return None
    return DriveGains(
        stiffness=stiffness,
        damping=damping,
        stiffness_std=float(errors[0]),
        damping_std=float(errors[1]),
        late_damping=math.hypot(LATE * problem.data.sample_interval * stiffness, min(damping, 0.0)),
    )


def gains_in_slips(problem: SlipProblem, parameters: FloatArray, unknowns: FloatArray) -> FloatArray:
    """k_p and k_v that each slip shows by itself, shape (slips, 2); NaN where one shows nothing."""
    positions, velocities, _ = problem.simulate(parameters, unknowns)
    seen = np.full((problem.data.count, 2), math.nan)
    for number, window in enumerate(problem.data.windows):
        nodes = slice(problem.data.edges[number], problem.data.edges[number + 1])
        if len(window.times) < _LEAST_NODES:
            continue
        errors = _reference(window) - positions[nodes]
        slopes = np.stack([errors - errors.mean(), velocities[nodes].mean() - velocities[nodes]], axis=1)
        scales = np.abs(slopes).max(axis=0)
        if not (np.isfinite(slopes).all() and (scales > 0).all()):
            continue
        found, _, rank, _ = np.linalg.lstsq(slopes / scales, window.forces - window.forces.mean(), rcond=1e-6)
        if rank == 2:
            seen[number] = found / scales
    return seen


def _reference(window: SlipWindow) -> FloatArray:
    """The reference at the nodes, up to a constant [rad]: at a constant speed where it is not known."""
    if np.ptp(window.references) > 0:
        return window.references
    speed = window.reference_speed
    if not math.isfinite(speed):
        speed = window.slip_distance / (window.arrest - window.rest_begin)
    return np.asarray(speed * (window.times - window.times[0]))
