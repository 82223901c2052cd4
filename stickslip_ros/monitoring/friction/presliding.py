# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How a joint at rest gives way: the stiffness σ₀ of its contact, from the creep while the force on it rises.

While a joint stands, the controller's force on it changes, and a contact that is not rigid follows. An elastic one
moves by ``x = x₀ + τ/σ₀``; one that yields ever more as it nears its limit F, as LuGre's does, by
``x = x₀ − (F/σ₀) ln(1 − τ/F)``. Between them lies ``−φ (F/σ₀) ln(1 − τ/(φF))``, with φ = 1 for the one and φ → ∞ for
the other. Each rest gives a slope of position over that, and the rests together the best φ and its errors, from their
scatter. Where the force rises only one way, all φ fit alike, and σ₀ is uncertain by as much: reversals decide.

What moves is what the encoder sees: a gear that winds up between encoder and contact is part of σ₀.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model._friction_law import ELASTO_PLASTIC, LUGRE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.rests import Rest
from stickslip_ros.monitoring.friction.estimate import IDENTIFIED, ParameterEstimate
from stickslip_ros.monitoring.friction.yielding_contact import LEAST_RESTS
from stickslip_ros.monitoring.samples import ROUNDING_STD, Batch, FloatArray, SampleBuffer, effort_is_measured

_KEPT = 100  # latest rests that are kept, 1
# Times at both ends of a dwell in which the joint swings to rest or speeds up, of the dwell.
_SETTLED, _LEAVING = 0.15, 0.05
_BELOW_LIMIT = 0.65  # force, of its limit: nearer to it a contact that yields needs a limit better known than it is
_OTHER_SIDE, _MOSTLY = 0.3, 0.5  # force on the other side, of its limit; information of the rests that turn, of all
_BINS, _LEAST_BINS = 32, 6  # bins of a rest, 1; bins with a sample that it must have, 1
_YIELDING = np.array([math.inf, 3.0, 1.5, 1.2, 1.1, 1.05, 1.02])  # φ that are tried, 1
_ELASTIC, _YIELDS = 1.5, 1.2  # φ, 1: with more the contact is elastic; with less it is LuGre's
_EXCLUDED = 3.0  # misfit, standard errors: with more a curve of yielding is excluded
_SHOWN = 3.0  # compliance, standard errors: with less creep may be an accident of counts
_BOUND = 2.0  # bound of a compliance, standard errors; of what a count hides, counts
_BESIDE = 0.2  # change of the effort beside the force's, of that: with more a force is not known


@dataclass(frozen=True, kw_only=True)
class PreslidingEstimate:
    """What the rests say of a joint's contact.

    Attributes
    ----------
    stiffness : σ₀ [N·m/rad], as of :class:`~stickslip_ros.model.friction.Friction`; infinite where no creep shows.
    at_least : lower bound of it at 97.5 % [N·m/rad].
    contact : "elasto_plastic" or "lugre", or "" where the rests do not tell them apart.
    rests : how many it was learnt from.
    """

    stiffness: ParameterEstimate
    at_least: float
    contact: str
    rests: int

    @property
    def shown(self) -> bool:
        """Whether the joint was seen to creep."""
        return math.isfinite(self.stiffness.value)


@dataclass(frozen=True)
class _Slopes:
    """One rest; by φ, shape (7,): mean squares of what the creep goes with, of both together, and of the creep.

    ``turns`` : whether the force began far on the other side.
    """

    driving: FloatArray
    both: FloatArray
    creep: float
    resolution: float
    turns: bool


class PreslidingMeter:
    """Learns σ₀ rest by rest, from the latest ones; ``estimate`` : what they say together, None of too few."""

    def __init__(self) -> None:
        self._rests: deque[_Slopes] = deque(maxlen=_KEPT)
        self._last: tuple[Rest, Gains | None] | None = None
        self.estimate: PreslidingEstimate | None = None

    def forget(self) -> None:
        """Forget all that was seen."""
        self._rests.clear()
        self.estimate = None
        self.break_off()

    def break_off(self) -> None:
        """What follows has nothing to do with what was before."""
        self._last = None

    def add_rest(self, rest: Rest, samples: SampleBuffer, gains: Gains | None, resolution: float) -> None:
        """Take a rest that is known in full, and learn from the one before: by now its limit was seen.

        Parameters
        ----------
        gains : in force throughout, None if unknown. resolution : of the position [rad].
        """
        last, self._last = self._last, (rest, gains)
        if last is None or last[0].direction_before == 0:
            return
        before, in_force = last
        end = min(rest.arrest, before.breakaway + before.dwell)
        seen = samples.between(before.arrest + _SETTLED * before.dwell, end)
        if seen is None or len(seen) < _LEAST_BINS:
            return
        found = _slopes(seen, before, in_force, resolution)
        if found is not None:
            self._rests.append(found)
            self.estimate = _together(list(self._rests))


