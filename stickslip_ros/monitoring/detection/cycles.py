# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stick-slip cycles among the rests of a joint.

Not every rest is a stick: a joint also stops where it is told to. A rest is driven if the reference
went on meanwhile. Slips to and fro about a reference that stands still are hunting. Without a
reference only regularity tells: several slips in a row, in one direction and at one mean speed.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from statistics import median

from stickslip_ros.monitoring.detection.rests import Rest

_DRIVEN_SHARE = 0.1  # of the mean speed of the cycle: how fast the reference must go on during a rest
_LEAST_STEP = 0.2  # of the way that the reference goes during the next rest
_TRAIN_WITHOUT_REFERENCE = 3
_SPEED_SPREAD = 4.0  # of the mean speeds of a train's cycles, largest over smallest
_LEAST_SLIP_SHARE = 0.1  # of the usual slip; less is creep within a rest
_USUAL_SLIPS = 9
_WHOLE_SLIP = 0.75  # of the usual slip
_STANDS = 0.05  # of a slip: a reference that goes no further stands still
_TRAIN_OF_HUNTING = 3
_HUNTING_SHRINKS = 0.7  # from one slip to the next: less is a motion that settles


@dataclass(frozen=True, kw_only=True)
class Cycle:
    """A slip between two rests, with the dwell before it.

    Attributes
    ----------
    breakaway, arrest : when the slip began and ended [s].
    dwell : time at rest before the breakaway, t₂ of Eq. (6) [s].
    slip_distance : signed [rad].
    position : where the slip began [rad].
    effort : measured effort at breakaway [N·m], NaN if unknown.
    hunting : whether the reference stood still and the slip before went the other way.
    """

    breakaway: float
    arrest: float
    dwell: float
    slip_distance: float
    position: float
    effort: float
    hunting: bool = False

    @property
    def slip_duration(self) -> float:
        """t₁ [s]."""
        return self.arrest - self.breakaway

    @property
    def period(self) -> float:
        """Dwell and slip together [s]."""
        return self.dwell + self.slip_duration

    @property
    def mean_speed(self) -> float:
        """Slip distance over period [rad/s]."""
        return abs(self.slip_distance) / self.period


