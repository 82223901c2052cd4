# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The search behind advice: the least change of gains within the bounds, and what is in the way if there is none.

At each stiffness a joint needs some least damping, and every bound is an interval of damping; so the unknown is one
number over the stiffness. It is evaluated on a grid around the present stiffness, then on finer ones around the best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import nearest_to_zero
from stickslip_ros.model.bounds import TINY
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Bound, ObservedLoop, bounds_at
from stickslip_ros.monitoring.advice.requirement import Requirement, SteadySliding
from stickslip_ros.monitoring.samples import FloatArray

_REACH = 1e4  # factor on the present stiffness, up or down, that is searched
_LEARNT_REACH = 100.0  # factor on the present gains: learnt friction is not known so far from where it was seen
_NO_DAMPING = 0.01  # damping ratio that counts as none
# Cost of a change of the stiffness, in units of that of the same factor on the damping. Noise, resonances and torque
# bound a drive's stiffness. Where both cost the same, the best stiffness depends on how the least damping falls with
# the stiffness, which no recording shows well: in 20 joints of six recordings each it varied by up to 40 %.
_STIFFNESS_COST = 3.0
# Grid of logarithms of the stiffness, x = scale · sinh(step · i): 0.03 apart at the present stiffness, and far from it
# 4 % of the change.
_SCALE, _STEP = 0.75, 0.04
_FINER, _REFINEMENTS = 9, 2  # points between the neighbours of the best one, and how often
_COARSER, _COARSE = 4, 30  # what is in the way is seen at every fourth point, and at so many that bounds allow
_AT_ONCE = 16  # points, before the best change known bounds the rest
_SLACK = 1e-6  # of a change, so that rounding does not lose the best one known
_EDGES = 2001  # stiffnesses at which bounds alone are compared
_BISECTIONS = 16  # of a stiffness between two points of the grid
_INSIDE = 1e-12  # of a logarithm, by which the end of a range is inside
Condition = Requirement | SteadySliding
_LEARNT = "what was learnt of the friction"


@dataclass(frozen=True, kw_only=True)
class Obstruction:
    """Why no gains are found.

    Attributes
    ----------
    bounds : names of the bounds in the way: without any one of them, or if ``together`` without all of them, there
        would be gains.
    text : the same for a person.
    best : the gains within bounds with the largest margin, None if the bounds leave none at all.
    reserve : ρ/ρ_c − 1 of these, at the confidence asked for.
    """

    bounds: tuple[str, ...]
    together: bool
    text: str
    best: Gains | None
    reserve: float


