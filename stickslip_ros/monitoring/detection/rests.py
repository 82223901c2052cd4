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
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stickslip_ros.monitoring.detection import _crossing_kernel as kernel
from stickslip_ros.monitoring.detection.motion import MotionRecord, Swing
from stickslip_ros.monitoring.detection.rest_ends import (
    braking_crossings,
    end_of_creep,
    fastest,
    rest_ends,
    rest_gaps,
    slow_times,
)
from stickslip_ros.monitoring.detection.slip_shape import SlipShape, slip_shape
from stickslip_ros.monitoring.samples import Batch, FloatArray

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
_CREPT = 0.2  # creep, of the slip before: a joint at rest may creep so far
_FEW_SAMPLES = 6.0  # duration of a stop, samples: with less its course must show it, as its ends cannot be extrapolated
_SAMPLES_OF_A_COURSE = 9.0  # duration between two halves of the fastest motion, samples: a shorter one shows no course
_SHARE_OF_STOP = 0.38  # slow, of the time between half of the fastest motion: a dip to nothing has 0.41, see slow_times
_STANDING = 0.002  # measured velocity less its noise, of the fastest motion: with less the joint stands
_FEW_GAPS = 2  # gaps of a rest, 1: with more the joint crept
_LEAST_CREEP = 0.005  # creep, of the slip before: less is how gently a slip begins
_EDGE = 0.1  # time from the ends of a rest, of the rest: a creeping joint comes to rest, and leaves, there
_TURN = 1.5  # time since the last crossing, of that to the arrest: a joint that turns round sets a crossing by then
_FRACTIONS = np.linspace(0.02, 0.98, 17)  # places in a count, 1: where a joint may have come to rest
_MIDDLE = np.array([0.5])  # the same, without a search


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


