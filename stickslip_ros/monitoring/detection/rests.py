# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When a joint came to rest and when it left: arrests and breakaways from position alone.

The position is read as an encoder or a noisy sensor gives it. Resolution and noise are measured on the
signal itself and set the band whose crossings carry the motion; a stretch much slower than the
motion on both sides of it is a candidate. Its ends are extrapolated, since a joint comes to rest with
finite deceleration, x_a − x ∝ (t_a − t)², and leaves gently, x − x_a ∝ (t − t_b)³ while the friction
still remembers rest, so that the first count can come late. If that extrapolation leaves no dwell the
joint slowed down without stopping.

Real joints creep before they slip, as bristles bend. Such a joint breaks away where it leaves the creep: at about 5 %
of the slip's fastest motion. This is found from the slip, which is the same in identical cycles, by extrapolating it
backward to where the creep has brought the joint by then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.detection import _crossing_kernel as kernel
from stickslip_ros.monitoring.detection.motion import CrossingRecord, LowSpeed, MotionRecord
from stickslip_ros.monitoring.detection.slip_shape import SlipShape, slip_shape
from stickslip_ros.monitoring.samples import FloatArray

_LEFT = (0.3, 0.6)  # speeds, of the fastest beside the rest: between them a slip creeps no more, and does not turn yet
_FEW_COUNTS = 3  # counts, 1: so few may be those of a slip, which scatter about the power law
_CERTAIN = 0.5  # time by which a creep is too early, of the time that the slip takes to get fast
_WINDOW_SPEED = 0.4  # speed, of the fastest: up to it motion is extrapolated to the rest
_WINDOW_CROSSINGS = 6  # crossings that are extrapolated, 1: at most
_ENOUGH_CROSSINGS = 3  # crossings, 1: the speed of the first spans the rest itself
_NEAREST_CROSSINGS = 5  # crossings nearest to the rest that are always extrapolated, 1
_WINDOW_SHARE = 0.3  # way from the rest, of the way of the slow motion: up to it crossings are extrapolated
_NEARNESS = 0.5  # weight of a crossing, of that of the one nearer to the rest: the power laws hold at the rest itself
# Exactly at the rest the powers of the way are 1/2 and 1/3. Over the crossings that an encoder gives, the
# deceleration shrinks towards the arrest (1/3 if it vanished), and the spring relaxes after the breakaway.
_ARREST_POWER = 0.45
_BREAKAWAY_POWER = 0.36
_LEAST_SLIP_BANDS = 3.0  # way of a slip, bands: less is no motion before a rest
_LEAST_DWELL = 0.105  # dwell, of the span of the crossings that it is extrapolated from
# The same where a measured velocity never stood: a dip of the speed looks like a dwell of 0.44 at most. A longer one is
# a rest on a contact that gives way, whose creep a fine velocity shows.
_LEAST_DWELL_OF_CREEP = 0.5
_CREEP = 0.05  # speed, of the fastest motion beside it: a joint at rest may creep so fast
_CREEP_OF_COUNTS = 0.025  # the same where counts show how slow the creep is
_GENTLE = (
    0.4  # of the fastest motion, over the root of the slip in bands: a cosine goes its first band no slower than 1
)
_FINE = 2000.0  # way of a slip, bands: with more, counts say nothing by themselves
_LASTING = 0.25  # end of a rest, of its dwell: one of the fine scale that lasts into it is the same rest
_LEAST_COARSE_DWELL = 1.0  # dwell on the coarse scale, s: twenty slices of time, or it is dated too roughly
_CREPT = 0.2  # creep, of the slip before: a joint at rest may creep so far
_FEW_SAMPLES = 6.0  # duration of a stop, samples: with less its course must show it, as its ends cannot be extrapolated
_SAMPLES_OF_A_COURSE = 9.0  # duration between two halves of the fastest motion, samples: a shorter one shows no course
_SHARE_OF_STOP = 0.38  # slow, of the time between half of the fastest motion: a dip to nothing has 0.41, see slow_times
# The same where the joint crept between the slips. Until the speed is back at 0.4 of the fastest a dip has 0.44.
_SHARE_OF_CREEP = 0.5
_FAST_AGAIN = 0.4  # speed, of the fastest motion before: a low-speed interval ends with it, and the slip goes on
_STANDING = 0.002  # measured velocity less its noise, of the fastest motion: with less the joint stands
_FEW_GAPS = 2  # gaps of a rest, 1: with more the joint crept
_LEAST_CREEP = 0.005  # creep, of the slip before: less is how gently a slip begins
_SLOW_BY_SAMPLES = 0.3  # motion a sample, of the fastest: a slower one is slow, whatever the stamps say
_EDGE = 0.1  # time from the ends of a rest, of the rest: a creeping joint comes to rest, and leaves, there
_TURN = 1.5  # time since the last crossing, of that to the arrest: a joint that turns round sets a crossing by then
_FRACTIONS = np.linspace(0.02, 0.98, 17)  # places in a count, 1: where a joint may have come to rest
_MIDDLE = np.array([0.5])  # the same, without a search


