# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Stick-slip cycles among the rests of a joint.

Not every rest is a stick: a joint also stops where it is told to. With a reference, a rest is a stick if the
reference went on steadily meanwhile, and a slip is a burst faster than the reference. Swings to and fro about a
reference that stands, or goes on evenly, are hunting. Without a reference :class:`.SpringEvidence` decides.

Every decision rests on the motions beside it: on the rests before and after a motion, on the motion before that, and
on the cycles that follow one another without a break, the train. Nothing older has a say.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from statistics import fmean, median

from stickslip_ros.monitoring.detection._swing_kernel import STANDS
from stickslip_ros.monitoring.detection.motion import CycleRecord, Swing
from stickslip_ros.monitoring.detection.rests import Rest
from stickslip_ros.monitoring.detection.slip_shape import SlipShape

ENOUGH = 14.0  # evidence, nats: one motion in a million taken by chance; see the receiver operating curve
_MOST = 1.5 * ENOUGH  # evidence, nats: at most, so that what was certain can be given up
_GIVEN_UP = 0.5 * ENOUGH  # evidence with which a train is given up, nats
_LOOKED_BACK = 15  # latest motions of a train, 1
_ODD_ONES = 0.15  # real slips that do not fit, of all: two in one, or an impulse
# Standard deviations of the logarithms about their median, among slips and among separate motions.
_DURATION, _DURATION_APART = 0.3, 1.1
_SPEED, _SPEED_APART = 0.45, 1.8
_ONE_WAY, _ONE_WAY_APART = 0.95, 0.55
_LEAST = -3.0  # evidence of a motion in a train, nats: with less it is none of the train's slips
_LARGEST_ASYMMETRY = 1.45  # of most slips of a train; what follows a step of its reference is front-loaded
_SCATTER_RATIO = 0.8  # speeds of slips scatter less than their distances: a larger one has a longer dwell
_LEAST_SCATTER = 0.09  # scatter of the logarithms of speeds in this comparison, 1: at least
_READINGS = 3.0  # scatter that a count makes, counts of a slip
_ENOUGH_FOR_SCATTER = 4  # motions that a scatter is estimated from, 1: at least
_DRIVEN_SHARE = 0.35  # speed of the reference at rest, of the speed beside it: with more the reference drives the joint
# Mean travel of the reference over a rest, in parts of its whole travel there: 0.5 if its speed is constant, next to
# nothing if it steps at the end, next to 1 if it steps at the beginning, above 1 if it turns.
_STEADY = (0.25, 0.8)
_STEADY_BETWEEN_STEPS = (0.4, 0.6)  # likewise, where the reference stands while the joint moves
_LEAST_ADVANCE = 0.2  # mean advance of the reference over a rest, bands: less is noise
_LEAST_STEP = 0.2  # of the travel of the reference during the rest beside it: a slip that keeps up with the reference
_CREEP_SHARE = 0.1  # motion within a rest, of those on both sides: so little is creep
_LARGEST_SLIP = 2.0  # last slip of a train, of the slip before: at most, as it is like those before
# Net travel, of the path: a lightly damped joint bounces back, a motion to and fro has less.
_LEAST_PATH_EFFICIENCY = 0.5
_LEAST_PEAK_SPEED_RATIO = 1.3  # peak speed, of the reference's: with less the joint follows the reference
_MOST_BURSTS = 2  # bursts in a slip, 1: between two it may have stopped too briefly to be seen, but not again and again
# Slip, of the train's median: a smaller one may be the first part of a slip that goes on in a moment.
_WHOLE_SLIP = 0.75
# Swings in a row that are reported as hunting, 1: where two of them stop at their turns; else, or where they are small.
_TRAIN_OF_HUNTING, _TRAIN_OF_ROUND_SWINGS = 3, 8
_STOPS_OF_HUNTING = _TRAIN_OF_HUNTING - 1  # of them stop at their turns, 1: the first may begin with a move
_SMALL_SWING = 12.0  # swing, bands: a reading that wanders swings so far now and then, though not evenly
_HUNTING_SHRINKS = 0.7  # swing, of the last one: with less the motion settles; a growth by more is no hunting
_EVEN = 1.4  # duration without its stop, of the swing before the last, which went the same way
_SUSTAINED = 0.95  # swing without a stop, of the last one: less is free oscillation that dies out
_MIDDLE_OF_HUNTING = 0.5  # duration of 80 % of a swing's way, of the swing's: half a cosine takes 0.59
_TRAIN = 9  # cycles whose median is the usual slip, 1
_RESTS_KEPT = 15  # latest rests that may lie within one of the coarse scale, 1
_PENDING = 64  # cycles that wait for their train, rests for a slip after their creep, 1: at most


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A motion between two rests.

    Attributes
    ----------
    distance : signed [rad]; period : with the dwell before it [s].
    shape : its course; bands : its distance in bands, the smallest motion that is told from rest.
    """

    distance: float
    period: float
    shape: SlipShape
    bands: float

    @property
    def log_speed(self) -> float:
        """Logarithm of the mean speed, rest included."""
        return math.log(abs(self.distance) / self.period)


class SpringEvidence:
    """Whether motions between rests are slips of a spring that is drawn on steadily, without the reference.

    A person, a planner and a pick-and-place program stop and go as well. But the slips of one joint under one
    controller are pieces of one damped cosine: whatever their distance, their middle halves last equally long. And
    since the spring is wound up at one speed, dwell and slip together last as long as the distance takes at that speed.
    Motions that are commanded one by one have neither, or they have both without the scatter of friction, and are
    distinguished by their number.

    The evidence is the logarithm of the ratio of two likelihoods, added up from motion to motion (Wald's sequential
    test, in the cumulative form of Page): that of slips of one natural frequency at one speed, and that of separate
    motions. The widths are in logarithms, so that no constant carries a unit; `docs/detection.md` has the figures that
    they rest on.

    Attributes
    ----------
    total : the logarithm of the likelihood ratio for the present train.
    certain : whether its motions are slips.
    """

    def __init__(self) -> None:
        self.total = 0.0
        self.certain = False
        self._train: deque[Motion] = deque(maxlen=_LOOKED_BACK)

    def fits(self, motion: Motion) -> bool:
        """Whether a motion would be another slip of a train of which it is certain."""
        return self.certain and self._evidence(motion) > _LEAST

    def add_motion(self, motion: Motion) -> bool:
        """Take the next motion; returns whether the train goes on, else it begins with this one."""
        evidence = self._evidence(motion)
        self.total = min(self.total + evidence, _MOST)
        goes_on = bool(self._train) and self.total > 0.0 and not self._scatters([*self._train, motion])
        if not goes_on:
            self.restart()
        self._train.append(motion)
        if self.total < _GIVEN_UP or self._is_front_loaded() or self._is_straight():
            self.certain = False
        elif self.total >= ENOUGH:
            self.certain = True
        return goes_on

    def restart(self) -> None:
        """Forget the train."""
        self.total, self.certain = 0.0, False
        self._train.clear()

    def _evidence(self, motion: Motion) -> float:
        """Logarithm of the likelihood ratio of one motion, given those before it."""
        if not self._train:
            return 0.0
        one_way = motion.distance * self._train[-1].distance > 0
        if not (one_way or self.certain):
            # Slips at a steady speed go one way.
            return -math.inf
        known = [math.log(one.shape.middle_half) for one in self._train if one.shape.middle_half > 0]
        duration = motion.shape.middle_half
        deviation = math.log(duration) - median(known) if duration > 0 and known else math.inf
        evidence = _fit(deviation, _DURATION, _DURATION_APART, len(known))
        # The first dwell of a train may have begun long before it mattered.
        speeds = [one.log_speed for one in self._train][1 if len(self._train) > 1 else 0 :]
        evidence += _fit(motion.log_speed - median(speeds), _SPEED, _SPEED_APART, len(self._train))
        share, share_apart = (_ONE_WAY, _ONE_WAY_APART) if one_way else (1 - _ONE_WAY, 1 - _ONE_WAY_APART)
        return evidence + math.log(share / share_apart)

    def _scatters(self, train: list[Motion]) -> bool:
        """Whether speeds scatter as distances do: nothing ties these to the periods, as when each motion is set off."""
        train = train[-_LOOKED_BACK:]
        if len(train) < _ENOUGH_FOR_SCATTER:
            return False
        speeds = _scatter([one.log_speed for one in train[1:]])
        distances = _scatter([math.log(abs(one.distance)) for one in train])
        readings = 1.0 / median(one.bands for one in train)
        return speeds > math.hypot(_LEAST_SCATTER, _READINGS * readings, _SCATTER_RATIO * distances)

    def _is_front_loaded(self) -> bool:
        known = [one.shape.asymmetry for one in self._train if math.isfinite(one.shape.asymmetry)]
        return bool(known) and median(known) > _LARGEST_ASYMMETRY

    def _is_straight(self) -> bool:
        return 2 * sum(one.shape.straight for one in self._train) > len(self._train)


def _scatter(logarithms: list[float]) -> float:
    """Standard deviation by the differences from one to the next: a change of speed now and then is no scatter."""
    return math.sqrt(0.5 * fmean((one - other) ** 2 for one, other in pairwise(logarithms)))


def _fit(deviation: float, width: float, width_apart: float, count: int) -> float:
    """Logarithm of the likelihood ratio of a deviation from the median of so many."""
    if not math.isfinite(deviation):
        return math.log(_ODD_ONES)
    # What few have is known no better than that.
    width *= math.sqrt(1.0 + 1.0 / count)
    exponent = -0.5 * deviation**2 * (width**-2 - width_apart**-2)
    return math.log((1.0 - _ODD_ONES) * width_apart / width * math.exp(exponent) + _ODD_ONES)


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
    hunting : whether it is a swing to and fro about the reference.
    reference_speed : of the reference during the slip, as a mean [rad/s]; NaN if unknown, or if the reference stood and
        commanded neither the slip nor the stops beside it.
    creep : for so long before the breakaway the joint crept towards it [s]; part of the dwell.
    stands : for how long the joint stood after it, as far as that is known [s].
    dated : whether breakaway and arrest are known better than to a sample, so that friction can be learnt from it.
    driven : whether the reference went on during the dwell, steadily, as far as that is known; else it may have stood.
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
    stands: float = math.inf
    dated: bool = True
    driven: bool = True

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
        self._rests: deque[Rest] = deque(maxlen=_RESTS_KEPT)  # between which the motions are decided
        self._crept: list[Rest] = []  # after motions so small beside the one before that they may be creep
        self._early: Cycle | None = None
        self._closed: Rest | None = None
        self._distance = 0.0  # of the motion before the last rest
        self._pending: list[Cycle] = []
        self._spring = SpringEvidence()
        self._train: deque[float] = deque(maxlen=_TRAIN)  # distances of the cycles that follow one another
        self._swings: list[Swing] = []
        self._turned = math.nan  # when the joint left the turn that the last one told ended at
        self._reported_swings = 0  # of these, how many are published
        self._told_until = -math.inf  # arrest of the last cycle told

    def record(self, recent: Sequence[Cycle]) -> CycleRecord:
        """What the recent cycles, oldest first, and the last rests tell of the time after them."""
        rest, before = self._last(1), self._last(2)
        # Where it may only have crept since, it has left the last of these rests.
        left = self._crept[-1] if self._crept else rest
        last_breakaway = left.breakaway if left is not None else math.nan
        stop_before = before.breakaway if before is not None and before.direction_before else math.nan
        crept = any(one is not None and one.coarse for one in (rest, before))
        if not recent:
            return CycleRecord(last_breakaway=last_breakaway, stop_before=stop_before, crept=crept)
        last = recent[-1]
        in_last_rest = rest is not None and before is not None and last.breakaway == before.breakaway
        seen = last_breakaway if in_last_rest else self._turned if last.hunting else last.arrest
        # A stand that the reference did not draw on says nothing of how long the joint sticks.
        timed = [cycle for cycle in recent if cycle.driven] or recent
        return CycleRecord(
            cycles=len(recent),
            # The median, because a long smooth stretch between two rests makes a long cycle too.
            period=median(cycle.period for cycle in timed),
            # A swing is known only when the joint has turned: until then its period alone speaks.
            slip=math.inf if last.hunting else max(cycle.slip_duration for cycle in recent),
            dwell=math.inf if last.hunting else max(cycle.dwell for cycle in timed),
            distance=max(abs(cycle.slip_distance) for cycle in recent),
            reached=last.position + last.slip_distance,
            cycle_end=seen,
            last_breakaway=last_breakaway,
            stop_before=stop_before,
            crept=crept,
        )

    @property
    def last_rest(self) -> Rest | None:
        """The last rest that ends a motion which is decided."""
        return self._last(1)

    def _last(self, back: int) -> Rest | None:
        return self._rests[-back] if len(self._rests) >= back else None

    @property
    def may_detect_at_arrest(self) -> bool:
        """Whether :meth:`detect_at_arrest` may return a cycle before the next rest is complete."""
        return self._early is None and self._closed is None and not self._crept and bool(self._train)

    def detect_at_arrest(self, rest: Rest) -> Cycle | None:
        """The cycle that ends in a rest which has only begun, if that is certain already, once.

        The cycle is final: :meth:`add_rest` or :meth:`finish` returns it once more, completed from the whole rest.
        """
        if self.last_rest is None or not self.may_detect_at_arrest:
            return None
        self._early = self._certain_already(self.last_rest, rest)
        return self._early

    def _certain_already(self, before: Rest, rest: Rest) -> Cycle | None:
        cycle = _cycle(before, rest)
        if cycle is None or self._distance * cycle.slip_distance <= 0:
            return None
        if abs(cycle.slip_distance) < _WHOLE_SLIP * median(self._train):
            return None
        if _uncommanded(before, rest):
            return cycle if self._spring.fits(_motion(cycle, rest)) else None
        if not rest.slip.peak_speed_ratio >= _LEAST_PEAK_SPEED_RATIO or rest.slip.bursts > _MOST_BURSTS:
            return None
        # The rest that has just begun will be like the last one.
        certain = (
            _keeps_up(cycle.slip_distance, before.reference_advance)
            and _is_driven(before, cycle, before, rest)
            and _is_driven(rest, cycle, before, rest)
        )
        return cycle if certain else None

    def finish(self, rest: Rest | None) -> list[Cycle]:
        """The cycle that ended in a rest which still lasts (None if there is none), where the samples end there."""
        if rest is None or self._closed is not None:
            early, self._early = self._early, None
            return [early] if early is not None else []
        cycles = self.add_rest(rest)
        self._closed = rest
        return cycles

    def add_rest(self, rest: Rest) -> list[Cycle]:
        """Take the next rest and return the cycles that are now certain, oldest first."""
        before = self.last_rest
        if rest.coarse and before is not None and rest.arrest < (self._crept[-1] if self._crept else before).breakaway:
            self._lengthen(rest)
            return []
        closed, self._closed = self._closed, None
        early, self._early = self._early, None
        if before is None or (closed is not None and rest.arrest < closed.breakaway):
            self._rests.append(rest)
            return []
        certain: list[Cycle] = []
        crept, self._crept = self._crept, []
        lags = math.isfinite(before.advance_until(rest)) and self._may_creep(before, rest)
        if lags and 0 < len(crept) < _PENDING:
            # The reference shows that the joint is left behind. Its contact may yield at each step of the reference.
            self._crept = [*crept, rest]
            return []
        if crept and abs(crept[-1].position - before.position) < _CREEP_SHARE * abs(rest.position - crept[-1].position):
            before = self._rests[-1] = reduce(Rest.until, crept, before)
            crept = []
        for one in crept:
            certain += self._decide(before, one)
            before = one
        if self._may_creep(before, rest):
            self._crept = [rest]
            return self._once(certain)
        certain += self._decide(before, rest)
        if early is not None and early.breakaway not in [cycle.breakaway for cycle in certain]:
            certain.append(early)
        return self._once(certain)

    def _lengthen(self, rest: Rest) -> None:
        """Let a rest last as long as one of the coarse scale that it begins, if the joint all but crept since."""
        within = [one for one in self._rests if one.breakaway > rest.arrest]
        if not within:
            self._crept = [*(one for one in self._crept if one.breakaway <= rest.arrest), rest]
            return
        before = self._last(len(within) + 1)
        slip = abs(within[0].position - before.position) if before is not None else math.inf
        if all(abs(one.position - within[0].position) < _CREEP_SHARE * slip for one in within):
            for _ in within:
                self._rests.pop()
            self._rests.append(within[0].until(rest))
            self._crept = []

    def _may_creep(self, before: Rest, rest: Rest) -> bool:
        """Whether the joint moved so little between two rests, beside the motion before, that it may have crept."""
        distance = rest.position - before.position
        keeps_up = _keeps_up(distance, before.advance_until(rest))
        return abs(distance) < _CREEP_SHARE * abs(self._distance) and not keeps_up

    def add_swing(self, swing: Swing) -> list[Cycle]:
        """Take a swing about the reference, and return the cycles of hunting that are now certain."""
        if not _hunts_on(self._swings, swing):
            self._end_hunting()
        # A joint that hunts overshoots its reference; one that is pushed, by hand or by the load of another, need not.
        beyond = swing.band / abs(swing.distance)
        if not -beyond <= swing.error / swing.distance <= 1.0 + beyond:
            self._end_hunting()
            return []
        self._swings.append(swing)
        small = abs(swing.distance) < _SMALL_SWING * swing.band
        # Two masses that ring keep up three swings without a stop now and then, for their oscillations beat.
        certain_soon = not small and sum(map(_sticks, self._swings)) >= _STOPS_OF_HUNTING
        if len(self._swings) < (_TRAIN_OF_HUNTING if certain_soon else _TRAIN_OF_ROUND_SWINGS):
            return []
        self._turned = swing.turned
        certain, self._swings = self._swings[self._reported_swings :], self._swings[-_TRAIN_OF_ROUND_SWINGS:]
        self._reported_swings = len(self._swings)
        return self._once([_cycle_of_swing(one) for one in certain])

    def _once(self, cycles: list[Cycle]) -> list[Cycle]:
        """Those of the cycles that were not told before: a slip may be seen between two rests and as a swing."""
        new = [cycle for cycle in cycles if 0.5 * (cycle.breakaway + cycle.arrest) > self._told_until]
        self._told_until = max([self._told_until, *(cycle.arrest for cycle in new)])
        return new

    def _decide(self, before: Rest, rest: Rest) -> list[Cycle]:
        """The cycles that are certain once the motion between two rests, the next of which is complete, is known."""
        self._rests.append(rest)
        distance_before, self._distance = self._distance, rest.position - before.position
        cycle = _cycle(before, rest)
        if _uncommanded(before, rest):
            certain = self._without_reference(cycle, rest)
        else:
            self._restart()
            certain = []
            if cycle is not None:
                cycle = replace(cycle, driven=_is_driven(before, cycle, before, rest))
                certain = self._with_reference(cycle, before, rest, distance_before)
        if cycle is None or cycle not in certain:
            self._train.clear()
        self._train.extend(abs(one.slip_distance) for one in certain)
        return certain

    def _with_reference(self, cycle: Cycle, before: Rest, rest: Rest, distance_before: float) -> list[Cycle]:
        if not rest.slip.peak_speed_ratio >= _LEAST_PEAK_SPEED_RATIO or rest.slip.bursts > _MOST_BURSTS:
            return []
        if _keeps_up(cycle.slip_distance, rest.reference_advance) and _is_driven(rest, cycle, before, rest):
            return [cycle]
        # The last one, before the reference stops or turns, is like those before it.
        went_on = distance_before * cycle.slip_distance > 0
        usual = not self._train or abs(cycle.slip_distance) <= _LARGEST_SLIP * self._train[-1]
        return [cycle] if went_on and usual and cycle.driven else []

    def _without_reference(self, cycle: Cycle | None, rest: Rest) -> list[Cycle]:
        if cycle is None:
            # What went to and fro in between was no slip.
            self._restart()
            return []
        if rest.slip.bursts > _MOST_BURSTS:
            return []
        motion = _motion(cycle, rest)
        was_certain, fits = self._spring.certain, self._spring.fits(motion)
        if not self._spring.add_motion(motion):
            self._pending = []
        if was_certain:
            return [cycle] if fits else []
        self._pending = [*self._pending[-_PENDING:], cycle]
        if not self._spring.certain:
            return []
        certain, self._pending = self._pending, []
        return certain

    def _restart(self) -> None:
        self._spring.restart()
        self._pending = []

    def _end_hunting(self) -> None:
        self._swings = []
        self._reported_swings = 0


def _cycle(before: Rest, rest: Rest) -> Cycle | None:
    """The slip between two rests, None if it is a motion to and fro."""
    distance = rest.position - before.position
    if rest.arrest <= before.breakaway or distance == 0 or rest.slip.path_efficiency < _LEAST_PATH_EFFICIENCY:
        return None
    moved, commanded = rest.seen_from - before.seen_until, not _uncommanded(before, rest)
    return Cycle(
        breakaway=before.breakaway,
        arrest=rest.arrest,
        dwell=before.dwell,
        creep=before.breakaway - before.creep_onset,
        stands=rest.dwell,
        dated=before.dated and rest.dated,
        slip_distance=distance,
        position=before.position,
        effort=before.effort,
        reference_speed=abs(_meanwhile(before, rest)) / moved if commanded and moved > 0.0 else math.nan,
    )


def _cycle_of_swing(swing: Swing) -> Cycle:
    """A swing as a cycle of hunting, with the stop at the turn before it as its dwell."""
    return Cycle(
        breakaway=swing.left,
        arrest=swing.arrest,
        dwell=swing.left - swing.reached,
        slip_distance=swing.distance,
        position=swing.position,
        effort=swing.effort,
        hunting=True,
        reference_speed=abs(swing.reference_velocity),
    )


def _sticks(swing: Swing) -> bool:
    """Whether it sticks, or creeps, and so lasts longer at its turns than free oscillation, which is half a cosine."""
    return swing.middle < _MIDDLE_OF_HUNTING * (swing.arrest - swing.reached)


def _hunts_on(swings: Sequence[Swing], swing: Swing) -> bool:
    """Whether a swing is like those before it, about a reference that stands or goes on evenly."""
    if not swings:
        return True
    last = swings[-1]
    # As the reference sees it: where that goes on, the joint goes farther one way than the other.
    kept = abs((swing.distance - swing.travel) / (last.distance - last.travel))
    lasted = (swing.arrest - swing.left) / (swings[-2].arrest - swings[-2].left) if len(swings) > 1 else 1.0
    faster = (swing.reference_velocity - last.reference_velocity) * (swing.arrest - swing.reached)
    return (
        swing.reached == last.arrest
        and (_HUNTING_SHRINKS if _sticks(swing) else _SUSTAINED) <= kept <= 1.0 / _HUNTING_SHRINKS
        and 1.0 / _EVEN <= lasted <= _EVEN
        and abs(faster) <= max(STANDS * abs(swing.distance), swing.band)
    )


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
    return rest.reference - before.reference_left


def _uncommanded(before: Rest, rest: Rest) -> bool:
    """Whether the reference is unknown, or stood through both rests and the motion between, and commanded neither."""
    stood = before.reference_advance == rest.reference_advance == _meanwhile(before, rest) == 0.0
    return stood or math.isnan(rest.reference_advance)


def _keeps_up(distance: float, travel: float) -> bool:
    """Whether a motion is no less than a part of the reference's travel; not if that is unknown.

    A hop that leaves the joint far behind is the start of a motion, or creep, and no step of a staircase.
    """
    return abs(distance) >= _LEAST_STEP * abs(travel)


def _is_driven(rest: Rest, cycle: Cycle, before: Rest, after: Rest) -> bool:
    """Whether the reference went on while the joint rested, steadily, and the same way as in the slip beside it.

    Which way the joint slips is no matter: a load may pull it past its reference, and integral action back.
    """
    if rest.dwell <= 0:
        return False
    direction = math.copysign(1.0, rest.reference_advance)
    advance, mean = direction * rest.reference_advance, direction * rest.reference_mean_advance
    meanwhile = direction * _meanwhile(before, after)
    if not meanwhile >= -STANDS * abs(cycle.slip_distance):
        return False  # it turned, or where it was is not known
    # A reference that stands while the joint moves is one that steps, and a servo answers late.
    stands = meanwhile <= STANDS * abs(cycle.slip_distance) and advance > _LEAST_STEP * abs(cycle.slip_distance)
    least, most = _STEADY_BETWEEN_STEPS if stands else _STEADY
    if mean < _LEAST_ADVANCE * rest.band or not least * advance <= mean <= most * advance:
        return False
    speed = max(cycle.mean_speed, meanwhile / cycle.slip_duration) if cycle.slip_duration > 0 else math.inf
    # What the joint crept after it is not left behind.
    return advance - direction * rest.crept >= _DRIVEN_SHARE * speed * rest.dwell