class RestDetector:
    """Finds the rests in a stream of samples; how the stream is cut into batches makes no difference.

    Attributes
    ----------
    motion : remembers the samples and judges every slice of time.
    """

    def __init__(self, window: float = 1.0) -> None:
        self.motion = MotionRecord(window)
        self._rest_end = 0
        # When and where the joint left its last rest, and its reference then.
        self._left = (math.nan, math.nan, math.nan)

    def feed(self, samples: Batch) -> Iterator[Rest | Swing]:
        """Take samples and yield each rest when it is complete, and if awaited also when it has certainly begun.

        Swings about a reference that stands are yielded when they are complete.

        What is known by then may be changed in between. A rest that has only begun is not :attr:`Rest.complete`.
        Whether one is awaited is told to ``motion``.

        Parameters
        ----------
        samples : in strict order of time, with finite positions; a joint whose measured velocity was never seen
            slow did not rest.
        """
        for event in self.motion.follow(samples):
            if isinstance(event, Swing):
                yield event
                continue
            rest = self._rest_in_interval() if event else self._begun_rest()
            if event and rest is None:
                self.motion.did_not_rest()
            if rest is not None:
                yield rest

    def _begun_rest(self) -> Rest | None:
        """The rest that lasts at the last sample, if the joint has stood for longer than it takes to turn round."""
        # Fitted to the braking alone, the place within a count dates the arrest to 5 ms instead of 8.
        motion = self._motion_before(_FRACTIONS)
        if motion is None:
            return None
        crossings, _, arrest = motion
        last, now = crossings[-1, [kernel.TIME, kernel.FLAT_END]].tolist()
        if now != self.motion.last_detected or not arrest < now - _TURN * (arrest - last):
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
        motion = self.motion
        head = motion.crossing_count
        oldest = max(self._rest_end, head - kernel.RING)
        if head - oldest < 2:
            return None
        newest = motion.crossings(head - 1, head - 1)[0]
        longest, duration = motion.longest_gap
        stands = newest[kernel.FLAT_END] - newest[kernel.TIME]
        last = longest if longest > oldest and duration > stands else head - 1
        before = motion.crossings(oldest, last)
        core = before[-1]
        way = float(core[kernel.POSITION] - before[0, kernel.POSITION])
        if abs(way) < _LEAST_SLIP_BANDS * motion.band:
            return None
        speed = fastest(before[1:])
        direction = 1 if way > 0 else -1
        begin, end = float(core[kernel.TIME]), float(core[kernel.FLAT_END])
        if not motion.band < kernel.SLOW * speed * (end - begin):
            return None
        left = braking_crossings(before[::-1], speed)
        places = float(core[kernel.POSITION]) + direction * motion.band * np.repeat(fractions[:, None], 2, axis=1)
        arrest, _, _ = rest_ends(left, before[:0], places, begin, end, direction, 0)
        return before, direction, arrest

    def _begun(self, before: FloatArray, direction: int, arrest: float) -> Rest:
        """The rest after these crossings, as if it ended with the last one's stand."""
        core = before[-1]
        return self._rest(
            before, core[None, :], arrest, float(core[kernel.FLAT_END]), float(core[kernel.POSITION]), direction, 0
        )

    def _rest_in_interval(self) -> Rest | None:
        """Decide whether the low-speed interval just completed was a rest, and when it began and ended."""
        newest = self.motion.crossing_count - 1
        longest, _ = self.motion.longest_gap
        oldest = max(self._rest_end, newest - kernel.RING + 1)
        if longest < oldest:
            return None
        crossings = self.motion.crossings(oldest, newest)
        initial = oldest == 0 and longest == 0
        speed_before = np.inf if initial else fastest(crossings[1 : longest - oldest + 1]) if longest > oldest else 0.0
        speed_after = self.motion.speed_after
        slowest = min(speed_before, speed_after)
        travel = abs(float(crossings[longest - oldest, kernel.POSITION] - crossings[0, kernel.POSITION]))
        # Counts are told from creep by their slowness; where motion has hundreds of them, by their mean speed.
        creep = _CREEP if travel > _FINE * self.motion.band else _CREEP_OF_COUNTS
        if not initial and travel > 0.0:
            creep = max(creep, min(kernel.SLOW, _GENTLE * math.sqrt(self.motion.band / travel)))
        farthest = max(_CREPT * travel, self.motion.band)
        first, last = rest_gaps(crossings, longest - oldest, self.motion.band, creep * slowest, farthest)
        before, after = crossings[: first + 1], crossings[last + 1 :]
        travelled = abs(float(before[-1, kernel.POSITION] - before[0, kernel.POSITION]))
        if len(after) == 0 or (not initial and travelled < _LEAST_SLIP_BANDS * self.motion.band):
            return None
        end = last
        if crossings[last, kernel.FLAT_END] <= before[-1, kernel.TIME]:
            # It moved with every sample, if slowly: the gap is the rest.
            end = last + 1
            _stand_until(crossings[last], crossings[end])
        rest_begin, rest_end = float(before[-1, kernel.TIME]), float(crossings[last, kernel.FLAT_END])
        moved = abs(float(crossings[end, kernel.POSITION] - before[-1, kernel.POSITION]))
        if not max(self.motion.band, moved) < kernel.SLOW * slowest * (rest_end - rest_begin):
            return None
        flat_end = rest_end
        measured = crossings[first : last + 1, kernel.SLOWEST]
        # Until its steps were seen, a velocity's resolution is not known, and a constant offset may be rest.
        pace = float(np.nanmin(measured)) - self.motion.velocity_band if np.isfinite(measured).any() else math.nan
        if pace > creep * slowest:
            return None
        crept_on = pace > _STANDING * slowest
        direction_after = 1 if float(after[-1, kernel.POSITION] - crossings[last, kernel.POSITION]) > 0 else -1
        direction_before = 0
        if not initial:
            back = before[max(-4, -len(before)), kernel.POSITION]
            direction_before = 1 if float(before[-1, kernel.POSITION] - back) > 0 else -1
        left = before[:0] if initial else braking_crossings(before[::-1], speed_before)
        right = braking_crossings(after, speed_after)
        begin = float(before[-1, kernel.POSITION])
        crept = direction_after * float(crossings[last, kernel.POSITION] - begin)
        speed = speed_after if initial else max(speed_before, speed_after)
        creep_onset = math.inf
        left_at, left_from, slip = end_of_creep(crossings, longest - oldest, last, speed, direction_after)
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
            places = np.full((1, 2), begin + 0.5 * direction_before * self.motion.band)
        else:
            width = crept + self.motion.band
            places = np.repeat(begin + direction_after * _FRACTIONS[:, None] * width, 2, axis=1)
        arrest, breakaway, certain = rest_ends(
            left, right, places, rest_begin, rest_end, direction_before, direction_after
        )
        dated = True
        stops = initial or self._stops(crossings, longest - oldest, slowest)
        if certain and breakaway > arrest:
            span = float(right[-1, kernel.TIME] - left[-1, kernel.TIME]) - (breakaway - arrest)
            certain = breakaway - arrest < (_LEAST_DWELL_OF_CREEP if crept_on else _LEAST_DWELL) * span
        elif crept_on:
            return None
        if certain or breakaway <= arrest:
            # By the motion on both sides the joint only slowed down. Of a stop of few samples they say nothing.
            short = flat_end - rest_begin < _FEW_SAMPLES * self.motion.update
            if crept_on or not (short and stops and direction_before * direction_after > 0):
                return None
            arrest, breakaway, dated = rest_begin, flat_end, False
        elif breakaway - arrest < _FEW_SAMPLES * self.motion.update and not stops:
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

    def _stops(self, crossings: FloatArray, longest: int, fastest: float) -> bool:
        """Whether the course of the speed shows a stop at the longest gap, and no dip; not if samples are too few."""
        slow, until_fast = slow_times(crossings, longest, fastest)
        return slow > _SHARE_OF_STOP * until_fast and until_fast > _SAMPLES_OF_A_COURSE * self.motion.update

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
        cut = self._rest_end < self.motion.crossing_count - kernel.RING
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
            band=self.motion.band,
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