def rest_gaps(
    crossings: NDArray[np.float64], longest: int, band: float, limit: float, farthest: float
) -> tuple[int, int]:
    """First and last gap of the rest around the longest gap: joints creep at rest, and encoders flicker.

    The rest goes on as long as the mean speed from its present end stays below the limit [rad/s], and
    it stays within ``farthest`` of the longest gap [rad].
    """
    times, positions = crossings[:, kernel.TIME], crossings[:, kernel.POSITION]
    first = last = longest
    grown = True
    while grown:
        grown = False
        ways = np.maximum(np.abs(positions[last + 2 :] - positions[last + 1]), band)
        near = np.logical_and.accumulate(np.abs(positions[last + 2 :] - positions[longest]) <= farthest)
        slow = np.flatnonzero(near & (ways <= limit * (times[last + 2 :] - times[last + 1])))
        if len(slow):
            last += int(slow[-1]) + 1
            grown = True
        ways = np.maximum(np.abs(positions[:first] - positions[first]), band)
        near = np.logical_and.accumulate(np.abs(positions[:first][::-1] - positions[longest]) <= farthest)[::-1]
        slow = np.flatnonzero(near & (ways <= limit * (times[first] - times[:first])))
        if len(slow):
            first = int(slow[0])
            grown = True
    return first, last


def slow_times(crossings: NDArray[np.float64], longest: int, fastest: float) -> tuple[float, float]:
    """How long the motion about its longest gap was slower than a tenth, and than a half, of the fastest motion [s].

    Of a speed that dips to nothing as a cosine does the first is 0.41 of the second. Of one that passes through zero,
    or dips less far, it is less, and of one that stops it is more.
    """
    speeds, times = np.abs(crossings[:, kernel.SPEED]), crossings[:, kernel.TIME]
    lasted = []
    for level in (kernel.SLOW * fastest, 0.5 * fastest):
        before = np.flatnonzero(speeds[: longest + 1] >= level)
        after = np.flatnonzero(speeds[longest + 1 :] >= level)
        begin = int(before[-1]) if len(before) else 0
        end = longest + (int(after[0]) if len(after) else len(times) - 1 - longest)
        lasted.append(float(times[max(end, longest + 1)] - times[begin]))
    return lasted[0], lasted[1]


def end_of_creep(
    crossings: NDArray[np.float64], first: int, last: int, fastest: float, direction: int
) -> tuple[int, float, NDArray[np.float64]]:
    """The last crossing before the joint leaves the creep, where it leaves it [rad], and crossings of the slip.

    These are taken where the slip has become fast, which is the same part of every one of identical slips. A joint that
    leaves a place came through it before it left: what was crossed earlier than these can have begun there is creep.
    The place lies between the last such crossing and the next one. NaN where the crossings do not tell.
    """
    speeds = np.abs(crossings[last + 1 :, kernel.SPEED])
    # The speed of the first spans the rest itself.
    quick = np.flatnonzero(speeds > _LEFT[0] * min(fastest, float(np.max(speeds, initial=0.0))))
    begin = last + 1 + (int(quick[0]) if len(quick) else 0)
    begin = max(last + 1, min(begin, len(crossings) - _ENOUGH_CROSSINGS))
    fast = np.flatnonzero(speeds[begin - last - 1 :] > _LEFT[1] * fastest)
    fast = fast[fast >= _ENOUGH_CROSSINGS]
    slip = crossings[begin : begin + int(fast[0]) if len(fast) else len(crossings)]
    if len(slip) < _ENOUGH_CROSSINGS:
        return last, math.nan, slip
    slip = slip[np.unique(np.linspace(0, len(slip) - 1, min(len(slip), _WINDOW_CROSSINGS)).astype(int))]
    times, positions = crossings[first:begin, kernel.TIME], crossings[first:begin, kernel.POSITION]
    begins, errors = _extrapolate(
        slip[:, kernel.TIME], direction * (slip[None, :, kernel.POSITION] - positions[:, None]), _BREAKAWAY_POWER, 1.0
    )
    crept = np.flatnonzero(np.isfinite(errors) & (times < begins))
    if len(crept) <= _FEW_COUNTS:
        # Single counts of a slip scatter about the power law; one that is creep comes far too early.
        crept = crept[times[crept] < begins[crept] - _CERTAIN * float(np.ptp(slip[:, kernel.TIME]))]
    if not len(crept):
        return last, math.nan, slip
    at = int(crept[-1])
    place = float(positions[at])
    if at + 1 < len(times) and np.isfinite(errors[at + 1]):
        early, late = begins[at] - times[at], times[at + 1] - begins[at + 1]
        place += float(early / (early + late) * (positions[at + 1] - place))
    else:
        place += 0.5 * float(crossings[first + at + 1, kernel.POSITION] - place)
    return first + at, place, slip


