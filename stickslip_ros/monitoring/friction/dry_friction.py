# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the dry friction of a joint depends on: direction, time, position and load, as its slips show it.

The kinetic friction of slip n, in its direction d, at the position x and the time t, is taken for

    F_n = F_k + d F_l + D (t − t₀) + A sin(2π (x − x₀)/P + φ) + e_n

with F_l a parabola over position where it varies, as an arm's weight does. Drift and ripple are claimed only if chance
would hardly show as much; of both the surer enters first, and each has to hold beside the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.regression import Regression, regression
from stickslip_ros.monitoring.friction.ripple import Ripple, find_ripple
from stickslip_ros.monitoring.friction.slip_fit import SlipFit
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import SlipWindow
from stickslip_ros.monitoring.samples import FloatArray

SIGNIFICANT = 0.005  # probability of chance, 1: with less a term is claimed
LEAST_SLIPS = 12  # slips, 1: fewer show no dependence of friction on time, place or load
LEAST_OF_A_DIRECTION = 3  # slips of a direction, 1: fewer show no friction of their own
_MOST_PLACES, _SLIPS_IN_A_PLACE = 12, 4  # places that the slips are divided into, 1: at most; slips in each, 1
# Parts of the time, 1; slips in each, of all slips: with fewer in one the slips do not span the time.
_PARTS, _LEAST_OF_A_PART = 3, 0.1
_TOGETHER = 0.95  # correlation of time and position, 1: with more they are not distinguished
# Columns of a load over position, 1: with four an arm's weight over a right angle is exact.
_PARABOLA, _MOST_BENDS = 2, 4
_ROUNDING = 1e-10  # scatter of the kinetic friction, of its largest value: less is rounding


@dataclass(frozen=True, kw_only=True)
class Term:
    """A value with its standard error, and the probability that it is zero and chance alone shows as much."""

    value: float
    std: float
    significance: float


@dataclass(frozen=True, kw_only=True)
class Place:
    """Slips in one direction that began near one position.

    Attributes
    ----------
    direction : ±1. position : mean [rad]. mean : of their kinetic friction [N·m], and its standard error ``std``, NaN
        if it is not known. slips : how many.
    """

    direction: int
    position: float
    mean: float
    std: float
    slips: int


@dataclass(frozen=True, kw_only=True)
class DryFriction:
    """What the kinetic friction depends on; None for what is not significant, or cannot be known.

    Attributes
    ----------
    coulomb : F_k, the mean of both directions [N·m], in the middle of the slips' time; in one direction with any load.
    load : F_l, half of what friction is higher by in positive direction [N·m], the mean over the slips' positions; None
        in one direction.
    drift : D [N·m/s]. distinguished : whether time and position are; else the drift may be a slope over position, of
        friction or of load.
    ripple : over position.
    load_dependence : slope of the Coulomb friction over the size of a load that varies with position [1].
    scatter : standard deviation of what is left, from slip to slip [N·m].
    places : friction over position, in order of direction and position.
    direction, position, time, kinetic : of the slips, shape (n,): ±1, [rad], [s], [N·m].
    load_curve : by how much the load departs from its mean over position, shape (2,) [N·m]; empty where it does not.
    """

    coulomb: Term
    load: Term | None
    drift: Term | None
    distinguished: bool = field(metadata={"key": "told_apart"})
    ripple: Ripple | None
    load_dependence: Term | None
    scatter: float
    places: tuple[Place, ...]
    direction: FloatArray
    position: FloatArray
    time: FloatArray
    kinetic: FloatArray
    load_curve: tuple[float, ...] = ()

    def load_at(self, position: FloatArray) -> FloatArray:
        """Load against the controller at positions [rad], shape (n,) [N·m]; beyond those of the slips as at their ends.

        Zero where the motion has but one direction.
        """
        mean = self.load.value if self.load is not None else 0.0
        within = np.clip(position, self.position.min(), self.position.max())
        return np.asarray(
            mean + _polynomial_basis(within, self.position)[:, : len(self.load_curve)] @ np.array(self.load_curve)
        )

    @property
    def middle(self) -> float:
        """Time at which the Coulomb friction is the one found [s]."""
        return float(self.time.mean())