def _slopes(seen: Batch, rest: Rest, gains: Gains | None, resolution: float) -> _Slopes | None:
    resting = int(np.searchsorted(seen.time, rest.breakaway))
    width = max(1.0, resting / _BINS)
    edges = np.unique(np.arange(0.0, len(seen), width).astype(int))
    counts = np.diff(np.append(edges, len(seen)))

    def binned(values: FloatArray) -> FloatArray:
        return np.asarray(np.add.reduceat(values, edges) / counts)

    times, positions, efforts = binned(seen.time), binned(seen.position), binned(seen.effort)
    references, speeds = binned(seen.reference_position), binned(seen.reference_velocity)
    force = efforts
    if gains is not None and gains.integral == 0 and np.isfinite(references).all():
        if not np.isfinite(speeds).all():
            speeds = np.gradient(references, times)
        force = float(gains.stiffness) * (references - positions) + float(gains.damping) * speeds
        if effort_is_measured(efforts) and np.ptp(efforts - force) > _BESIDE * np.ptp(force):
            return None
    elif not effort_is_measured(efforts):
        return None
    direction = rest.direction_after
    force, creep = direction * force, direction * (positions - positions[0])
    limit = float(force.max())
    # From where the force rises: before that it may have fallen, and a contact that yields goes another way back.
    stands = times <= rest.breakaway - _LEAVING * rest.dwell
    rises = np.arange(len(force)) >= int(np.argmin(np.where(stands, force, math.inf)))
    chosen = rises & stands & (force < _BELOW_LIMIT * limit)
    if limit <= 0.0 or np.count_nonzero(chosen) < _LEAST_BINS:
        return None
    force, creep = force[chosen], creep[chosen]
    most = _YIELDING[1:, None] * limit
    driving = np.vstack([force, -most * np.log1p(-force / most)])
    driving -= driving.mean(axis=1, keepdims=True)
    creep = creep - creep.mean()
    size = len(creep)
    return _Slopes(
        driving=np.einsum("ij,ij->i", driving, driving) / size,
        both=driving @ creep / size,
        creep=float(creep @ creep) / size,
        resolution=resolution,
        turns=bool(force[0] < -_OTHER_SIDE * limit),
    )


def _together(rests: list[_Slopes]) -> PreslidingEstimate | None:
    if len(rests) < LEAST_RESTS:
        return None
    driving, both = np.array([one.driving for one in rests]), np.array([one.both for one in rests])
    total = driving.sum(axis=0)
    if not (total > 0.0).all():
        return None
    compliances = both.sum(axis=0) / total
    best, admitted = _yielding(rests, driving, both, compliances)
    compliance = float(compliances[best])
    off = both[:, best] - compliance * driving[:, best]
    scatter = math.sqrt(float(off @ off) * len(rests) / (len(rests) - 1)) / float(total[best])
    count = ROUNDING_STD * max(one.resolution for one in rests)
    accident = math.hypot(scatter, count / math.sqrt(float(total[best])))
    error = math.hypot(accident, float(np.abs(compliances[admitted] - compliance).max()))
    most = max(compliance, 0.0) + _BOUND * error
    if compliance <= _SHOWN * accident:
        # Within a count a joint seems rigid, maybe at every rest alike.
        most += _BOUND * count / math.sqrt(float(driving[:, best].max()))
        return PreslidingEstimate(
            stiffness=ParameterEstimate(value=math.inf, std=math.nan, identified=False),
            at_least=1.0 / most if most > 0.0 else math.inf,
            contact="",
            rests=len(rests),
        )
    yielding = _YIELDING[admitted]
    contact = ELASTO_PLASTIC if yielding.min() >= _ELASTIC else LUGRE if yielding.max() <= _YIELDS else ""
    identified = bool(contact) and error <= IDENTIFIED * compliance
    return PreslidingEstimate(
        stiffness=ParameterEstimate(value=1.0 / compliance, std=error / compliance**2, identified=identified),
        at_least=1.0 / most,
        contact=contact,
        rests=len(rests),
    )


def _yielding(
    rests: list[_Slopes], driving: FloatArray, both: FloatArray, compliances: FloatArray
) -> tuple[int, NDArray[np.bool_]]:
    """Index of the φ that leaves the least of the creep unexplained, and which of them the rests do not exclude."""
    left = np.array([one.creep for one in rests])[:, None] - compliances * (2.0 * both - compliances * driving)
    best = int(np.argmin(left.sum(axis=0)))
    worse = left - left[:, [best]]
    scatter = np.sqrt(len(rests)) * worse.std(axis=0, ddof=1)
    admitted = np.asarray(worse.sum(axis=0) <= _EXCLUDED * scatter)
    if best:
        # The limit that the contact yields towards is not known as well as the grid is fine: it rises in the rest.
        admitted[max(best - 1, 1) : best + 2] = True
    turns = np.array([one.turns for one in rests])
    if driving[turns, best].sum() < _MOSTLY * driving[:, best].sum():
        # One way, a rising limit looks like another way to yield.
        admitted[:] = True
    return best, admitted