class AdviceSearch:
    """One joint with its present gains, bounds and requirements.

    A place below is the logarithm of the stiffness over the present one.

    Parameters
    ----------
    joint, gains : scalars. learnt : whether the joint was learnt from the motion.
    requirements : each of them is to be satisfied.
    factors : factors on the total damping that the requirements ask for, by the place at which each was found;
        interpolated between.
    known : total damping that the same requirements ask for [N·m·s/rad], by place; added to.
    """

    def __init__(
        self,
        joint: Joint,
        gains: Gains,
        limits: AdviceLimits,
        loop: ObservedLoop,
        requirements: Sequence[Condition],
        *,
        learnt: bool,
        factors: Mapping[float, float] | None = None,
        known: dict[float, float] | None = None,
    ) -> None:
        self._joint, self._gains, self._limits, self._loop = joint, gains, limits, loop
        self._learnt, self._factors = learnt, dict(factors or {})
        self._requirements = sorted(requirements, key=lambda one: one.exact)
        self._floor = float(damping_floor(joint, gains.stiffness))
        self._before = max(float(joint.total_damping(gains)), self._floor)
        self._reach = math.log(_LEARNT_REACH if learnt else _REACH)
        self._domain = self._allowed_domain()
        self._known = {} if known is None else known

    def with_requirement(self, requirement: Condition) -> AdviceSearch:
        """The same search with one requirement more, and no factors."""
        return AdviceSearch(
            self._joint, self._gains, self._limits, self._loop, [*self._requirements, requirement], learnt=self._learnt
        )

    def with_factors(self, factors: Mapping[float, float]) -> AdviceSearch:
        """The same search with other factors."""
        return AdviceSearch(
            self._joint, self._gains, self._limits, self._loop, self._requirements,
            learnt=self._learnt, factors=factors, known=self._known,
        )  # fmt: skip

    def place(self, gains: Gains) -> float:
        """Logarithm of the gains' stiffness over the present one."""
        return math.log(float(gains.stiffness) / float(self._gains.stiffness))

    def total_damping(self, stiffness: float) -> float:
        """The total damping at a stiffness that factors multiply [N·m·s/rad]."""
        here = np.array([math.log(stiffness / float(self._gains.stiffness))])
        return float(np.maximum(self._required(here), damping_floor(self._joint, stiffness))[0])

    @staticmethod
    def change(joint: Joint, present: Gains, gains: Gains) -> float:
        """Size of a change of gains; defined in :mod:`stickslip_ros.monitoring.advice.recommend`."""
        floor = float(damping_floor(joint, present.stiffness))
        before, after = (max(float(joint.total_damping(each)), floor) for each in (present, gains))
        stiffness = math.log(float(gains.stiffness) / float(present.stiffness))
        return math.hypot(_STIFFNESS_COST * stiffness, math.log(after / before))

    def reaches_margin(self, gains: Gains) -> bool:
        """Whether gains reach the wanted margin, whatever the bounds."""
        return bool(self._satisfied(np.array([self.place(gains)]), np.array([float(gains.damping)]))[0])

    def within_bounds(self, gains: Gains) -> bool:
        """Whether gains are within the bounds."""
        least, largest = self._damping_interval(np.array([self.place(gains)]))
        return bool(least[0] <= float(gains.damping) <= largest[0])

    def damping_only(self) -> Gains | None:
        """The damping nearest to the present one, at the present stiffness."""
        return self._nearest(np.zeros(1))[0]

    def stiffness_only(self) -> Gains | None:
        """The stiffness nearest to the present one, with the present damping."""
        present = float(self._gains.damping)

        def allowed(places: FloatArray) -> NDArray[np.bool_]:
            least, largest = self._damping_interval(places)
            found = (least <= present) & (present <= largest)
            found[found] = self._satisfied(places[found], np.full(int(found.sum()), present)) if found.any() else False
            return np.asarray(found)

        nearest = nearest_to_zero(allowed, self._places(self._reach), _BISECTIONS)
        return None if nearest is None else self._as_gains(nearest, present)

    def least_change(self) -> Gains | None:
        """The gains nearest to the present ones."""
        found, _, cost = self._nearest(np.zeros(1))
        # No stiffness further away than the best change known can be better.
        places = self._places(min(self._reach, cost / _STIFFNESS_COST))
        for _ in range(1 + _REFINEMENTS):
            better, best, cost = self._nearest(places, cost)
            if better is None:
                break
            found = better
            places = np.linspace(places[max(best - 1, 0)], places[min(best + 1, len(places) - 1)], _FINER)
        return found

    def obstruction(self) -> Obstruction:
        """What is in the way, and the best within reach."""
        # Over all stiffnesses, since any of the bounds may be left out; and at those where the others begin and end.
        allowed = self._places(self._reach)
        allowed = allowed[np.linspace(0, len(allowed) - 1, min(len(allowed), _COARSE)).astype(int)]
        places = np.union1d(self._grid(-self._reach, self._reach)[::_COARSER], allowed)
        bounds, needed = self._bounds(places), self._needed(places)
        texts = {name: f"{name} ({bound.text})" for name, bound in bounds.items()}
        names, together = _blocking_bounds(bounds, lambda least, largest: _any_feasible(least, largest, needed))
        if together:
            text = "these limits together exclude them: " + " and ".join(texts[name] for name in names)
        elif names:
            text = ", or ".join(texts[name] for name in names)
            text = f"the limit {text} excludes them" if len(names) == 1 else f"relax one of these limits: {text}"
        else:
            text = "no stiffness and damping do, whatever the limits"
        best, reserve = self._best(places, bounds, needed)
        return Obstruction(bounds=names, together=together, text=text, best=best, reserve=reserve)

    def bounds_blocking_damping(self) -> tuple[str, ...]:
        """Names of the bounds without which damping alone would do."""
        here = np.zeros(1)
        needed = self._needed(here)
        return _blocking_bounds(self._bounds(here), lambda least, largest: _any_feasible(least, largest, needed))[0]

    def bounds_blocking_stiffness(self) -> tuple[str, ...]:
        """Names of the bounds without which stiffness alone would do."""
        places = self._grid(-self._reach, self._reach)
        damping = np.full(places.shape, float(self._gains.damping))
        reached = self._satisfied(places, damping)
        return _blocking_bounds(
            self._bounds(places),
            lambda least, largest: bool(np.any(reached & (least <= damping) & (damping <= largest))),
        )[0]

    def _best(self, places: FloatArray, bounds: dict[str, Bound], needed: FloatArray) -> tuple[Gains | None, float]:
        least, largest = _intersection(list(bounds.values()), places.shape)
        inside = (least <= largest) & np.isfinite(needed) & np.isfinite(largest)
        if not inside.any():
            return None, math.nan
        wanted, own = 1.0 + self._limits.wanted_margin, self._own(places)
        with np.errstate(all="ignore"):
            reserve = wanted * (largest + own) / np.maximum(needed + own, TINY) - 1.0
        index = int(np.argmax(np.where(inside, reserve, -math.inf)))
        return self._as_gains(float(places[index]), float(largest[index])), float(reserve[index])

    def _grid(self, low: float, high: float) -> FloatArray:
        """Places of the grid from a low to a high one."""
        first, last = (math.asinh(edge / _SCALE) / _STEP for edge in (low, high))
        return np.asarray(_SCALE * np.sinh(_STEP * np.arange(math.ceil(first), math.floor(last) + 1)))

    def _places(self, reach: float) -> FloatArray:
        """Places no further away than ``reach``, where bounds allow any damping: of the grid, and the ends."""
        low, high = max(self._domain[0], -reach), min(self._domain[1], reach)
        return np.union1d(self._grid(low, high), [low, high]) if low <= high else np.array([])

    def _allowed_domain(self) -> tuple[float, float]:
        """The least and the largest place at which bounds allow any damping."""
        coarse = np.linspace(-self._reach, self._reach, _EDGES)
        # The best often lies where the allowed stiffnesses begin or end.
        present = math.log(float(self._gains.stiffness))
        edges = [math.log(edge) - present for edge in self._limits.stiffness_range if 0 < edge < math.inf]
        inward = [edge + side for edge in edges for side in (-_INSIDE, _INSIDE)]
        within = [edge for edge in inward if abs(edge) <= self._reach]
        coarse = np.sort(np.concatenate([coarse, within]))
        least, largest = self._damping_interval(coarse)
        allowed = coarse[least <= largest]
        return (float(allowed[0]), float(allowed[-1])) if len(allowed) else (math.inf, -math.inf)

    def _stiffness(self, places: FloatArray) -> FloatArray:
        return np.asarray(float(self._gains.stiffness) * np.exp(places))

    def _own(self, places: FloatArray) -> FloatArray:
        """The joint's own damping [N·m·s/rad]."""
        return np.broadcast_to(self._joint.own_damping(self._stiffness(places)), places.shape)

    def _required(self, places: FloatArray) -> FloatArray:
        """Total damping that the requirements ask for [N·m·s/rad], evaluated once at each place."""
        missing = np.array([place for place in places.tolist() if place not in self._known])
        if len(missing) > 0:
            stiffness, own = self._stiffness(missing), self._own(missing)
            damping = -own
            for one in self._requirements:
                # Where what is quick to evaluate is enough for the exact condition, no more is needed.
                more = ~one.reached(stiffness, damping) if one.exact else np.ones(stiffness.shape, dtype=np.bool_)
                if more.any():
                    damping[more] = np.maximum(damping[more], one.damping(stiffness[more]))
            self._known.update(zip(missing.tolist(), (damping + own).tolist(), strict=True))
        return np.array([self._known[place] for place in places.tolist()])

    def _factor_at(self, places: FloatArray) -> FloatArray | float:
        known = sorted(self._factors)
        return np.interp(places, known, [self._factors[place] for place in known]) if known else 1.0

    def _needed(self, places: FloatArray) -> FloatArray:
        """Least damping k_v, with the factors [N·m·s/rad]."""
        total = self._required(places)
        if self._factors:
            # Of no damping there is no multiple.
            total = np.maximum(total, damping_floor(self._joint, self._stiffness(places))) * self._factor_at(places)
        return np.asarray(total - self._own(places))

    def _bounds(self, places: FloatArray) -> dict[str, Bound]:
        bounds = bounds_at(self._stiffness(places), self._joint, self._gains, self._limits, self._loop)
        if self._learnt:
            bounds[_LEARNT] = Bound(
                text=f"not valid for gains more than {_LEARNT_REACH:g} times the present ones",
                least=np.full(places.shape, -math.inf),
                largest=_LEARNT_REACH * self._before - self._own(places),
            )
        return bounds

    def _damping_interval(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _intersection(list(self._bounds(places).values()), places.shape)

    def _satisfied(self, places: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        stiffness, own = self._stiffness(places), self._own(places)
        total = (damping + own) / self._factor_at(places)
        reached = np.ones(places.shape, dtype=np.bool_)
        if self._factors:
            reached &= total >= damping_floor(self._joint, stiffness)
        for one in self._requirements:
            reached[reached] = one.reached(stiffness[reached], (total - own)[reached]) if reached.any() else False
        return reached

    def _nearest(self, places: FloatArray, cost: float = math.inf) -> tuple[Gains | None, int, float]:
        """The gains at these places that change the present ones least, the index of their place, and the change.

        None if all cost more than ``cost``, or bounds leave none.
        """
        found: tuple[Gains | None, int, float] = None, 0, cost
        order = np.argsort(np.abs(places))
        for part in np.array_split(order, max(1, len(order) // _AT_ONCE)):
            here, least, largest = self._promising(places[part], found[2])
            lowest = np.maximum(least, self._needed(here))
            damping = np.clip(float(self._gains.damping), lowest, np.maximum(lowest, largest))
            with np.errstate(all="ignore"):
                change = np.log(np.maximum(damping + self._own(here), self._floor) / self._before)
            costs = np.where(lowest <= largest, np.hypot(_STIFFNESS_COST * here, change), math.inf)
            best = int(np.argmin(costs)) if len(costs) else 0
            if len(costs) and costs[best] < math.inf and costs[best] <= found[2]:
                index = int(part[np.flatnonzero(places[part] == here[best])[0]])
                found = self._as_gains(float(here[best]), float(damping[best])), index, float(costs[best])
        return found

    def _promising(self, places: FloatArray, cost: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Places at which gains may cost as little, and the bounds of the damping there.

        Whether given gains reach the margin is evaluated in a tenth of the time that the least damping takes.
        """
        least, largest = self._damping_interval(places)
        with np.errstate(all="ignore"):
            room = np.sqrt((cost * (1.0 + _SLACK)) ** 2 - (_STIFFNESS_COST * places) ** 2)
            useful = np.fmin(largest, self._before * np.exp(room) - self._own(places))
            possible = (least <= useful) & ~np.isnan(room)
        unknown = possible & np.isfinite(useful) & ~np.isin(places, list(self._known))
        if unknown.any():
            possible[unknown] = self._satisfied(places[unknown], useful[unknown])
        return places[possible], least[possible], largest[possible]

    def _as_gains(self, place: float, damping: float) -> Gains:
        same = place == 0.0
        stiffness = self._gains.stiffness if same else float(self._gains.stiffness) * math.exp(place)
        return Gains(stiffness=stiffness, damping=float(damping))


def damping_floor(joint: Joint, stiffness: Real) -> Real:
    """Total damping at a stiffness [N·m/rad] below which there is none to speak of [N·m·s/rad]."""
    return np.asarray(2.0 * _NO_DAMPING * np.sqrt(np.asarray(stiffness) * float(joint.inertia)))


def _intersection(bounds: list[Bound], shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    least, largest = np.full(shape, -math.inf), np.full(shape, math.inf)
    for bound in bounds:
        least, largest = np.maximum(least, bound.least), np.minimum(largest, bound.largest)
    return least, largest


def _any_feasible(least: FloatArray, largest: FloatArray, needed: FloatArray) -> bool:
    """Whether bounds leave enough damping at any stiffness."""
    least = np.maximum(least, needed)
    return bool(np.any((least <= largest) & np.isfinite(least)))


def _blocking_bounds(
    bounds: dict[str, Bound], feasible: Callable[[FloatArray, FloatArray], bool]
) -> tuple[tuple[str, ...], bool]:
    """Bounds any one of which is in the way, or the fewest that are together, and whether they are together."""
    shape = next(iter(bounds.values())).least.shape

    def feasible_without(left_out: tuple[str, ...]) -> bool:
        return feasible(*_intersection([bound for name, bound in bounds.items() if name not in left_out], shape))

    names = tuple(name for name in bounds if feasible_without((name,)))
    if names:
        return names, False
    sets = [several for size in range(2, len(bounds) + 1) for several in combinations(bounds, size)]
    together = next((several for several in sets if feasible_without(several)), ())
    return together, bool(together)