def dry_friction(
    kinetic: FloatArray,
    direction: FloatArray,
    position: FloatArray,
    time: FloatArray,
    *,
    standard_error: float = 0.0,
) -> DryFriction | None:
    """What the kinetic friction of slips depends on; None if there are too few for a scatter.

    Parameters
    ----------
    kinetic : F_n, in the direction of each slip, shape (n,) [N·m]. direction : ±1. position : of the rest that the slip
        began from [rad]. time : of its breakaway, ascending [s].
    standard_error : that the kinetic friction of a slip has at least [N·m].
    """
    count = len(kinetic)
    if count < LEAST_OF_A_DIRECTION:
        return None
    # What rounding leaves of values that are all the same is nothing to explain.
    error = max(standard_error, _ROUNDING * float(np.abs(kinetic).max()))
    fewest = min(int((direction > 0).sum()), int((direction < 0).sum()))
    ones = np.ones((count, 1))
    base = np.column_stack([ones, direction]) if fewest >= LEAST_OF_A_DIRECTION else ones
    since = (time - time.mean())[:, None]
    varying = np.zeros((count, 0))
    drifts, ripple, bends = False, None, 0
    if count >= LEAST_SLIPS:
        varying = _varying_load(base, direction, since, kinetic, position, error)
        bends = varying.shape[1]
        if base.shape[1] > 1:
            varying = np.column_stack([varying, _size_of_load(base, varying, kinetic, error)])
        spanned = since if _spans(time) else None
        drifts, ripple = _chosen(np.column_stack([base, varying]), spanned, kinetic, position, error)
    known, size = np.column_stack([base, varying]), base.shape[1] + varying.shape[1]
    columns = np.column_stack([known, since]) if drifts else known
    all_columns = np.column_stack([columns, ripple.columns(position)]) if ripple else columns
    fit = regression(all_columns, kinetic, error)
    drift = _term(fit, size) if drifts else None
    return DryFriction(
        coulomb=_term(fit, 0),
        load=_term(fit, 1) if base.shape[1] > 1 else None,
        drift=drift,
        distinguished=_distinguished(base, since[:, 0], position),
        ripple=ripple,
        load_dependence=_term(fit, size - 1) if varying.shape[1] > bends else None,
        scatter=fit.scatter,
        places=_places(kinetic, direction, position, standard_error),
        direction=direction,
        position=position,
        time=time,
        kinetic=kinetic,
        load_curve=tuple(fit.coefficients[base.shape[1] : base.shape[1] + bends].tolist()),
    )


@dataclass(frozen=True, kw_only=True)
class PositionDisturbance:
    """Position-dependent disturbance of a joint: load and friction act on a slip like springs beside the controller's.

    Both are subtracted along the observed path, whatever the slip's length.

    Attributes
    ----------
    dry : load over position, slope of the Coulomb friction over the load, and ripple. without : what does not fit where
        the disturbance is not subtracted, for a person.
    """

    dry: DryFriction
    without: str

    def coulomb(self, position: FloatArray) -> FloatArray:
        """Position-dependent part of the Coulomb friction at positions [rad], shape (n,) [N·m]."""
        dry = self.dry
        slope = dry.load_dependence.value if dry.load_dependence is not None else 0.0
        varying = slope * np.abs(dry.load_at(position))
        return np.asarray(varying + dry.ripple.at(position) if dry.ripple is not None else varying)

    def kinetic(self, position: FloatArray, direction: int) -> FloatArray:
        """Position-dependent part of load and friction against motion in a direction, at positions [rad] [N·m]."""
        mean = self.dry.load.value if self.dry.load is not None else 0.0
        return np.asarray(direction * (self.dry.load_at(position) - mean) + self.coulomb(position))

    def subtracted_force(self, window: SlipWindow) -> float:
        """Force subtracted from the one that held the joint before a slip [N·m]."""
        return float(self.kinetic(np.array([window.rest_position]), window.direction)[0])

    def applied(self, window: SlipWindow) -> SlipWindow:
        """The slip with forces from which the disturbance is subtracted."""
        way = np.interp(window.times, window.times[window.observed], window.values, left=window.rest_position)
        return replace(window, forces=window.forces - window.direction * self.kinetic(way, window.direction))

    @property
    def with_load(self) -> bool:
        """Whether the covariate is the load alone."""
        return self.dry.ripple is None and bool(self.dry.load_curve)

    def covariate(self, position: FloatArray, *, decreasing: bool = False) -> FloatArray:
        """Regressor that scales friction, from -1 where friction is least to 0 where it is largest, shape (n,).

        The Coulomb friction that varies, or the size of the load where that varies alone; zeros where nothing does, and
        where motion in one direction does not show how large the load is.
        ``decreasing`` : friction is the largest where that is least.
        """
        places = np.append(position, self.dry.position)
        grows = self.coulomb(places)
        if self.dry.ripple is None and self.dry.load_dependence is None and self.dry.load is not None:
            grows = np.abs(self.dry.load_at(places))
        if decreasing:
            grows = -grows
        own = grows[len(position) :]
        extent = float(np.ptp(own))
        # What was not seen is not guessed: no friction is less or more than at the slips.
        return np.clip((grows[: len(position)] - own.max()) / extent, -1.0, 0.0) if extent > 0 else 0.0 * position


