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
from stickslip_ros.monitoring.advice.requirement import Interpolated, Requirement, SteadySliding
from stickslip_ros.monitoring.samples import FloatArray

_REACH = 1e4  # times the present stiffness, either way
_BELIEVABLE = 100.0  # times the present gain: learnt friction is not known so far from where it was seen
_NO_DAMPING = 0.01  # damping ratio that counts as none
_POINTS, _SPACING = 101, 0.04  # of the logarithm of the stiffness, at most
_AT_ONCE = 16
_SOFT, _BEYOND = math.log(2.0), 3.0  # change of the stiffness beyond which it costs more, and how many times as much
_SLACK = 1e-6  # so that rounding does not lose the best known
_MOST_EXACT = 60  # stiffnesses at which the exact requirement is asked for to say what is in the way
_COARSE = 2001
_LOOKS, _NARROWER = 3, 0.3
_ZOOM_POINTS, _ZOOMS, _VALLEYS = 9, 4, 3
_BISECTIONS, _EXACT_BISECTIONS = 40, 12
_INSIDE = 1e-12
Condition = Requirement | Interpolated | SteadySliding
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
    more : factors on the total damping that the requirements ask for, by the logarithm of the stiffness at which each
        was found; interpolated between.
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
        more: Mapping[float, float] | None = None,
    ) -> None:
        self._joint, self._gains, self._limits, self._loop = joint, gains, limits, loop
        self._requirements, self._learnt, self._more = list(requirements), learnt, dict(more or {})
        self._present = math.log(float(gains.stiffness))
        self._floor = float(damping_floor(joint, gains.stiffness))
        self._before = max(float(joint.total_damping(gains)), self._floor)
        self._reach = math.log(_BELIEVABLE if learnt else _REACH)
        self._exact = any(requirement.exact for requirement in requirements)
        self._domain = self._allowed_domain()
        self._bisections = _EXACT_BISECTIONS if self._exact else _BISECTIONS

    def with_requirement(self, requirement: Condition) -> AdviceSearch:
        """The same search with one requirement more, and no factors."""
        return self._again([*self._requirements, requirement], {})

    def with_more_damping(self, more: Mapping[float, float]) -> AdviceSearch:
        """The same search with other factors."""
        return self._again(self._requirements, more)

    def _again(self, requirements: Sequence[Condition], more: Mapping[float, float]) -> AdviceSearch:
        return AdviceSearch(
            self._joint, self._gains, self._limits, self._loop, requirements, learnt=self._learnt, more=more
        )

    def total_damping(self, stiffness: float) -> float:
        """The total damping at a stiffness that factors multiply [N·m·s/rad]."""
        here = np.array([stiffness])
        return float((self._required(here) + self._joint.own_damping(here))[0])

    @staticmethod
    def change(joint: Joint, present: Gains, gains: Gains) -> float:
        """How large a change of gains is; see the head of advice.py."""
        floor = float(damping_floor(joint, present.stiffness))
        before, after = (max(float(joint.total_damping(each)), floor) for each in (present, gains))
        stiffness = np.array([math.log(float(gains.stiffness) / float(present.stiffness))])
        return math.hypot(float(_stiffness_cost(stiffness)[0]), math.log(after / before))

    def enough(self, gains: Gains) -> bool:
        """Whether gains reach the wanted margin, whatever the bounds."""
        return bool(self._reached(np.array([float(gains.stiffness)]), np.array([float(gains.damping)]))[0])

    def allows(self, gains: Gains) -> bool:
        """Whether gains are within the bounds."""
        least, largest = self._within_bounds(np.array([float(gains.stiffness)]))
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
        for _ in range(_LOOKS):
            grid = self._grid(reach)
            if len(grid) < 2:
                break
            width = float(np.max(np.diff(grid)))
            found = sorted(found + self._cheapest(grid, found[0][0] if found else math.inf))[:_VALLEYS]
            if not found or found[0][0] > _NARROWER * reach:
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
        """The same from an ever closer look."""
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
        points = _MOST_EXACT if self._exact else 2 * _POINTS
        if self._exact and len(grid) > points:
            grid = grid[np.linspace(0, len(grid) - 1, points).astype(int)]
        everywhere = np.linspace(self._present - self._reach, self._present + self._reach, points)
        grid = np.sort(np.concatenate([everywhere, grid]))
        stiffness = np.exp(grid)
        bounds, needed = self._bounds(stiffness), self._needed(stiffness)
        texts = {name: f"{name} ({bound.text})" for name, bound in bounds.items()}
        names, together = _in_the_way(bounds, lambda least, largest: _some_damping(least, largest, needed))
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

    def in_the_way_of_damping(self) -> tuple[str, ...]:
        """Names of the bounds without which damping alone would do."""
        stiffness = np.array([float(self._gains.stiffness)])
        needed = self._needed(stiffness)
        return _in_the_way(self._bounds(stiffness), lambda least, largest: _some_damping(least, largest, needed))[0]

    def in_the_way_of_stiffness(self) -> tuple[str, ...]:
        """Names of the bounds without which stiffness alone would do."""
        stiffness = np.exp(np.linspace(self._present - self._reach, self._present + self._reach, 2 * _POINTS))
        damping = np.full(stiffness.shape, float(self._gains.damping))
        reached = self._reached(stiffness, damping)
        return _in_the_way(
            self._bounds(stiffness),
            lambda least, largest: bool(np.any(reached & (least <= damping) & (damping <= largest))),
        )[0]

    def _best(self, stiffness: FloatArray, bounds: dict[str, Bound], needed: FloatArray) -> tuple[Gains | None, float]:
        least, largest = _joined(list(bounds.values()), stiffness.shape)
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
        coarse = np.linspace(self._present - self._reach, self._present + self._reach, _COARSE)
        # The best often lies where the allowed stiffnesses begin or end.
        edges = [math.log(edge) for edge in self._limits.stiffness_range if 0 < edge < math.inf]
        inward = [edge + side for edge in edges for side in (-_INSIDE, _INSIDE)]
        within = [edge for edge in inward if abs(edge - self._present) <= self._reach]
        coarse = np.sort(np.concatenate([coarse, [self._present], within]))
        least, largest = _joined(list(self._bounds(np.exp(coarse)).values()), coarse.shape)
        allowed = coarse[least <= largest]
        return (float(allowed[0]), float(allowed[-1])) if len(allowed) else (math.inf, -math.inf)

    def _needed(self, stiffness: FloatArray) -> FloatArray:
        if not self._more:
            return np.asarray(np.max([one.damping(stiffness) for one in self._requirements], axis=0))
        own = self._joint.own_damping(stiffness)
        return np.asarray((self._required(stiffness) + own) * self._factors(stiffness) - own)

    def _required(self, stiffness: FloatArray) -> FloatArray:
        """What requirements ask for, and some damping at least: of none there is no multiple."""
        needed = np.max([one.damping(stiffness) for one in self._requirements], axis=0)
        floor = np.asarray(damping_floor(self._joint, stiffness))
        return np.asarray(np.maximum(needed, floor - self._joint.own_damping(stiffness)))

    def _factors(self, stiffness: FloatArray) -> FloatArray:
        places = sorted(self._more)
        return np.asarray(np.interp(np.log(stiffness), places, [self._more[place] for place in places]))

    def _bounds(self, stiffness: FloatArray) -> dict[str, Bound]:
        bounds = bounds_at(stiffness, self._joint, self._limits, self._loop)
        if self._learnt:
            own = np.broadcast_to(self._joint.own_damping(stiffness), stiffness.shape)
            bounds[_LEARNT] = Bound(
                text=f"it does not answer for gains × {_BELIEVABLE:g}",
                least=np.full(stiffness.shape, -math.inf),
                largest=_BELIEVABLE * self._before - own,
            )
        return bounds

    def _reached(self, stiffness: FloatArray, damping: FloatArray) -> NDArray[np.bool_]:
        less, reached = damping, np.ones(stiffness.shape, dtype=np.bool_)
        if self._more:
            own = self._joint.own_damping(stiffness)
            total = (damping + own) / self._factors(stiffness)
            less, reached = total - own, np.asarray(total >= damping_floor(self._joint, stiffness))
        # What is quick to tell comes first, and the rest is asked where it matters.
        for one in sorted(self._requirements, key=lambda one: one.exact):
            reached[reached] = one.reached(stiffness[reached], less[reached]) if reached.any() else False
        return reached

    def _within_bounds(self, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
        return _joined(list(self._bounds(stiffness).values()), stiffness.shape)

    def _evaluate(self, logarithm: FloatArray, best: float = math.inf) -> tuple[FloatArray, FloatArray]:
        """What the nearest gains of each stiffness cost, and their damping.

        The cost is infinite where there are none, or none cheaper than ``best``.
        """
        costs, dampings = np.full(logarithm.shape, math.inf), np.full(logarithm.shape, math.nan)
        order = np.argsort(np.abs(logarithm - self._present))
        for part in np.array_split(order, max(1, len(order) // _AT_ONCE)):
            part_costs, dampings[part] = self._evaluate_at_once(logarithm[part], best)
            costs[part] = part_costs
            best = min(best, float(np.min(part_costs, initial=math.inf)))
        return costs, dampings

    def _evaluate_at_once(self, logarithm: FloatArray, best: float) -> tuple[FloatArray, FloatArray]:
        costs, damping = np.full(logarithm.shape, math.inf), np.full(logarithm.shape, math.nan)
        best *= 1.0 + _SLACK
        stiffness, stiffer = np.exp(logarithm), _stiffness_cost(logarithm - self._present)
        least, largest = self._within_bounds(stiffness)
        own = np.broadcast_to(self._joint.own_damping(stiffness), stiffness.shape)
        # No damping further away than this is cheaper; most stiffnesses need more, which is soon seen.
        with np.errstate(all="ignore"):
            room = np.sqrt(best**2 - stiffer**2)
            useful = np.minimum(largest, np.where(np.isfinite(room), self._before * np.exp(room) - own, math.inf))
        hopeful = (least <= useful) & (stiffer <= best)
        bounded = hopeful & np.isfinite(useful)
        if bounded.any():
            hopeful[bounded] = self._reached(stiffness[bounded], useful[bounded])
        if not hopeful.any():
            return costs, damping
        lowest = np.maximum(least[hopeful], self._needed(stiffness[hopeful]))
        possible = lowest <= largest[hopeful]
        chosen = np.clip(float(self._gains.damping), lowest, np.maximum(lowest, largest[hopeful]))
        with np.errstate(all="ignore"):
            change = np.log(np.maximum(chosen + own[hopeful], self._floor) / self._before)
        damping[hopeful] = chosen
        costs[hopeful] = np.where(possible, np.hypot(stiffer[hopeful], change), math.inf)
        return costs, damping

    def _allows_present_damping(self, logarithm: FloatArray) -> NDArray[np.bool_]:
        stiffness, present = np.exp(logarithm), np.full(logarithm.shape, float(self._gains.damping))
        least, largest = self._within_bounds(stiffness)
        allowed = (least <= present) & (present <= largest)
        allowed[allowed] = self._reached(stiffness[allowed], present[allowed]) if allowed.any() else False
        return np.asarray(allowed)

    def _as_gains(self, logarithm: float, damping: float) -> Gains:
        same = logarithm == self._present
        return Gains(stiffness=self._gains.stiffness if same else math.exp(logarithm), damping=float(damping))


def _stiffness_cost(logarithm: FloatArray) -> FloatArray:
    """What a change of the stiffness costs, by its logarithm: more from a factor of two on.

    A drive's noise, resonances and torque bound its stiffness, not its damping alone; nobody trusts a model so far.
    """
    size = np.abs(logarithm)
    return size + (_BEYOND - 1.0) * np.maximum(size - _SOFT, 0.0)


def damping_floor(joint: Joint, stiffness: Real) -> Real:
    """Total damping at a stiffness [N·m/rad] below which there is none to speak of [N·m·s/rad]."""
    return np.asarray(2.0 * _NO_DAMPING * np.sqrt(np.asarray(stiffness) * float(joint.inertia)))


def _joined(bounds: list[Bound], shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    least, largest = np.full(shape, -math.inf), np.full(shape, math.inf)
    for bound in bounds:
        least, largest = np.maximum(least, bound.least), np.minimum(largest, bound.largest)
    return least, largest


def _some_damping(least: FloatArray, largest: FloatArray, needed: FloatArray) -> bool:
    """Whether bounds leave enough damping at any stiffness."""
    least = np.maximum(least, needed)
    return bool(np.any((least <= largest) & np.isfinite(least)))


def _in_the_way(
    bounds: dict[str, Bound], feasible: Callable[[FloatArray, FloatArray], bool]
) -> tuple[tuple[str, ...], bool]:
    """Bounds any one of which is in the way, or the fewest that are together, and whether they are together."""
    shape = next(iter(bounds.values())).least.shape

    def feasible_without(left_out: tuple[str, ...]) -> bool:
        return feasible(*_joined([bound for name, bound in bounds.items() if name not in left_out], shape))

    names = tuple(name for name in bounds if feasible_without((name,)))
    if names:
        return names, False
    sets = [several for size in range(2, len(bounds) + 1) for several in combinations(bounds, size)]
    together = next((several for several in sets if feasible_without(several)), ())
    return together, bool(together)