class CycleDetector:
    """Finds stick-slip cycles in a sequence of rests."""

    def __init__(self) -> None:
        self.last_rest: Rest | None = None
        self._foreseen: Cycle | None = None
        self._closed: Rest | None = None
        self._way = 0.0
        self._pending: list[Cycle] = []
        self._told = 0  # of the pending cycles, how many are published
        self._confirmed = False
        self._slips: deque[float] = deque(maxlen=_USUAL_SLIPS)

    def foresee(self, rest: Rest) -> Cycle | None:
        """The cycle that ends in a rest which has only begun, if that is certain already, once.

        It is settled thereby: :meth:`take` or :meth:`finish` returns it again, with what the whole rest tells of it.
        """
        if self._foreseen is None:
            self._foreseen = self._certain_already(rest)
            return self._foreseen
        return None

    def _certain_already(self, rest: Rest) -> Cycle | None:
        before = self.last_rest
        if before is None or self._closed is not None or rest.arrest < before.breakaway:
            return None
        cycle = self._cycle(before, rest)
        if cycle is None or self._way * cycle.slip_distance <= 0:
            return None
        # Less than usual may be the first part of a slip that goes on in a moment.
        if abs(cycle.slip_distance) < _WHOLE_SLIP * median(self._slips):
            return None
        if math.isnan(rest.reference_travel):
            usual = self._pending[-1] if self._pending else cycle
            fast, slow = max(cycle.mean_speed, usual.mean_speed), min(cycle.mean_speed, usual.mean_speed)
            return cycle if self._confirmed and fast <= _SPEED_SPREAD * slow else None
        # The rest that has just begun will be like the last one.
        keeps_up = abs(cycle.slip_distance) >= _LEAST_STEP * before.reference_travel
        return cycle if keeps_up and _is_driven(before, cycle) and _is_driven(rest, cycle) else None

    def finish(self, rest: Rest | None) -> list[Cycle]:
        """The cycle that ended in a rest which still lasts (None if there is none), where the samples end there."""
        if rest is None or self._closed is not None:
            foreseen, self._foreseen = self._foreseen, None
            return [foreseen] if foreseen is not None else []
        cycles = self.take(rest)
        self._closed = rest
        return cycles

    def take(self, rest: Rest) -> list[Cycle]:
        """Take the next rest and return the cycles that are now certain, oldest first."""
        before, self.last_rest = self.last_rest, rest
        foreseen, self._foreseen = self._foreseen, None
        certain = self._cycles_until(before, rest)
        if foreseen is not None and foreseen.breakaway not in [cycle.breakaway for cycle in certain]:
            certain.append(foreseen)
        return certain

    def _cycles_until(self, before: Rest | None, rest: Rest) -> list[Cycle]:
        closed, self._closed = self._closed, None
        if before is None or (closed is not None and rest.arrest < closed.breakaway):
            return []
        distance = rest.position - before.position
        way_before, self._way = self._way, distance
        cycle = self._cycle(before, rest)
        if cycle is None:
            return []
        self._slips.append(abs(distance))
        # By the net way, since a lightly damped joint bounces back before it rests.
        goes_on = rest.direction_after * distance > 0
        went_on = way_before * distance > 0
        if not math.isnan(rest.reference_travel):
            stood = rest.reference_way + rest.reference_travel - before.reference_way <= _STANDS * abs(distance)
            if stood:
                return self._at_standstill(cycle, way_before)
            self._end_train()
            return self._with_reference(cycle, before, rest, went_on, goes_on)
        return self._without_reference(cycle, went_on, goes_on)

    def _cycle(self, before: Rest, rest: Rest) -> Cycle | None:
        """The slip between two rests, None if it is but creep within one."""
        distance = rest.position - before.position
        usual = median(self._slips) if self._slips else 0.0
        if distance == 0 or abs(distance) < _LEAST_SLIP_SHARE * usual:
            return None
        return Cycle(
            breakaway=before.breakaway,
            arrest=rest.arrest,
            dwell=before.dwell,
            slip_distance=distance,
            position=before.position,
            effort=before.effort,
        )

    def _with_reference(self, cycle: Cycle, before: Rest, rest: Rest, went_on: bool, goes_on: bool) -> list[Cycle]:
        # A hop that leaves the joint far behind is the start of a motion, not a step of a staircase.
        keeps_up = abs(cycle.slip_distance) >= _LEAST_STEP * rest.reference_travel
        driven = keeps_up and _is_driven(rest, cycle)
        # A rest where the motion turns is no evidence of its own, but may end a train.
        if driven and (goes_on or (went_on and _is_driven(before, cycle))):
            return [cycle]
        return []

    def _at_standstill(self, cycle: Cycle, way_before: float) -> list[Cycle]:
        if way_before * cycle.slip_distance > 0 or abs(cycle.slip_distance) < _HUNTING_SHRINKS * abs(way_before):
            self._end_train()
        self._pending.append(replace(cycle, hunting=True))
        if len(self._pending) < _TRAIN_OF_HUNTING:
            return []
        certain, self._pending = self._pending[self._told :], self._pending[-_TRAIN_OF_HUNTING:]
        self._told = len(self._pending)
        return certain

    def _without_reference(self, cycle: Cycle, went_on: bool, goes_on: bool) -> list[Cycle]:
        if not went_on:
            self._end_train()
        speeds = [other.mean_speed for other in self._pending[-_USUAL_SLIPS:]] + [cycle.mean_speed]
        # The first dwell of a record may have begun long before it mattered.
        steady = speeds[1:] if len(speeds) > 2 else speeds[-1:]
        if self._pending and max(steady) > _SPEED_SPREAD * min(steady):
            self._end_train()
        self._pending.append(cycle)
        certain: list[Cycle] = []
        if self._confirmed:
            certain = [cycle]
        elif len(self._pending) >= _TRAIN_WITHOUT_REFERENCE:
            self._confirmed = True
            least = _LEAST_SLIP_SHARE * median(abs(other.slip_distance) for other in self._pending)
            certain = [other for other in self._pending if abs(other.slip_distance) >= least]
        self._pending = self._pending[-_USUAL_SLIPS:]
        if not goes_on:
            self._end_train()
        return certain

    def _end_train(self) -> None:
        self._pending = []
        self._told = 0
        self._confirmed = False


def _is_driven(rest: Rest, cycle: Cycle) -> bool:
    """Whether the reference went on while the joint rested."""
    return rest.dwell > 0 and rest.reference_travel / rest.dwell >= _DRIVEN_SHARE * cycle.mean_speed