def dry_friction_of(problem: SlipProblem, fit: SlipFit) -> DryFriction | None:
    """What the kinetic friction of fitted slips depends on; those set aside do not count."""
    data = problem.data
    used = problem.noise.usable
    # No force is known better than the position that the spring rested at.
    errors = problem.stiffness(fit.parameters) * data.rest_errors
    return dry_friction(
        (fit.misfits + problem.balance @ fit.kinetic + problem.subtracted_force)[used],
        data.directions[used],
        data.rests[used],
        (data.breakaways + data.origin)[used],
        standard_error=float(np.median(errors[used])) if used.any() else 0.0,
    )


def _chosen(
    base: FloatArray, since: FloatArray | None, kinetic: FloatArray, position: FloatArray, standard_error: float
) -> tuple[bool, Ripple | None]:
    """Whether there is a drift, and the ripple: forward selection, then each beside the other."""

    def chance_of_drift(beside: FloatArray) -> float:
        if since is None:
            return 1.0
        fit = regression(np.column_stack([beside, since]), kinetic, standard_error)
        return fit.significance(beside.shape[1])

    def ripple_beside(known: FloatArray) -> Ripple | None:
        found = find_ripple(known, kinetic, position, standard_error)
        return found if found is not None and found.significance < SIGNIFICANT else None

    ripple, drift = ripple_beside(base), chance_of_drift(base)
    if ripple is not None and ripple.significance <= drift:
        drift = chance_of_drift(np.column_stack([base, ripple.columns(position)]))
    if drift >= SIGNIFICANT or since is None:
        return False, ripple
    ripple = ripple_beside(np.column_stack([base, since]))
    if ripple is not None:
        drift = chance_of_drift(np.column_stack([base, ripple.columns(position)]))
    return drift < SIGNIFICANT, ripple


def _term(fit: Regression, index: int) -> Term:
    return Term(value=float(fit.coefficients[index]), std=fit.std(index), significance=fit.significance(index))


def _spans(time: FloatArray) -> bool:
    """Whether slips are in every part of the time from the first to the last, not in two heaps at its ends."""
    counts = np.histogram(time, bins=_PARTS)[0]
    return bool(float(np.ptp(time)) > 0 and counts.min() >= _LEAST_OF_A_PART * len(time))


def _polynomial_basis(position: FloatArray, slips: FloatArray) -> FloatArray:
    """Columns of a polynomial over position whose mean over the slips' positions is zero, shape (n, 4)."""
    extent = max(float(np.ptp(slips)), TINY)
    place, own = (position - slips.mean()) / extent, (slips - slips.mean()) / extent
    return np.column_stack([place**power - float((own**power).mean()) for power in range(1, _MOST_BENDS + 1)])