def fastest(crossings: NDArray[np.float64]) -> float:
    """Fastest motion at these crossings, without the few outliers that noise and jittered stamps make [rad/s]."""
    return _fast_share(np.abs(crossings[:, kernel.SPEED]))


def _fast_share(speeds: FloatArray) -> float:
    # np.quantile, which takes ten times as long for so few.
    rank = kernel.FAST_SHARE * (len(speeds) - 1)
    below = int(rank)
    ordered = np.partition(speeds, sorted({below, min(below + 1, len(speeds) - 1)}))
    share, low, high = rank - below, float(ordered[below]), float(ordered[min(below + 1, len(speeds) - 1)])
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1.0 - share)


def braking_crossings(crossings: NDArray[np.float64], fastest: float) -> NDArray[np.float64]:
    """The crossings next to the rest, while the motion is still slow; evenly thinned."""
    fast = np.flatnonzero(np.abs(crossings[:, kernel.SPEED]) > _WINDOW_SPEED * fastest)
    # Not before the third crossing: the speed of the first spans the rest itself.
    fast = fast[fast >= _ENOUGH_CROSSINGS]
    end = int(fast[0]) if len(fast) else len(crossings)
    # Nor beyond a turn: a lightly damped joint bounces back before it rests.
    steps = np.diff(crossings[:end, kernel.POSITION])
    turned = np.flatnonzero(steps * steps[0] < 0) if len(steps) else steps
    end = int(turned[0]) + 1 if len(turned) else end
    way = np.abs(crossings[:end, kernel.POSITION] - crossings[0, kernel.POSITION])
    end = max(min(end, _NEAREST_CROSSINGS), int(np.searchsorted(way, _WINDOW_SHARE * way[-1])) if end else 0)
    chosen = np.unique(np.linspace(0, max(end - 1, 0), min(end, _WINDOW_CROSSINGS)).astype(int))
    window: NDArray[np.float64] = crossings[chosen]
    return window


def rest_ends(
    left: NDArray[np.float64],
    right: NDArray[np.float64],
    places: NDArray[np.float64],
    flat_begin: float,
    flat_end: float,
    direction_before: int,
    direction_after: int,
) -> tuple[float, float, bool]:
    """Arrest, breakaway and whether both are extrapolated.

    Each row of ``places`` is where the joint may have come to rest and where it may have left; the row
    that fits the motion on both sides best is taken. If none does and the stop is short, the joint did
    not rest, and the arrest returned is after the breakaway.
    """
    arrest, breakaway = None, None
    residual = np.zeros(len(places))
    if len(left) >= _ENOUGH_CROSSINGS:
        way = direction_before * (places[:, :1] - left[None, :, kernel.POSITION])
        arrest, error = _extrapolate(left[:, kernel.TIME], way, _ARREST_POWER, -1.0)
        residual = residual + np.where(arrest < flat_end, error, np.inf)
    if len(right) >= _ENOUGH_CROSSINGS:
        way = direction_after * (right[None, :, kernel.POSITION] - places[:, 1:])
        breakaway, error = _extrapolate(right[:, kernel.TIME], way, _BREAKAWAY_POWER, 1.0)
        residual = residual + np.where(breakaway > flat_begin, error, np.inf)
    best = int(np.argmin(residual))
    if not np.isfinite(residual[best]):
        span = sum(float(np.ptp(side[:, kernel.TIME])) for side in (left, right) if len(side))
        return (flat_begin, flat_end, False) if flat_end - flat_begin > span else (flat_end, flat_begin, True)
    arrest_time = flat_begin if arrest is None else max(float(arrest[best]), flat_begin)
    breakaway_time = flat_end if breakaway is None else min(float(breakaway[best]), float(right[0, kernel.TIME]))
    return arrest_time, breakaway_time, arrest is not None and breakaway is not None


