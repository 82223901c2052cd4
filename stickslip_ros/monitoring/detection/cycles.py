# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stick-slip cycles among the rests of a joint.

Not every rest is a stick: a joint also stops where it is told to. A rest is driven if the reference
went on meanwhile, and not only at its end, where the reference sets off the next motion. Slips to and fro
about a reference that stands still are hunting. Without a reference :mod:`.spring_evidence` tells.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

from stickslip_ros.monitoring.detection.motion import Evidence
from stickslip_ros.monitoring.detection.rests import Rest
from stickslip_ros.monitoring.detection.spring_evidence import Motion, SpringEvidence

_DRIVEN_SHARE = 0.35  # of the mean speed of the cycle: how fast the reference must go on during a rest
_NOT_AT_ITS_END = 0.25  # of the way that the reference goes on during a rest: what it has gone as a mean over the rest
_STEADILY = 0.4  # likewise, if it stands beside the rest; a steady one has a half
_LEAST_ADVANCE = 0.2  # of a band, likewise: less is noise
_LEAST_STEP = 0.2  # of the way that the reference goes during the next rest
_LEAST_SLIP_SHARE = 0.1  # of the usual slip; less is creep within a rest
_LARGEST_SLIP = 2.0  # of the usual slip, likewise
_USUAL_SLIPS = 9
_LEAST_DIRECTNESS = 0.5  # a lightly damped joint bounces back before it rests; but a motion to and fro is none of it
_LEAST_QUICKNESS = 1.3  # of the reference's speed: no more, and the joint follows it
_WHOLE_SLIP = 0.75  # of the usual slip
_STANDS = 0.05  # of a slip: a reference that goes no further stands still
_TRAIN_OF_HUNTING = 3
_HUNTING_SHRINKS = 0.7  # from one slip to the next: less is a motion that settles
_BEYOND = 0.2  # of a slip: so far the reference may lie outside the places that a hunting joint slips between
_PENDING = 64


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
    reference_speed : of the reference during the slip, as a mean [rad/s]; NaN if unknown.
    creep : for so long before the breakaway the joint crept towards it [s]; part of the dwell.
    """

    breakaway: float
    arrest: float
    dwell: float
    slip_distance: float
    position: float
    effort: float
    hunting: bool = False
    reference_speed: float = math.nan
    creep: float = 0.0

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
        self._rest_before: Rest | None = None
        self._foreseen: Cycle | None = None
        self._closed: Rest | None = None
        self._way = 0.0
        self._pending: list[Cycle] = []
        self._told = 0  # of the pending cycles, how many are published
        self._spring = SpringEvidence()
        self._slips: deque[float] = deque(maxlen=_USUAL_SLIPS)

    def evidence(self, recent: Sequence[Cycle]) -> Evidence:
        """What the recent cycles, oldest first, and the last rests tell of the time after them."""
        rest, before = self.last_rest, self._rest_before
        last_breakaway = rest.breakaway if rest is not None else math.nan
        stop_before = before.breakaway if before is not None and before.direction_before else math.nan
        if not recent:
            return Evidence(last_breakaway=last_breakaway, stop_before=stop_before)
        last = recent[-1]
        in_last_rest = rest is not None and before is not None and last.breakaway == before.breakaway
        return Evidence(
            cycles=len(recent),
            # The median, because a long smooth stretch between two rests makes a long cycle too.
            period=median(cycle.period for cycle in recent),
            slip=max(cycle.slip_duration for cycle in recent),
            dwell=max(cycle.dwell for cycle in recent),
            evidence=last_breakaway if in_last_rest else last.arrest,
            last_breakaway=last_breakaway,
            stop_before=stop_before,
        )

    @property
    def may_foresee(self) -> bool:
        """Whether :meth:`foresee` may say anything before the next rest is complete."""
        return self._foreseen is None and self._closed is None and bool(self._slips)

    def foresee(self, rest: Rest) -> Cycle | None:
        """The cycle that ends in a rest which has only begun, if that is certain already, once.

        It is settled thereby: :meth:`take` or :meth:`finish` returns it again, with what the whole rest tells of it.
        """
        if self.last_rest is None or not self.may_foresee:
            return None
        self._foreseen = self._certain_already(self.last_rest, rest)
        return self._foreseen

    def _certain_already(self, before: Rest, rest: Rest) -> Cycle | None:
        cycle = self._cycle(before, rest)
        if cycle is None or self._way * cycle.slip_distance <= 0:
            return None
        # Less than usual may be the first part of a slip that goes on in a moment.
        if abs(cycle.slip_distance) < _WHOLE_SLIP * median(self._slips):
            return None
        if math.isnan(rest.reference_advance):
            return cycle if self._spring.fits(_motion(cycle, rest)) else None
        meanwhile = _meanwhile(before, rest)
        # The rest that has just begun will be like the last one.
        keeps_up = abs(cycle.slip_distance) >= _LEAST_STEP * abs(before.reference_advance)
        if rest.slip.quickness < _LEAST_QUICKNESS:
            return None
        return (
            cycle if keeps_up and _is_driven(before, cycle, meanwhile) and _is_driven(rest, cycle, meanwhile) else None
        )

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
        before = self._rest_before = self.last_rest
        self.last_rest = rest
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
            if rest.slip.directness < _LEAST_DIRECTNESS:
                # What went to and fro in between was no slip.
                self._spring.begin_anew()
                self._end_train()
            return []
        self._slips.append(abs(distance))
        # By the net way, since a lightly damped joint bounces back before it rests.
        goes_on = rest.direction_after * distance > 0
        went_on = way_before * distance > 0
        if math.isnan(rest.reference_advance):
            return self._without_reference(cycle, rest)
        self._spring.begin_anew()
        if _stood(before, rest, distance):
            return self._at_standstill(cycle, before, way_before)
        self._end_train()
        return self._with_reference(cycle, before, rest, went_on, goes_on)

    def _cycle(self, before: Rest, rest: Rest) -> Cycle | None:
        """The slip between two rests, None if it is but creep within one, or a motion to and fro."""
        distance = rest.position - before.position
        usual = median(self._slips) if self._slips else 0.0
        if rest.arrest <= before.breakaway:
            return None
        if distance == 0 or abs(distance) < _LEAST_SLIP_SHARE * usual or rest.slip.directness < _LEAST_DIRECTNESS:
            return None
        moved = rest.seen_from - before.seen_until
        return Cycle(
            breakaway=before.breakaway,
            arrest=rest.arrest,
            dwell=before.dwell,
            creep=before.breakaway - before.stirred,
            slip_distance=distance,
            position=before.position,
            effort=before.effort,
            reference_speed=abs(_meanwhile(before, rest)) / moved if moved > 0.0 else math.nan,
        )

    def _with_reference(self, cycle: Cycle, before: Rest, rest: Rest, went_on: bool, goes_on: bool) -> list[Cycle]:
        meanwhile = _meanwhile(before, rest)
        # A hop that leaves the joint far behind is the start of a motion, not a step of a staircase.
        keeps_up = abs(cycle.slip_distance) >= _LEAST_STEP * abs(rest.reference_advance)
        if rest.slip.quickness < _LEAST_QUICKNESS:
            return []
        driven = keeps_up and _is_driven(rest, cycle, meanwhile)
        # A rest where the motion turns is no evidence of its own, but may end a train.
        if driven and (goes_on or (went_on and _is_driven(before, cycle, meanwhile))):
            return [cycle]
        # The last of a train, before the reference stops or turns, is like those before it.
        usual = abs(cycle.slip_distance) <= _LARGEST_SLIP * median(self._slips)
        return [cycle] if went_on and usual and _is_driven(before, cycle, meanwhile) else []

    def _at_standstill(self, cycle: Cycle, before: Rest, way_before: float) -> list[Cycle]:
        if way_before * cycle.slip_distance > 0 or abs(cycle.slip_distance) < _HUNTING_SHRINKS * abs(way_before):
            self._end_train()
        # A joint that hunts overshoots its reference; one that is moved by hand does not know of it.
        if not -_BEYOND <= before.error / cycle.slip_distance <= 1.0 + _BEYOND:
            self._end_train()
            return []
        self._pending.append(replace(cycle, hunting=True))
        if len(self._pending) < _TRAIN_OF_HUNTING:
            return []
        certain, self._pending = self._pending[self._told :], self._pending[-_TRAIN_OF_HUNTING:]
        self._told = len(self._pending)
        return certain

    def _without_reference(self, cycle: Cycle, rest: Rest) -> list[Cycle]:
        motion = _motion(cycle, rest)
        was_certain, fits = self._spring.certain, self._spring.fits(motion)
        if not self._spring.take(motion):
            self._end_train()
        if was_certain:
            return [cycle] if fits else []
        self._pending = [*self._pending[-_PENDING:], cycle]
        if not self._spring.certain:
            return []
        least = _LEAST_SLIP_SHARE * median(abs(other.slip_distance) for other in self._pending)
        certain = [other for other in self._pending if abs(other.slip_distance) >= least]
        self._end_train()
        return certain

    def _end_train(self) -> None:
        self._pending = []
        self._told = 0


def _motion(cycle: Cycle, rest: Rest) -> Motion:
    """A slip as evidence, with the rest in which it ended."""
    return Motion(
        distance=cycle.slip_distance,
        period=cycle.period,
        shape=rest.slip,
        bands=abs(cycle.slip_distance) / rest.band,
    )


def _meanwhile(before: Rest, rest: Rest) -> float:
    """How far the reference went on between two rests [rad], NaN if unknown."""
    return rest.reference - (before.reference + before.reference_advance)


def _stood(before: Rest, rest: Rest, distance: float) -> bool:
    """Whether the reference stood still from the beginning of one rest to the end of the next."""
    places = [place for one in (before, rest) for place in (one.reference, one.reference + one.reference_advance)]
    return max(places) - min(places) <= max(_STANDS * abs(distance), rest.band)


def _is_driven(rest: Rest, cycle: Cycle, meanwhile: float) -> bool:
    """Whether the reference went on while the joint rested, as in the slip beside it, and not only at the end.

    ``meanwhile`` is how far it went on during that slip [rad].
    """
    turns = rest.direction_after * cycle.slip_distance < 0
    sign = math.copysign(1.0, rest.reference_mean_advance if turns else cycle.slip_distance)
    advance, mean = sign * rest.reference_advance, sign * rest.reference_mean_advance
    share = _NOT_AT_ITS_END
    if abs(meanwhile) <= _STANDS * abs(cycle.slip_distance) and advance > _LEAST_STEP * abs(cycle.slip_distance):
        # A reference that stands while the joint moves is one that steps, and a servo answers late.
        share = _STEADILY
    if rest.dwell <= 0 or mean < max(_LEAST_ADVANCE * rest.band, share * advance):
        return False
    speed = max(cycle.mean_speed, abs(meanwhile) / cycle.slip_duration) if cycle.slip_duration > 0 else math.inf
    return turns or advance >= _DRIVEN_SHARE * speed * rest.dwell