def _loads(direction: FloatArray, position: FloatArray, bends: int = _PARABOLA) -> FloatArray:
    """Columns of a load that is a polynomial over position, shape (n, bends)."""
    return direction[:, None] * _polynomial_basis(position, position)[:, :bends]


def _varying_load(
    base: FloatArray,
    direction: FloatArray,
    since: FloatArray,
    kinetic: FloatArray,
    position: FloatArray,
    standard_error: float,
) -> FloatArray:
    """Columns of a load over position where it varies, as an arm's weight does; none where a drift explains more.

    There and back once, a load that varies and a drift are much alike. In one direction friction over position is
    taken for a load.
    """
    columns, size = _loads(direction, position), base.shape[1]
    varies = regression(np.column_stack([base, columns]), kinetic, standard_error)
    drifts = regression(np.column_stack([base, since]), kinetic, standard_error)
    # Two columns are tried; BIC.
    surely = min(varies.significance(size), varies.significance(size + 1)) < 0.5 * SIGNIFICANT
    worse = 2.0 * len(kinetic) * math.log(max(varies.scatter, TINY) / max(drifts.scatter, TINY))
    if not surely or worse + math.log(len(kinetic)) >= 2.0 * math.log(SIGNIFICANT):
        return columns[:, :0]
    more = _loads(direction, position, _MOST_BENDS)
    bent = regression(np.column_stack([base, more]), kinetic, standard_error)
    better = 2.0 * len(kinetic) * math.log(max(varies.scatter, TINY) / max(bent.scatter, TINY))
    return more if better > (_MOST_BENDS - _PARABOLA) * math.log(len(kinetic)) else columns


def _size_of_load(base: FloatArray, varying: FloatArray, kinetic: FloatArray, standard_error: float) -> FloatArray:
    """A column of the size of a load that varies, where Coulomb friction surely follows it; none else."""
    none = varying[:, :0]
    if not varying.shape[1]:
        return none
    columns = np.column_stack([base, varying])
    fit = regression(columns, kinetic, standard_error)
    load = np.abs(base[:, 1] * (columns[:, 1:] @ fit.coefficients[1:]))
    size = (load - load.mean())[:, None]
    follows = regression(np.column_stack([columns, size]), kinetic, standard_error)
    return size if follows.significance(columns.shape[1]) < SIGNIFICANT else none


def _distinguished(base: FloatArray, since: FloatArray, position: FloatArray) -> bool:
    """Whether time is told apart from position, and from a load over it."""
    place = (position - position.mean())[:, None]
    basis = np.linalg.svd(base, full_matrices=False)[0]
    others = np.column_stack([place, _loads(base[:, 1], position)]) if base.shape[1] > 1 else place
    others, own = others - basis @ (basis.T @ others), since - basis @ (basis.T @ since)
    explained = others @ np.linalg.lstsq(others, own, rcond=None)[0]
    return float(own @ own) > 0 and float(explained @ explained) < _TOGETHER**2 * float(own @ own)


def _places(
    kinetic: FloatArray, direction: FloatArray, position: FloatArray, standard_error: float
) -> tuple[Place, ...]:
    """Means over the slips of each place, by direction and position; places without slips are left out.

    There are as many places of one width as leave some slips to each.
    """
    number = min(max(len(position) // _SLIPS_IN_A_PLACE, 1), _MOST_PLACES)
    shares = (position - position.min()) / max(float(np.ptp(position)), TINY)
    numbers = np.minimum(number * shares, number - 1).astype(np.int64)
    found = []
    for way in (1, -1):
        for place in range(number):
            here = (numbers == place) & (direction == way)
            count = int(here.sum())
            if not count:
                continue
            scatter = max(float(kinetic[here].std(ddof=1)) if count > 1 else 0.0, standard_error)
            found.append(
                Place(
                    direction=way,
                    position=float(position[here].mean()),
                    mean=float(kinetic[here].mean()),
                    std=scatter / math.sqrt(count) if scatter > 0 else math.nan,
                    slips=count,
                )
            )
    return tuple(found)