def _extrapolate(
    times: NDArray[np.float64], ways: NDArray[np.float64], power: float, sign: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where t = t_0 ± c way^power meets zero way, for each row of ways, and the squared residuals [s], [s²]."""
    z = np.maximum(ways, 0.0) ** power
    t = times - times[0]
    # The power laws hold at the rest itself; the farther, the less.
    weights = _NEARNESS ** np.arange(len(t))
    weights /= weights.sum()
    z_mean, t_mean = z @ weights, float(t @ weights)
    z_centred, t_centred = z - z_mean[:, None], t - t_mean
    slope = (z_centred * weights) @ t_centred / np.maximum((z_centred**2) @ weights, TINY)
    error = ((t_centred[None, :] - slope[:, None] * z_centred) ** 2) @ weights
    error = np.where(sign * slope > 0, error, np.inf)
    return times[0] + t_mean - slope * z_mean, error


@dataclass(frozen=True, kw_only=True)
class Rest:
    """A rest between two motions.

    Attributes
    ----------
    arrest, breakaway : [s]; the first rest of a record has the record's first stamp as arrest.
    creep_onset : when it began to creep towards the breakaway [s]; the breakaway itself where no creep was seen.
    position : [rad]; crept : how far the joint moved within the rest, signed [rad].
    direction_before, direction_after : ±1, of the motion on either side; 0 before the first rest.
    slip : the course of the motion before.
    band : the smallest motion that is told from rest [rad].
    seen_from, seen_until : from the last reading that it moved before to the last one before it moved again [s].
    reference : place of the reference at ``seen_from``, or the way that it had gone if only its velocity is given
        [rad]; NaN if unknown.
    reference_advance : how far it went on while the joint was at rest, signed [rad]; NaN if unknown.
    reference_left : place of the reference at ``seen_until`` [rad]; it may be known when that at ``seen_from`` is not.
    reference_mean_advance : how far it had gone on, as a mean over the rest [rad]: half of that for a steady reference,
        next to nothing for one that steps and sets off the motion.
    effort : measured effort at breakaway [N·m], NaN if unknown.
    complete : whether the joint has left it; else the breakaway is the last sample's time.
    dated : whether its ends follow from the motion beside it; else they are those of samples.
    coarse : whether the joint crept all the while, and rested but for that.
    """

    arrest: float
    breakaway: float
    creep_onset: float
    position: float
    crept: float
    direction_before: int
    direction_after: int
    slip: SlipShape
    band: float
    seen_from: float
    seen_until: float
    reference: float
    reference_advance: float
    reference_left: float
    reference_mean_advance: float
    effort: float
    complete: bool = True
    dated: bool = True
    coarse: bool = False

    @property
    def dwell(self) -> float:
        """Time at rest [s]."""
        return self.breakaway - self.arrest

    def advance_until(self, later: Rest) -> float:
        """Travel of the reference from the beginning of this rest to that of a later one [rad], NaN if unknown."""
        return later.reference - self.reference

    def until(self, later: Rest) -> Rest:
        """One rest of this one and a later one, between which the joint only crept."""
        lasted, lasts = self.seen_until - self.seen_from, later.seen_until - later.seen_from
        ahead = self.advance_until(later)
        means = self.reference_mean_advance * lasted + (ahead + later.reference_mean_advance) * lasts
        return replace(
            later,
            arrest=self.arrest,
            direction_before=self.direction_before,
            slip=self.slip,
            dated=self.dated and later.dated,
            seen_from=self.seen_from,
            crept=later.position + 0.5 * later.crept - self.position + 0.5 * self.crept,
            reference=self.reference,
            reference_advance=ahead + later.reference_advance,
            reference_mean_advance=means / (lasted + lasts) if lasted + lasts > 0.0 else 0.0,
        )


def _way_of(crossings: FloatArray) -> float:
    """Signed way to the last crossing from the one farthest from it [rad]: a motion may come back to its place."""
    ways = crossings[-1, kernel.POSITION] - crossings[:, kernel.POSITION]
    return float(ways[np.argmax(np.abs(ways))])


class RestDetector:
    """Finds the rests in what ``motion`` follows; how the samples are cut into batches makes no difference.

    A joint that creeps moves with every sample of a fine encoder, and all that is seen of it then is slow motion. The
    same search on a coarse scale, that of the joint's usual motion in a slice of time, takes it as a rest. It is
    needed where the fine one finds no rest that lasts as long.

    Attributes
    ----------
    motion : remembers the samples and judges every slice of time.
    """

    def __init__(self, window: float = 1.0) -> None:
        self.motion = MotionRecord(window)
        self._fine, self._coarse = _RestSearch(self.motion), _RestSearch(self.motion.coarse)
        self._pending: Rest | None = None  # of the coarse scale, as long as the fine one may find it, too

    def rests_at(self, event: LowSpeed) -> list[Rest]:
        """The rests at an event of ``motion``, oldest first: complete, or begun if that is certain.

        A rest that has only begun is not :attr:`Rest.complete`; what is known of it may be changed later. A joint whose
        measured velocity was never seen slow did not rest.
        """
        if event is LowSpeed.COARSE:
            settled = self._settled()
            if _lasts(self._fine.left, self._coarse.slow_since, self.motion.last_detected):
                self._coarse.leave_with(self._fine)
            else:
                self._pending = self._coarse.complete_rest()
            return settled
        settled = self._settled() if self._pending and self._fine.slow_since > self._pending.breakaway else []
        rest = self._fine.complete_rest() if event is LowSpeed.COMPLETE else self._fine.begun_rest()
        return [*settled, rest] if rest is not None else settled

    def unfinished_rest(self) -> Rest | None:
        """The rest that lasts at the last sample, as if it ended there; None if the joint moves."""
        return self._fine.unfinished_rest()

    def _settled(self) -> list[Rest]:
        """The pending rest of the coarse scale, if no rest of the fine one lasts into its last quarter."""
        rest, self._pending = self._pending, None
        if rest is None or rest.dwell < _LEAST_COARSE_DWELL or _lasts(self._fine.left, rest.arrest, rest.breakaway):
            return []
        self._fine.leave_with(self._coarse)
        return [replace(rest, coarse=True)]


def _lasts(left: float, arrest: float, breakaway: float) -> bool:
    """Whether a rest that ended at ``left`` lasts into the last quarter of another one; not if there was none."""
    return left > breakaway - _LASTING * (breakaway - arrest)


class _RestSearch:
    """Search for rests among the crossings of one scale."""

    def __init__(self, record: CrossingRecord) -> None:
        self._record = record
        self._rest_end = 0
        # When and where the joint left its last rest, and its reference then.
        self._left = (math.nan, math.nan, math.nan)

    @property
    def left(self) -> float:
        """When the joint left its last rest [s]; NaN before the first."""
        return self._left[0]

    @property
    def slow_since(self) -> float:
        """When the joint came to the place where it is, or was, slowest [s]."""
        longest, _ = self._record.longest_gap
        return float(self._record.crossings(longest, longest)[0, kernel.TIME])

    def leave_with(self, other: _RestSearch) -> None:
        """Go on from the end of the last rest that another search has found."""
        newest = self._record.crossing_count - 1
        oldest = max(self._rest_end, newest - kernel.RING + 1)
        times = self._record.crossings(oldest, newest)[:, kernel.TIME]
        self._rest_end, self._left = oldest + int(np.searchsorted(times, other.left)), other._left

    def complete_rest(self) -> Rest | None:
        """The rest in the low-speed interval just completed; None if the joint did not rest."""
        newest = self._record.crossing_count - 1
        longest, _ = self._record.longest_gap
        oldest = max(self._rest_end, newest - kernel.RING + 1)
        rest, slowed = None, True
        if longest >= oldest:
            crossings = self._record.crossings(oldest, newest)
            slowed = longest == oldest or self._slow_by_samples(crossings, longest - oldest)
            if slowed:
                # Each look may lengthen a stand in its crossings.
                rest = self._rest_in_interval(crossings.copy(), oldest, longest - oldest)
                rest = rest or self._rest_in_interval(crossings, oldest, longest - oldest, creeps=True)
        if rest is None:
            self._record.did_not_rest(slowed=slowed)
        return rest

    def begun_rest(self) -> Rest | None:
        """The rest that lasts at the last sample, if the joint has stood for longer than it takes to turn round."""
        # Fitted to the braking alone, the place within a count dates the arrest to 5 ms instead of 8.
        motion = self._motion_before(_FRACTIONS)
        if motion is None:
            return None
        crossings, _, arrest = motion
        last, now = crossings[-1, [kernel.TIME, kernel.FLAT_END]].tolist()
        if now != self._record.last_detected or not arrest < now - _TURN * (arrest - last):
            return None
        return self._begun(*motion)

    def unfinished_rest(self) -> Rest | None:
        """The rest that lasts at the last sample, as if it ended there; None if the joint moves."""
        motion = self._motion_before(_MIDDLE)
        return self._begun(*motion) if motion is not None else None

    def _motion_before(self, fractions: NDArray[np.float64]) -> tuple[FloatArray, int, float] | None:
        """The crossings before the rest that lasts at the last sample, their direction, and when it began [s].

        None if the joint moves.

        Parameters
        ----------
        fractions : of a count, where the joint may have come to rest beyond the last one seen.
        """
        record = self._record
        head = record.crossing_count
        oldest = max(self._rest_end, head - kernel.RING)
        if head - oldest < 2:
            return None
        newest = record.crossings(head - 1, head - 1)[0]
        longest, duration = record.longest_gap
        stands = newest[kernel.FLAT_END] - newest[kernel.TIME]
        last = longest if longest > oldest and duration > stands else head - 1
        before = record.crossings(oldest, last)
        core = before[-1]
        way = _way_of(before)
        if abs(way) < _LEAST_SLIP_BANDS * record.band:
            return None
        speed = fastest(before[1:])
        direction = 1 if way > 0 else -1
        begin, end = float(core[kernel.TIME]), float(core[kernel.FLAT_END])
        if not record.band < kernel.SLOW * speed * (end - begin):
            return None
        left = braking_crossings(before[::-1], speed)
        places = float(core[kernel.POSITION]) + direction * record.band * np.repeat(fractions[:, None], 2, axis=1)
        arrest, _, _ = rest_ends(left, before[:0], places, begin, end, direction, 0)
        return before, direction, arrest

    def _begun(self, before: FloatArray, direction: int, arrest: float) -> Rest:
        """The rest after these crossings, as if it ended with the last one's stand."""
        core = before[-1]
        return self._rest(
            before, core[None, :], arrest, float(core[kernel.FLAT_END]), float(core[kernel.POSITION]), direction, 0
        )

    def _rest_in_interval(
        self, crossings: FloatArray, oldest: int, longest: int, *, creeps: bool = False
    ) -> Rest | None:
        """Decide whether the low-speed interval just completed was a rest, and when it began and ended.

        How fast counts may be at rest depends on the band, and on the little that is known of the slip after it. Where
        that finds none, ``creeps``, a stretch ten times slower than the slip before is one if it lasts longer than any
        dip does and the motion goes on the same way, however fine the encoder.

        Parameters
        ----------
        crossings : since the last rest; a stand among them may be lengthened. oldest : number of the first of them.
        longest : which of them the longest gap follows.
        """
        initial = oldest == 0 and longest == 0
        speed_before = np.inf if initial else fastest(crossings[1 : longest + 1]) if longest > 0 else 0.0
        speed_after = self._record.speed_after
        slowest = min(speed_before, speed_after)
        travel = abs(_way_of(crossings[: longest + 1]))
        # Counts are told from creep by their slowness; where motion has hundreds of them, by their mean speed.
        creep = _CREEP if travel > _FINE * self._record.band else _CREEP_OF_COUNTS
        if not initial and travel > 0.0:
            creep = max(creep, min(kernel.SLOW, _GENTLE * math.sqrt(self._record.band / travel)))
        if creeps:
            slowest = min(speed_before, speed_after / _FAST_AGAIN)
            if initial or not self._crept(crossings, longest, slowest):
                return None
            creep = kernel.SLOW
        farthest = max(_CREPT * travel, self._record.band)
        first, last = rest_gaps(crossings, longest, self._record.band, creep * slowest, farthest)
        before, after = crossings[: first + 1], crossings[last + 1 :]
        if len(after) == 0 or (not initial and abs(_way_of(before)) < _LEAST_SLIP_BANDS * self._record.band):
            return None
        end = last
        if crossings[last, kernel.FLAT_END] <= before[-1, kernel.TIME]:
            # It moved with every sample, if slowly: the gap is the rest.
            end = last + 1
            _stand_until(crossings[last], crossings[end])
        rest_begin, rest_end = float(before[-1, kernel.TIME]), float(crossings[last, kernel.FLAT_END])
        moved = abs(float(crossings[end, kernel.POSITION] - before[-1, kernel.POSITION]))
        if not max(self._record.band, moved) < kernel.SLOW * slowest * (rest_end - rest_begin):
            return None
        flat_end = rest_end
        measured = crossings[first : last + 1, kernel.SLOWEST]
        # Until its steps were seen, a velocity's resolution is not known, and a constant offset may be rest.
        pace = float(np.nanmin(measured)) - self._record.velocity_band if np.isfinite(measured).any() else math.nan
        shows_its_course = rest_end - rest_begin > _SAMPLES_OF_A_COURSE * self._record.update
        if shows_its_course and pace * (rest_end - rest_begin) > self._record.band + moved:
            # The slowest that was measured is more than the position went on the whole: a filter comes down late.
            pace = math.nan
        if pace > creep * slowest:
            return None
        crept_on = pace > _STANDING * slowest
        direction_after = 1 if float(after[-1, kernel.POSITION] - crossings[last, kernel.POSITION]) > 0 else -1
        direction_before = 0
        if not initial:
            back = before[max(-4, -len(before)), kernel.POSITION]
            direction_before = 1 if float(before[-1, kernel.POSITION] - back) > 0 else -1
        if creeps and direction_before != direction_after:
            return None
        left = before[:0] if initial else braking_crossings(before[::-1], speed_before)
        right = braking_crossings(after, speed_after)
        begin = float(before[-1, kernel.POSITION])
        crept = direction_after * float(crossings[last, kernel.POSITION] - begin)
        speed = speed_after if initial else max(speed_before, speed_after)
        creep_onset = math.inf
        left_at, left_from, slip = end_of_creep(crossings, longest, last, speed, direction_after)
        if last - first > _FEW_GAPS or crept < 0 or (left_at > last and abs(left_from - begin) > _LEAST_CREEP * travel):
            # The joint crept: where it came to rest and where it left is known, and not the same.
            edges = rest_begin + np.array([_EDGE, 1.0 - _EDGE]) * (rest_end - rest_begin)
            at = np.searchsorted(crossings[:, kernel.TIME], edges, side="right") - 1
            places = crossings[at, kernel.POSITION][None, :]
            if abs(left_from - begin) > _LEAST_CREEP * travel:
                ends = rest_ends(left, right, places, rest_begin, rest_end, direction_before, direction_after)
                creep_onset = ends[1]
                places[0, 1], right, last = left_from, slip, left_at
                rest_end = float(crossings[last, kernel.FLAT_END])
        elif direction_before * direction_after < 0:
            places = np.full((1, 2), begin + 0.5 * direction_before * self._record.band)
        else:
            width = crept + self._record.band
            places = np.repeat(begin + direction_after * _FRACTIONS[:, None] * width, 2, axis=1)
        arrest, breakaway, certain = rest_ends(
            left, right, places, rest_begin, rest_end, direction_before, direction_after
        )
        dated = True
        stops = initial or self._stops(crossings, longest, slowest)
        if certain and breakaway > arrest:
            span = float(right[-1, kernel.TIME] - left[-1, kernel.TIME]) - (breakaway - arrest)
            certain = breakaway - arrest < (_LEAST_DWELL_OF_CREEP if crept_on else _LEAST_DWELL) * span
        elif crept_on:
            return None
        if certain or breakaway <= arrest:
            # By the motion on both sides the joint only slowed down. Of a stop of few samples they say nothing.
            short = flat_end - rest_begin < _FEW_SAMPLES * self._record.update
            if crept_on or not (short and stops and direction_before * direction_after > 0):
                return None
            arrest, breakaway, dated = rest_begin, flat_end, False
        elif breakaway - arrest < _FEW_SAMPLES * self._record.update and not stops:
            return None
        rest = self._rest(
            before,
            crossings[first : last + 1],
            arrest,
            breakaway,
            float(0.5 * (begin + crossings[last, kernel.POSITION])),
            direction_before,
            direction_after,
            creep_onset=max(creep_onset, arrest),
            dated=dated,
        )
        self._rest_end, self._left = (
            oldest + last + 1,
            (breakaway, rest.position + 0.5 * rest.crept, rest.reference_left),
        )
        return rest

    def _slow_by_samples(self, crossings: FloatArray, longest: int) -> bool:
        """Whether the joint was slow in its longest gap by the number of samples, too.

        Of samples that wait and come together the stamps are late, and the time between them shows stands.
        """
        band, places, numbers = self._record.band, crossings[:, kernel.POSITION], crossings[:, kernel.SAMPLE]
        step, samples = (float(np.diff(values[longest : longest + 2])[0]) for values in (places, numbers))
        stood = max(samples - 1.0, samples * band / max(abs(step), band))
        beside = np.abs(places[2:] - places[:-2]) / np.maximum(numbers[2:] - numbers[:-2], 1.0)
        return band < _SLOW_BY_SAMPLES * _fast_share(beside) * stood

    def _stops(self, crossings: FloatArray, longest: int, fastest: float) -> bool:
        """Whether the course of the speed shows a stop at the longest gap, and no dip; not if samples are too few."""
        slow, until_fast = slow_times(crossings, longest, fastest)
        return slow > _SHARE_OF_STOP * until_fast and until_fast > _SAMPLES_OF_A_COURSE * self._record.update

    def _crept(self, crossings: NDArray[np.float64], longest: int, fastest: float) -> bool:
        """Whether the joint was slow about its longest gap for longer than a dip is, blurred by samples and counts."""
        slow, until_fast = slow_times(crossings, longest, fastest)
        uncertain = max(self._record.update, _FEW_COUNTS * self._record.band / fastest) if fastest > 0.0 else math.inf
        return slow > _SHARE_OF_CREEP * until_fast + 2.0 * uncertain

    def _rest(
        self,
        slip: FloatArray,
        crossings: FloatArray,
        arrest: float,
        breakaway: float,
        position: float,
        direction_before: int,
        direction_after: int,
        *,
        creep_onset: float = math.inf,
        dated: bool = True,
    ) -> Rest:
        """A rest over the flats of these crossings; with those of the slip before it, or the last of a long one."""
        shape = SlipShape()
        first, last = crossings[0], crossings[-1]
        crept = float(last[kernel.POSITION] - first[kernel.POSITION])
        left, place, reference_left = self._left
        # What was noted before the joint is taken to have left is creep.
        slip = slip[slip[:, kernel.TIME] > left]
        cut = self._rest_end < self._record.crossing_count - kernel.RING
        if cut and len(slip) > 2:
            # How fast it was still shows; how long it took, no more.
            at, places, references = (slip[:, column] for column in (kernel.TIME, kernel.POSITION, kernel.REFERENCE))
            shape = replace(slip_shape(at, places, references), middle_half=math.nan, asymmetry=math.nan)
        elif len(slip) > 1:
            shape = slip_shape(
                np.concatenate([[left], slip[:, kernel.TIME], [max(arrest, slip[-1, kernel.TIME])]]),
                np.concatenate([[place], slip[:, kernel.POSITION], [position - 0.5 * crept]]),
                np.concatenate([[reference_left], slip[:, kernel.REFERENCE], [first[kernel.REFERENCE]]]),
            )
        durations = crossings[:, kernel.FLAT_END] - crossings[:, kernel.TIME]
        advances = crossings[:, kernel.ADVANCE] + (crossings[:, kernel.REFERENCE] - first[kernel.REFERENCE]) * durations
        # A joint that creeps stands nowhere for long: from one stand to the next the reference goes on evenly.
        between = crossings[1:, kernel.TIME] - crossings[:-1, kernel.FLAT_END]
        means = 0.5 * (crossings[1:, kernel.REFERENCE] + crossings[:-1, kernel.REFERENCE_FLAT_END])
        advanced = float(advances.sum() + ((means - first[kernel.REFERENCE]) * between).sum())
        lasted = float(last[kernel.FLAT_END] - first[kernel.TIME])
        reference = float(last[kernel.REFERENCE_FLAT_END])
        return Rest(
            arrest=arrest,
            breakaway=breakaway,
            creep_onset=min(creep_onset, breakaway),
            position=position,
            crept=crept,
            direction_before=direction_before,
            direction_after=direction_after,
            slip=shape,
            band=self._record.band,
            seen_from=float(first[kernel.TIME]),
            seen_until=float(last[kernel.FLAT_END]),
            reference=float(first[kernel.REFERENCE]),
            reference_advance=reference - float(first[kernel.REFERENCE]),
            reference_left=reference,
            reference_mean_advance=advanced / lasted if lasted > 0.0 else 0.0,
            effort=float(last[kernel.EFFORT_FLAT_END]),
            complete=direction_after != 0,
            dated=dated,
        )


def _stand_until(crossing: FloatArray, after: FloatArray) -> None:
    """Let a crossing's stand last until the next one, in place."""
    crossing[kernel.FLAT_END] = after[kernel.TIME]
    crossing[kernel.REFERENCE_FLAT_END] = after[kernel.REFERENCE]
    crossing[kernel.EFFORT_FLAT_END] = after[kernel.EFFORT_FLAT_END]
    crossing[kernel.ADVANCE] = (
        0.5 * (after[kernel.REFERENCE] - crossing[kernel.REFERENCE]) * (after[kernel.TIME] - crossing[kernel.TIME])
    )
