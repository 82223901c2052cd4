# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The search behind advice: the least change of gains within the bounds, and what is in the way if there is none.

At each stiffness a joint needs some least damping, and every bound is an interval of damping; so the search is over
one variable. What a stiffness costs in damping is not convex in it: a grid comes first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bisection import bisected
from stickslip_ros.model.friction import Gains, Joint, Real
from stickslip_ros.monitoring.advice.limits import AdviceLimits, Bound, ObservedLoop, bounds_at
from stickslip_ros.monitoring.advice.requirement import InterpolatedRequirement, Requirement, SteadySliding
from stickslip_ros.monitoring.samples import FloatArray

# Ranges of the search, as factors on the present stiffness, either way.
_REACH = 1e4  # configured friction: beyond any change that somebody would make
_LEARNT_REACH = 100.0  # learnt friction, and its damping: the estimate says little of gains that differ more
_NO_DAMPING = 0.01  # damping ratio that counts as none: such a joint rings for tens of periods
# Cost of a change of the stiffness, by its logarithm [1].
_LINEAR_CHANGE = math.log(2.0)  # from which on it costs more: see _stiffness_cost
_COST_BEYOND = 3.0  # cost of a change beyond, relative to that below
# Grids of the logarithm of the stiffness [1].
_POINTS, _SPACING = 101, 0.04  # least number of points, largest distance: valleys of the cost are wider
_DOMAIN_POINTS = 2001  # on which the bounds alone are evaluated, which costs little
_EXACT_POINTS = 60  # at which an exact requirement is evaluated to name the bounds in the way: a second's work
_REFINEMENTS, _REFINED_BELOW = 3, 0.3  # grids at most; a best change below this share of the range calls for the next
_VALLEYS = 3  # local minima of the cost that are refined: the coarse grid does not tell which is the lowest
_ZOOM_POINTS, _ZOOMS = 9, 4  # points and number of the grids about a minimum, each a quarter of the one before
_CHUNK = 16  # stiffnesses that are evaluated at once: the best so far spares the work of later ones
_BISECTIONS, _EXACT_BISECTIONS = 40, 12  # of the stiffness: to rounding; to the tolerance of the exact condition
_ROUNDING = 1e-6  # relative, of the cost: the best known stays within a search that it bounds
_INWARD = 1e-12  # from an end of the stiffness range inwards: logarithm and exponential round
Condition = Requirement | InterpolatedRequirement | SteadySliding
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

    Parameters
    ----------
    joint, gains : scalars. learnt : whether the joint was learnt from the motion.
    requirements : each of them is to be satisfied.
    factors : factors on the total damping of the requirements, by the logarithm of the stiffness; interpolated
        between.
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
    ) -> None:
        self._joint, self._gains, self._limits, self._loop = joint, gains, limits, loop
        self._requirements, self._learnt, self._factors = list(requirements), learnt, dict(factors or {})
        self._present = math.log(float(gains.stiffness))
        self._floor = float(damping_floor(joint, gains.stiffness))
        self._before = max(float(joint.total_damping(gains)), self._floor)
        self._reach = math.log(_LEARNT_REACH if learnt else _REACH)
        self._exact = any(requirement.exact for requirement in requirements)
        self._domain = self._allowed_domain()
        self._bisections = _EXACT_BISECTIONS if self._exact else _BISECTIONS

    def with_requirement(self, requirement: Condition) -> AdviceSearch:
        """The same search with one requirement more, and no factors."""
        return self._with([*self._requirements, requirement], {})

    def with_factors(self, factors: Mapping[float, float]) -> AdviceSearch:
        """The same search with other factors."""
        return self._with(self._requirements, factors)

    def _with(self, requirements: Sequence[Condition], factors: Mapping[float, float]) -> AdviceSearch:
        return AdviceSearch(
            self._joint, self._gains, self._limits, self._loop, requirements, learnt=self._learnt, factors=factors
        )

    def total_damping(self, stiffness: float) -> float:
        """The total damping at a stiffness that factors multiply [N·m·s/rad]."""
        here = np.array([stiffness])
        return float((self._unscaled_damping(here) + self._joint.own_damping(here))[0])

    @staticmethod
    def change(joint: Joint, present: Gains, gains: Gains) -> float:
        """Size of a change of gains; defined in :mod:`stickslip_ros.monitoring.advice.recommend`."""
        floor = float(damping_floor(joint, present.stiffness))
        before, after = (max(float(joint.total_damping(each)), floor) for each in (present, gains))
        stiffness = np.array([math.log(float(gains.stiffness) / float(present.stiffness))])
        return math.hypot(float(_stiffness_cost(stiffness)[0]), math.log(after / before))

    def reaches_margin(self, gains: Gains) -> bool:
        """Whether gains reach the wanted margin, whatever the bounds."""
        return bool(self._satisfied(np.array([float(gains.stiffness)]), np.array([float(gains.damping)]))[0])

    def within_bounds(self, gains: Gains) -> bool:
        """Whether gains are within the bounds."""
        least, largest = self._damping_interval(np.array([float(gains.stiffness)]))
        return bool(least[0] <= float(gains.damping) <= largest[0])

    def damping_only(self) -> Gains | None:
        """The damping nearest to the present one, at the present stiffness."""
        costs, damping = self._evaluate(np.array([self._present]))
        return self._as_gains(self._present, damping[0]) if math.isfinite(costs[0]) else None

    def stiffness_only(self) -> Gains | None:
        """The stiffness nearest to the present one, with the present damping."""
        reach = self._reach
        for _ in range(2):
            grid = self._grid(reach)
            good = np.flatnonzero(self._allows_present_damping(grid))
            if len(good) == 0:
                return None
            nearest = int(good[np.argmin(np.abs(grid[good] - self._present))])
            reach = abs(grid[nearest] - self._present)
        inside = float(grid[nearest])
        outside = float(grid[min(max(nearest - int(np.sign(inside - self._present)), 0), len(grid) - 1)])
        inside, _ = bisected(
            lambda middle: self._allows_present_damping(np.array([middle]))[0], inside, outside, self._bisections
        )
        return self._as_gains(inside, float(self._gains.damping))

    def least_change(self) -> Gains | None:
        """The gains nearest to the present ones."""
        found = self._cheapest(np.array([self._present]), math.inf)
        # No stiffness further away than the best change known can be better.
        reach = min([self._reach, *(cost for cost, _, _ in found)])
        width = 0.0
        for _ in range(_REFINEMENTS):
            grid = self._grid(reach)
            if len(grid) < 2:
                break
            width = float(np.max(np.diff(grid)))
            found = sorted(found + self._cheapest(grid, found[0][0] if found else math.inf))[:_VALLEYS]
            if not found or found[0][0] > _REFINED_BELOW * reach:
                break
            reach = found[0][0]
        for _, centre, _ in list(found):
            found = sorted(found + self._zoomed(centre, width, found[0][0]))
        return self._as_gains(*found[0][1:]) if found else None

    def _cheapest(self, grid: FloatArray, best: float) -> list[tuple[float, float, float]]:
        """Cost, logarithm of the stiffness and damping where the cost is least within its neighbourhood."""
        costs, damping = self._evaluate(grid, best)
        padded = np.concatenate([[math.inf], costs, [math.inf]])
        valleys = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]) & np.isfinite(costs))
        return [(float(costs[index]), float(grid[index]), float(damping[index])) for index in valleys]

    def _zoomed(self, centre: float, width: float, best: float) -> list[tuple[float, float, float]]:
        """Cheapest gains near ``centre``, on ever finer grids; as :meth:`_cheapest`."""
        found: list[tuple[float, float, float]] = []
        for _ in range(_ZOOMS):
            around = np.unique(np.clip(np.linspace(centre - width, centre + width, _ZOOM_POINTS), *self._domain))
            found = sorted(found + self._cheapest(around, best))
            if found:
                best, centre = min(best, found[0][0]), found[0][1]
            width *= 2.0 / (_ZOOM_POINTS - 1)
        return found[:1]

    def obstruction(self) -> Obstruction:
        """What is in the way, and the best within reach."""
        # Over all stiffnesses, since any of the bounds may be left out; and at those where the others begin and end.
        grid = self._grid(self._reach)
        points = _EXACT_POINTS if self._exact else 2 * _POINTS
        if self._exact and len(grid) > points:
            grid = grid[np.linspace(0, len(grid) - 1, points).astype(int)]
        everywhere = np.linspace(self._present - self._reach, self._present + self._reach, points)
        grid = np.sort(np.concatenate([everywhere, grid]))
        stiffness = np.exp(grid)
        bounds, needed = self._bounds(stiffness), self._scaled_damping(stiffness)
        texts = {name: f"{name} ({bound.text})" for name, bound in bounds.items()}
        names, together = _blocking_bounds(bounds, lambda least, largest: _any_feasible(least, largest, needed))
        if together:
            text = " and ".join(texts[name] for name in names) + " are in the way together"
        elif names:
            text = ", or ".join(texts[name] for name in names) + (
                " is in the way" if len(names) == 1 else ": each is in the way"
            )
        else:
            text = "no stiffness and damping would do, whatever the bounds"
        best, reserve = self._best(stiffness, bounds, needed)
        return Obstruction(bounds=names, together=together, text=text, best=best, reserve=reserve)

    def bounds_blocking_damping(self) -> tuple[str, ...]:
        """Names of the bounds without which damping alone would do."""
        stiffness = np.array([float(self._gains.stiffness)])
        bounds, needed = self._bounds(stiffness), self._scaled_damping(stiffness)
        return _blocking_bounds(bounds, lambda least, largest: _any_feasible(least, largest, needed))[0]

    def bounds_blocking_stiffness(self) -> tuple[str, ...]:
        """Names of the bounds without which stiffness alone would do."""
        stiffness = np.exp(np.linspace(self._present - self._reach, self._present + self._reach, 2 * _POINTS))
        damping = np.full(stiffness.shape, float(self._gains.damping))
        reached = self._satisfied(stiffness, damping)
        return _blocking_bounds(
            self._bounds(stiffness),
            lambda least, largest: bool(np.any(reached & (least <= damping) & (damping <= largest))),
        )[0]

    def _best(self, stiffness: FloatArray, bounds: dict[str, Bound], needed: FloatArray) -> tuple[Gains | None, float]:
        least, largest = _intersection(list(bounds.values()), stiffness.shape)
        inside = (least <= largest) & np.isfinite(needed) & np.isfinite(largest)
        if not inside.any():
            return None, math.nan
        wanted, own = 1.0 + self._limits.wanted_margin, self._joint.own_damping(stiffness)
        with np.errstate(all="ignore"):
            reserve = wanted * (largest + own) / np.maximum(needed + own, 1e-300) - 1.0
        index = int(np.argmax(np.where(inside, reserve, -math.inf)))
        return Gains(stiffness=float(stiffness[index]), damping=float(largest[index])), float(reserve[index])

    def _grid(self, reach: float) -> FloatArray:
        """Logarithms of stiffnesses no further from the present one than ``reach``, and where bounds allow any."""
        low, high = self._domain
        low, high = max(low, self._present - reach), min(high, self._present + reach)
        if not low <= high:
            return np.array([])
        points = max(_POINTS, math.ceil((high - low) / _SPACING))
        inside = [self._present] if low <= self._present <= high else []
        return np.unique(np.concatenate([np.linspace(low, high, points), inside]))

    def _allowed_domain(self) -> tuple[float, float]:
        """The least and the largest logarithm of a stiffness at which bounds allow any damping."""
        coarse = np.linspace(self._present - self._reach, self._present + self._reach, _DOMAIN_POINTS)
        # The best often lies where the allowed stiffnesses begin or end.
        edges = [math.log(edge) for edge in self._limits.stiffness_range if 0 < edge < math.inf]
        inward = [edge + side for edge in edges for side in (-_INWARD, _INWARD)]
        within = [edge for edge in inward if abs(edge - self._present) <= self._reach]
        coarse = np.sort(np.concatenate([coarse, [self._present], within]))
        least, largest = _intersection(list(self._bounds(np.exp(coarse)).values()), coarse.shape)
        allowed = coarse[least <= largest]
        return (float(allowed[0]), float(allowed[-1])) if len(allowed) else (math.inf, -math.inf)

    def _scaled_damping(self, stiffness: FloatArray) -> FloatArray:
        if not self._factors:
            return np.asarray(np.max([one.damping(stiffness) for one in self._requirements], axis=0))
        own = self._joint.own_damping(stiffness)
        return np.asarray((self._unscaled_damping(stiffness) + own) * self._factor_at(stiffness) - own)

    def _unscaled_damping(self, stiffness: FloatArray) -> FloatArray:
        """Least damping of the requirements, and at least the damping floor: a factor needs something to multiply."""
        needed = np.max([one.damping(stiffness) for one in self._requirements], axis=0)
        floor = np.asarray(damping_floor(self._joint, stiffness))
        return np.asarray(np.maximum(needed, floor - self._joint.own_damping(stiffness)))

    def _factor_at(self, stiffness: FloatArray) -> FloatArray:
        places = sorted(self._factors)
        return np.asarray(np.interp(np.log(stiffness), places, [self._factors[place] for place in places]))

    def _bounds(self, stiffness: FloatArray) -> dict[str, Bound]:
        bounds = bounds_at(stiffness, self._joint, self._limits, self._loop)
        if self._learnt:
            own = np.broadcast_to(self._joint.own_damping(stiffness), stiffness.shape)
            bounds[_LEARNT] = Bound(
                text=f"it does not answer for gains × {_LEARNT_REACH:g}",
                least=np.full(stiffness.shape, -math.inf),
                largest=_LEARNT_REACH * self._before - own,
            )
        return bounds

    def _satisfied(self, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        less, reached = damping, np.ones(stiffness.shape, dtype=np.bool_)
        if self._factors:
            own = self._joint.own_damping(stiffness)
            total = (damping + own) / self._factor_at(stiffness)
            less, reached = total - own, np.asarray(total >= damping_floor(self._joint, stiffness))
        # Exact requirements are evaluated last, where the others are satisfied.
        for one in sorted(self._requirements, key=lambda one: one.exact):
            reached[reached] = one.reached(stiffness[reached], less[reached]) if reached.any() else False
        return reached

    def _damping_interval(self, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _intersection(list(self._bounds(stiffness).values()), stiffness.shape)

    def _evaluate(self, logarithm: FloatArray, best: float = math.inf) -> tuple[FloatArray, FloatArray]:
        """Costs of the nearest gains of each stiffness, and their damping.

        The cost is infinite where there are none, or none cheaper than ``best``.
        """
        costs, dampings = np.full(logarithm.shape, math.inf), np.full(logarithm.shape, math.nan)
        order = np.argsort(np.abs(logarithm - self._present))
        for part in np.array_split(order, max(1, len(order) // _CHUNK)):
            part_costs, dampings[part] = self._evaluate_at_once(logarithm[part], best)
            costs[part] = part_costs
            best = min(best, float(np.min(part_costs, initial=math.inf)))
        return costs, dampings

    def _evaluate_at_once(self, logarithm: FloatArray, best: float) -> tuple[FloatArray, FloatArray]:
        costs, damping = np.full(logarithm.shape, math.inf), np.full(logarithm.shape, math.nan)
        best *= 1.0 + _ROUNDING
        stiffness, stiffer = np.exp(logarithm), _stiffness_cost(logarithm - self._present)
        least, largest = self._damping_interval(stiffness)
        own = np.broadcast_to(self._joint.own_damping(stiffness), stiffness.shape)
        # No damping further away than this is cheaper; most stiffnesses need more, which is soon seen.
        with np.errstate(all="ignore"):
            room = np.sqrt(best**2 - stiffer**2)
            useful = np.minimum(largest, np.where(np.isfinite(room), self._before * np.exp(room) - own, math.inf))
        candidates = (least <= useful) & (stiffer <= best)
        bounded = candidates & np.isfinite(useful)
        if bounded.any():
            candidates[bounded] = self._satisfied(stiffness[bounded], useful[bounded])
        if not candidates.any():
            return costs, damping
        lowest = np.maximum(least[candidates], self._scaled_damping(stiffness[candidates]))
        possible = lowest <= largest[candidates]
        chosen = np.clip(float(self._gains.damping), lowest, np.maximum(lowest, largest[candidates]))
        with np.errstate(all="ignore"):
            change = np.log(np.maximum(chosen + own[candidates], self._floor) / self._before)
        damping[candidates] = chosen
        costs[candidates] = np.where(possible, np.hypot(stiffer[candidates], change), math.inf)
        return costs, damping

    def _allows_present_damping(self, logarithm: FloatArray) -> NDArray[np.bool_]:
        stiffness, present = np.exp(logarithm), np.full(logarithm.shape, float(self._gains.damping))
        least, largest = self._damping_interval(stiffness)
        allowed = (least <= present) & (present <= largest)
        allowed[allowed] = self._satisfied(stiffness[allowed], present[allowed]) if allowed.any() else False
        return np.asarray(allowed)

    def _as_gains(self, logarithm: float, damping: float) -> Gains:
        same = logarithm == self._present
        return Gains(stiffness=self._gains.stiffness if same else math.exp(logarithm), damping=float(damping))


def _stiffness_cost(logarithm: FloatArray) -> FloatArray:
    """Cost of a change of the stiffness, by its logarithm: three times as much beyond a factor of two.

    A drive's noise, resonances and torque bound its stiffness, not its damping alone; nobody trusts a model so far.
    """
    size = np.abs(logarithm)
    return size + (_COST_BEYOND - 1.0) * np.maximum(size - _LINEAR_CHANGE, 0.0)


def damping_floor(joint: Joint, stiffness: Real) -> Real:
    """Total damping at a stiffness [N·m/rad] that counts as none [N·m·s/rad]."""
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
    """Names of bounds without any one of which there are gains, else of the fewest without all of which there are; and
    whether it takes all.
    """
    shape = next(iter(bounds.values())).least.shape

    def feasible_without(left_out: tuple[str, ...]) -> bool:
        return feasible(*_intersection([bound for name, bound in bounds.items() if name not in left_out], shape))

    names = tuple(name for name in bounds if feasible_without((name,)))
    if names:
        return names, False
    sets = [several for size in range(2, len(bounds) + 1) for several in combinations(bounds, size)]
    together = next((several for several in sets if feasible_without(several)), ())
    return together, bool(together)
