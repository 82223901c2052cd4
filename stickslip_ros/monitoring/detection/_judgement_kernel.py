# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled record of a joint's recent past, and what it shows: the rest that is open, speeds, a finding.

:mod:`._motion_kernel` fills the record, sample by sample.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.monitoring._quantile_kernel import quantile
from stickslip_ros.monitoring.detection import _crossing_kernel as kernel
from stickslip_ros.monitoring.detection import _swing_kernel as swings

PAST = 4096  # latest slices that are kept, 1
STEPS = 256  # sample intervals of a slice that are kept, 1
TURNS = 256  # turns that are kept, 1: samples that are followed at once hold no more
_RECENT_CROSSINGS = 64  # latest crossings that are compared with the present gap, 1
GAPS_AT_REST = 3.0  # time since the last crossing, usual gaps: after a longer one the joint is at rest
_FEW_STEPS = 2  # steps of a reading that flickers, 1: so few may go one way

# Columns of what is remembered of a slice.
TIME, PLACE, REFERENCE_PLACE, WAY, ERROR, VELOCITY_ERROR = range(6)
PAST_COLUMNS = VELOCITY_ERROR + 1
MOTION = np.dtype(
    [
        ("first_time", float),
        ("now", float),
        ("position", float),
        ("reference", float),
        ("reference_velocity", float),
        ("way", float),  # place of the reference, or the way that it has gone where only its velocity is given
        ("travels", np.bool_),  # whether the reference is known
        ("referenced", float),  # when it was known last
        ("follows", np.bool_),  # whether the reference only repeats what was measured
        ("before", float),  # where the joint was when the two were compared last
        ("compared", float),  # how often they were, lately
        ("followed", float),  # how often the reference had followed
        ("interval", float),  # between samples
        ("turned", float),  # when the motion turned
        ("turns", float, TURNS),  # when it did so, the latest times
        ("turn_count", np.int64),  # how often
        ("direction", float),
        ("pace", float),  # way in a slice of time, as a running median
        ("coarse_complete", np.bool_),  # whether a low-speed interval of the coarse scale is complete
        ("rested_at", float),  # when it was last seen at rest
        ("rest_began", float),  # and since when it was
        ("slice", float),  # number of the slice that is open, NaN if none is
        ("slice_begin", float),  # first stamp in it
        ("slice_error", float),  # largest tracking error in it
        ("slice_referenced", np.bool_),  # whether each sample in it had a reference position
        ("steps", float, STEPS),  # intervals in it
        ("slice_steps", np.int64),  # how many
        ("last_end", float),  # last stamp of the slice before
        ("last_position", float),  # position there
        ("last_reference", float),  # reference there
        ("past", float, (PAST, PAST_COLUMNS)),  # the slices remembered
        ("entries", np.int64),  # slices ever remembered
        ("code", np.int64),  # what the last slice showed
        ("closed", np.int64),  # slices reported since this was set to zero
        ("window", float),  # over which velocities are taken where none is given
        # What is known of the cycles.
        ("cycles", np.int64),  # recent ones
        ("period", float),  # their median
        ("slip", float),  # longest of them
        ("dwell", float),  # likewise
        ("distance", float),  # farthest of them
        ("reached", float),  # where the last one ended
        ("cycle_end", float),  # end of the last cycle, or of the rest in which it ended
        ("last_breakaway", float),  # of the last rest, NaN before the first
        ("stop_before", float),  # breakaway of the rest before that, NaN if there was none between two motions
        ("crept", np.bool_),  # whether the joint crept in one of the last two rests
        ("needed", float),  # how long motion without a rest must last before it is called smooth
        # What the last motion showed that was not even: a code, its number, and when it was seen last.
        ("uneven", np.int64),
        ("unevenness", float),
        ("uneven_at", float),
        # Swings about the reference.
        ("way_began", float),  # of the reference, where it began to go the way that it goes
        ("way_farthest", float),  # and how far it has come
        ("swing_direction", float),  # of the motion since the last turn, 0 before the first
        ("swing_turned", np.bool_),  # whether a turn was seen since then
        ("turn", np.int64),  # crossing of the last turn
        ("farthest", np.int64),  # crossing that has gone farthest since then
        ("swing", float, swings.SWING_COLUMNS),  # the latest complete one
        ("swung", np.bool_),  # whether it is new
        # When to look whether the joint has come to rest.
        ("awaits_rest", np.bool_),  # whether anybody asks
        ("looked", np.int64),  # crossings there were at the last look, -1 before the first
        ("look_after", float),  # for how long it must then have stood
    ]
)

# What the motion shows.
(
    TOO_FEW, STICKS, AT_REST, STUCK, REVERSING, TOO_SHORT, STOPS_AND_GOES, DIPS, MOVES, STEPS_OF_COUNTS, FEW_COUNTS,
    FEW_READINGS, NOT_FOLLOWING, BURSTS,
) = range(14)  # fmt: skip

PERIODS_TO_TRUST = 2.0  # duration of motion, cycle or natural periods: with less it is not called smooth
_OUTLIVES = 2.0  # time, way or dwell, of that of the longest recent slip: with more what was found says nothing of now
_CYCLES_AT_MOST = 1.9  # the same, usual cycles: not two, since an arrest is seen a little late
_RECENT_STOPS = 10.0  # age of a stop, of the motion needed
_CYCLES_FOR_STICK_SLIP = 2  # cycles in a row, 1
_TRAVELLED = 10.0  # way, bands: with more, and still going, a reference has left a joint at rest behind
_FINEST = 2.0 * np.pi / 2**24  # band of a joint that has never moved, rad: a count of the finest encoders
_EVEN = 1.5  # fastest part of a reference, of its mean speed, 1: at most, where the joint has to go with it
_WITH_IT = (2.0 / 3.0, 1.5)  # way of a joint, of that of its reference: within, it goes with it
_LONG_ENOUGH = 3.0  # motion in which it has to, with counts enough, of that needed: slow changes of speed are smooth
# Of the mean speed: what a dip must fall below, once or again and again, for the joint to be at risk.
_DIP, DIP_AGAIN = 0.2, 0.7
_DEEPER = 0.5  # slowest share, of the reference's own: at most
_BANDS_OF_A_SPEED = 10.0  # way that a speed is measured over, bands: a band more or less is a tenth
_BRIEFEST = 0.02  # duration of a dip, of the motion that is judged: less than half a cycle of the fastest stick-slip
_AGAIN = 5  # dips in the motion that is judged, 1: faster than a person moves, or most joints ring when they set off
LEAST_READINGS = 20.0  # readings in the motion that is judged, 1: stick-slip has up to 10 cycles a second
_START = 0.25  # start from rest or from a turn, of the motion needed: that it swings there is no dip
_LEAST_CROSSINGS = 20  # crossings in the motion that is searched for dips and steps, 1: at least
_SAMPLES_SEARCHED = 9.0 * _AGAIN  # samples that are searched for dips, 1: nine of each cycle
_STEPPED = 24  # crossings that show whether a joint steps, 1
_GAPS_OF_A_STEP = 4  # bands of a slip, 1: with fewer it is too short to be seen as one
_UNEVEN = 4.0  # longest gap of a joint that steps, of the shortest one beside it
_NOTICED = 0.5  # uneven gaps, of all gaps: with more the joint steps
_ENOUGH_CROSSINGS = 3  # gaps that a speed spans, 1: the rhythm of counts and samples is no change of speed


@compiled()
def errors(since, motion):
    """Largest tracking error and velocity error of the slices since a time; NaN where none is known."""
    tracking, velocity = motion.slice_error, np.nan
    for n in range(motion.entries - 1, max(-1, motion.entries - PAST - 1), -1):
        entry = n % PAST
        if motion.past[entry, TIME] < since:
            break
        if not motion.past[entry, ERROR] <= tracking and np.isfinite(motion.past[entry, ERROR]):
            tracking = motion.past[entry, ERROR]
        if not motion.past[entry, VELOCITY_ERROR] <= velocity and np.isfinite(motion.past[entry, VELOCITY_ERROR]):
            velocity = motion.past[entry, VELOCITY_ERROR]
    return tracking, velocity


@helper()
def _crossing_time(back, detector):
    """Time of a crossing counted from the latest one, which is the first [s]."""
    return detector.crossings[(detector.head - back) % kernel.RING, kernel.TIME]


@helper()
def last_crossing_time(detector):
    """Time of the latest crossing [s]; -inf before any."""
    return _crossing_time(1, detector) if detector.head else -np.inf


@helper()
def _flickers_since(least_duration, detector):
    """Since when the joint has stayed within less than any slip, to and fro, if for so long or always; else NaN.

    A joint that goes one way moves, however slowly; two steps are too few to tell.
    """
    head = detector.head
    low, high, steps, turns, step_before, since = np.inf, -np.inf, -1, 0, 0.0, np.nan
    n = head - 1
    while n >= max(0, head - kernel.RING):
        place = detector.crossings[n % kernel.RING, kernel.POSITION]
        low, high = min(low, place), max(high, place)
        if high - low > swings.FLICKER * detector.position.band:
            break
        steps += 1
        if steps > 0:
            step = detector.crossings[(n + 1) % kernel.RING, kernel.POSITION] - place
            turns += 1 if step * step_before < 0.0 else 0
            step_before = step
        since = detector.crossings[n % kernel.RING, kernel.TIME]
        if detector.last_time - since >= least_duration and turns > 0:
            return since
        n -= 1
    long_enough = n < 0 or detector.last_time - since >= least_duration
    return since if long_enough and (turns > 0 or steps <= _FEW_STEPS) else np.nan


@compiled()
def open_rest(least_duration, detector):
    """Since when the joint has been at rest, if by now that can be told from slow motion; else NaN.

    A reading that flickers for so long [s] is at rest, too.
    """
    head = detector.head
    last = last_crossing_time(detector)
    if head < 2:
        return last if head else np.nan
    flat = detector.last_time - last
    if not flat > GAPS_AT_REST * detector.update:
        return _flickers_since(least_duration, detector)
    count = min(head, _RECENT_CROSSINGS) - 1
    gaps, speeds = np.empty(count), np.empty(count)
    for n in range(count):
        crossing, before = (head - 1 - n) % kernel.RING, (head - 2 - n) % kernel.RING
        gaps[n] = detector.crossings[crossing, kernel.TIME] - detector.crossings[before, kernel.TIME]
        speeds[n] = abs(detector.crossings[crossing, kernel.SPEED])
    usual = max(quantile(gaps, count, 0.5), detector.update)
    fastest = quantile(speeds, count, kernel.FAST_SHARE)
    stands = flat > GAPS_AT_REST * usual and detector.position.band < kernel.SLOW * fastest * flat
    return last if stands else _flickers_since(least_duration, detector)


@inlined()
def slowest_share(since, clock, detector):
    """Slowest motion since a time over the mean there, 0 to 1, and how often the speed dipped.

    1 and 0 if it has not picked up again. ``clock`` : the crossings' column that counts as time.
    """
    head = detector.head
    first = head
    while first > max(0, head - kernel.RING) and detector.crossings[(first - 1) % kernel.RING, kernel.TIME] >= since:
        first -= 1
    begin, end = first % kernel.RING, (head - 1) % kernel.RING
    way = abs(detector.crossings[end, kernel.POSITION] - detector.crossings[begin, kernel.POSITION])
    duration = detector.crossings[end, clock] - detector.crossings[begin, clock]
    mean = way / duration
    if mean == 0.0:
        return 1.0, 0
    least, briefest = _BANDS_OF_A_SPEED * detector.position.band, _BRIEFEST * duration
    # Over several gaps, so that the rhythm of counts and samples does not pass for a change of speed. A dip is slow
    # between two that are fast: neither a gentle start is one, nor slowing down before the motion has picked up again.
    fast, slowest, candidate = False, np.inf, np.inf
    dips, lowest, back = 0, np.inf, first
    for n in range(first + _ENOUGH_CROSSINGS, head):
        crossing, before = n % kernel.RING, (n - _ENOUGH_CROSSINGS) % kernel.RING
        way = abs(detector.crossings[crossing, kernel.POSITION] - detector.crossings[before, kernel.POSITION])
        speed = way / (detector.crossings[crossing, clock] - detector.crossings[before, clock])
        candidate = min(candidate, speed)
        last = (n - 1) % kernel.RING
        step = abs(detector.crossings[crossing, kernel.POSITION] - detector.crossings[last, kernel.POSITION])
        stood = detector.crossings[last, kernel.FLAT_END] - detector.crossings[last, kernel.TIME]
        if clock != kernel.TIME:
            stood = detector.crossings[crossing, clock] - detector.crossings[last, clock] - 1.0
        if step < kernel.STEPS_OF_SPEED * detector.position.band and stood > 0.0:
            # In all of what was seen of a stand the joint went a band at most: a stop, to a coarse encoder.
            candidate = min(candidate, detector.position.band / stood)
        if speed >= 0.5 * mean:
            if fast:
                slowest = min(slowest, candidate)
            fast, candidate = True, np.inf
        # Shallow dips count only where neither counts nor samples can make them.
        place, now = detector.crossings[crossing, kernel.POSITION], detector.crossings[crossing, clock]
        while back + 1 + _ENOUGH_CROSSINGS <= n and (
            abs(place - detector.crossings[(back + 1) % kernel.RING, kernel.POSITION]) >= least
            and now - detector.crossings[(back + 1) % kernel.RING, clock] >= briefest
        ):
            back += 1
        way = abs(place - detector.crossings[back % kernel.RING, kernel.POSITION])
        elapsed = now - detector.crossings[back % kernel.RING, clock]
        if way >= least and elapsed >= briefest:
            speed = way / elapsed
            lowest = min(lowest, speed)
            if speed >= mean:
                dips += 1 if lowest < DIP_AGAIN * mean else 0
                lowest = np.inf
    return min(slowest / mean, 1.0), dips


@helper()
def reference_slowest_share(since, motion):
    """Slowest motion of the reference since a time over its mean there, 0 to 1; 1 if there is too little to tell.

    A reference that comes in steps goes on evenly from one change to the next.
    """
    slowest, way, duration, longest = np.inf, 0.0, 0.0, 0.0
    newest, last, last_but_one = -1, -1, -1  # slices in which it changed
    for n in range(motion.entries - 1, max(0, motion.entries - PAST), -1):
        entry, before = n % PAST, (n - 1) % PAST
        # The joint answers a little later.
        if motion.past[before, TIME] < since - 0.5 * (motion.now - since):
            break
        change = motion.past[entry, WAY] - motion.past[before, WAY]
        if not np.isfinite(change):
            return 1.0
        if change == 0.0:
            continue
        newest = max(newest, n)
        later = last_but_one if last == n + 1 else last
        last, last_but_one = n, last
        if later < 0:
            continue
        step = abs(motion.past[later % PAST, WAY] - motion.past[entry, WAY])
        elapsed = motion.past[later % PAST, TIME] - motion.past[entry, TIME]
        slowest, longest = min(slowest, step / elapsed), max(longest, elapsed)
        way, duration = way + step, duration + elapsed
    if newest < 0 or way == 0.0:
        return 1.0
    if motion.now - motion.past[newest % PAST, TIME] > 2.0 * longest:
        return 0.0
    return min(slowest * duration / way, 1.0)


@helper()
def _entry_at(time, motion):
    """Index of the latest slice remembered that ends not after a time, or of the oldest; -1 if there is none."""
    entries = motion.entries
    oldest = max(0, entries - PAST)
    low, high = oldest, entries
    while low < high:
        middle = (low + high) // 2
        if motion.past[middle % PAST, TIME] <= time:
            low = middle + 1
        else:
            high = middle
    return max(low - 1, oldest) % PAST if entries else -1


@helper()
def _entry_of(time, motion):
    """Index of the first slice remembered that ends not before a time; -1 if none does."""
    at = _entry_at(time, motion)
    if at < 0 or motion.past[at, TIME] >= time:
        return at
    return (at + 1) % PAST if at != (motion.entries - 1) % PAST else -1


@helper()
def end_of_slice(time, motion):
    """When the slice ended in which a time lies [s]; now if it has not ended."""
    at = _entry_of(time, motion)
    return motion.past[at, TIME] if at >= 0 else motion.now


@inlined()
def travel_since(time, motion):
    """How far the reference went since the end of the slice in which a time lies; 0 if unknown.

    In that slice, what it did before the time is not told from what it did after.
    """
    at = _entry_of(time, motion)
    travel = abs(motion.way - motion.past[at, WAY]) if at >= 0 and motion.travels else np.nan
    return travel if np.isfinite(travel) else 0.0


@helper()
def _reference_stands(since, motion):
    """Whether the reference has not moved since a time, or is unknown."""
    for n in range(motion.entries - 1, max(-1, motion.entries - PAST - 1), -1):
        if abs(motion.past[n % PAST, WAY] - motion.way) > 0.0:
            return not motion.travels
        if motion.past[n % PAST, TIME] <= since:
            break
    return True


@inlined()
def _share_of_reference(since, motion, detector):
    """Way of the joint since a time, of its reference's, negative if they go opposite ways; 1 if that is not even."""
    newest, begin, fastest = motion.entries - 1, motion.entries - 1, 0.0
    while begin > max(0, motion.entries - PAST) and motion.past[(begin - 1) % PAST, TIME] >= since:
        now, before = begin % PAST, (begin - 1) % PAST
        elapsed = motion.past[now, TIME] - motion.past[before, TIME]
        fastest = max(fastest, abs(motion.past[now, WAY] - motion.past[before, WAY]) / elapsed)
        begin -= 1
    now, before = newest % PAST, begin % PAST
    way, duration = motion.past[now, WAY] - motion.past[before, WAY], motion.past[now, TIME] - motion.past[before, TIME]
    if not (abs(way) > _TRAVELLED * detector.position.band and fastest * duration <= _EVEN * abs(way)):
        return 1.0
    return (motion.past[now, PLACE] - motion.past[before, PLACE]) / way


@compiled()
def mean_velocity(window, motion):
    """Mean velocity of the joint over the last ``window`` seconds; NaN if unknown."""
    at = _entry_at(motion.now - window, motion)
    if at < 0 or not motion.now > motion.past[at, TIME]:
        return np.nan
    return (motion.position - motion.past[at, PLACE]) / (motion.now - motion.past[at, TIME])


@compiled()
def reference_velocity(window, motion):
    """Desired velocity now: as given, else over the last ``window`` seconds; NaN if unknown."""
    if np.isfinite(motion.reference_velocity):
        return motion.reference_velocity
    at = _entry_at(motion.now - window, motion)
    if at < 0 or not motion.now > motion.past[at, TIME]:
        return np.nan
    return (motion.reference - motion.past[at, REFERENCE_PLACE]) / (motion.now - motion.past[at, TIME])


@helper()
def _counts_of_a_step(since, motion, detector):
    """Counts from one stand to the next, of a joint that steps by a few bands at a time; 0 if it moves evenly.

    Noise and whole samples make gaps uneven too, but not so much; a change of speed makes none of those side by side.
    """
    head = detector.head
    first = head
    while first > max(0, head - _STEPPED) and detector.crossings[(first - 1) % kernel.RING, kernel.TIME] >= since:
        first -= 1
    windows, uneven, stands = 0, 0, 0
    for crossing in range(first + _GAPS_OF_A_STEP, head):
        shortest, longest, latest = np.inf, 0.0, 0.0
        for n in range(crossing - _GAPS_OF_A_STEP, crossing):
            now, before = (n + 1) % kernel.RING, n % kernel.RING
            gap = detector.crossings[now, kernel.TIME] - detector.crossings[before, kernel.TIME]
            latest = max(gap, motion.interval)
            shortest, longest = min(shortest, latest), max(longest, latest)
        windows += 1
        if longest >= _UNEVEN * shortest:
            uneven += 1
            # Long on the scale of ratios.
            stands += 1 if latest * latest >= longest * shortest else 0
    if 2 * windows < _STEPPED or uneven < _NOTICED * windows or stands == 0:
        return 0.0
    begin, end = (first + _GAPS_OF_A_STEP - 1) % kernel.RING, (head - 1) % kernel.RING
    way = abs(detector.crossings[end, kernel.POSITION] - detector.crossings[begin, kernel.POSITION])
    return way / stands / detector.position.resolution if detector.position.resolution > 0.0 else 0.0


@helper()
def _goes_on_sticking(rest, motion, coarse):
    """Whether what the cycles have shown holds now: no motion and no rest since then outlived them.

    A cycle becomes known only when it has ended; until then, a motion or a rest like those before speaks.
    """
    if motion.cycles < _CYCLES_FOR_STICK_SLIP:
        return False
    if motion.now - motion.cycle_end > _CYCLES_AT_MOST * motion.period:
        return False
    if abs(motion.position - motion.reached) > _OUTLIVES * motion.distance:
        return False
    slip, dwell = _OUTLIVES * motion.slip, _OUTLIVES * motion.dwell
    if np.isfinite(rest):
        return rest - motion.cycle_end <= slip and motion.now - rest <= dwell
    if coarse.in_low_speed:
        # It creeps, beside its slips.
        return motion.now - motion.cycle_end <= slip + dwell
    since = motion.cycle_end
    if motion.rested_at > since and motion.rest_began - since <= slip and motion.rested_at - motion.rest_began <= dwell:
        since = motion.rested_at
    return motion.now - since <= slip


@compiled()
def judge(rest, motion, detector, coarse, remembers):
    """What the motion shows now, with the rest that is open: a code, and two numbers that explain it.

    Motion is even if nothing else was seen for as long as motion is judged: how deep a dip seems depends on where the
    counts fall. ``remembers`` : whether this is the judgement of a slice, which later ones look back on.
    """
    now = motion.now
    if detector.samples < kernel.BLOCK:
        return TOO_FEW, 0.0, 0.0
    if _goes_on_sticking(rest, motion, coarse):
        return STICKS, 0.0, 0.0
    left = motion.last_breakaway if np.isfinite(motion.last_breakaway) else motion.first_time
    if np.isfinite(rest) or detector.head <= 1:
        since = rest if np.isfinite(rest) else motion.first_time
        travel, band = travel_since(since, motion), detector.position.band
        band = band if 0.0 < band < np.inf else _FINEST
        goes_on = travel_since(max(since, now - motion.window), motion) > band
        return STUCK if travel > _TRAVELLED * band and goes_on else AT_REST, now - since, travel
    # A rest is known in full only some time after its end.
    began = max(left, motion.rested_at)
    moving, needed = now - max(motion.turned, began), motion.needed
    # A reference that stood all the while commanded neither stop nor motion; it counts as unknown. One that stepped
    # just before the joint set off commanded that.
    recently = now - motion.stop_before <= _RECENT_STOPS * needed
    stops_and_goes = recently and _reference_stands(motion.stop_before - motion.window, motion)
    if moving < needed:
        if stops_and_goes:
            return STOPS_AND_GOES, 0.0, 0.0
        return REVERSING if motion.turned > began else TOO_SHORT, moving, needed
    # In whole readings.
    if not motion.interval * (LEAST_READINGS - 0.5) <= motion.window:
        return FEW_READINGS, 1.0 / motion.interval, LEAST_READINGS / motion.window
    # In fewer crossings or samples neither a dip nor a step is seen: motion is searched so far back that it has enough.
    begun = max(motion.turned, began) + _START * needed
    if detector.head < _LEAST_CROSSINGS or _crossing_time(_LEAST_CROSSINGS, detector) < begun:
        return FEW_COUNTS, 0.0, 0.0
    enough = min(now - _SAMPLES_SEARCHED * motion.interval, _crossing_time(_LEAST_CROSSINGS, detector))
    since = max(min(now - needed, enough), begun)
    dip, dips = slowest_share(since, kernel.TIME, detector)
    code, number = MOVES, dip
    if dips >= _AGAIN and dip >= _DIP:
        code, number = DIPS, min(dip, DIP_AGAIN)
    elif dip < _DIP and stops_and_goes:
        code, number = STOPS_AND_GOES, 0.0
    # Where the reference itself slows down, the joint has to.
    elif dip < _DIP and dip < _DEEPER * reference_slowest_share(since, motion):
        code = DIPS
    else:
        counts = _counts_of_a_step(began, motion, detector)
        if counts > 0.0:
            code, number = STEPS_OF_COUNTS, counts
    if code == DIPS:
        # To be one, a dip is seen by the number of samples, too; not so exactly, as steps of counts come in samples.
        by_number, dips_by_number = slowest_share(since, kernel.SAMPLE, detector)
        if by_number >= 2.0 * _DIP and 2 * dips_by_number < _AGAIN:
            code = BURSTS
    if code == MOVES:
        # Cycles that last as long as motion needs to would have too few counts each for their slips to be seen.
        early = detector.crossings[(detector.head - _LEAST_CROSSINGS) % kernel.RING]
        way, least = abs(motion.position - early[kernel.POSITION]), _LEAST_CROSSINGS * detector.position.resolution
        if way * _LONG_ENOUGH * needed < least * (now - early[kernel.TIME]):
            return STEPS_OF_COUNTS, np.nan, 0.0
        if motion.crept and coarse.in_low_speed and _reference_stands(motion.last_breakaway, motion):
            # It crept, was fast, and creeps: by command, or by friction.
            return STOPS_AND_GOES, 0.0, 0.0
        share = _share_of_reference(max(begun, now - _LONG_ENOUGH * needed), motion, detector)
        if not _WITH_IT[0] <= share <= _WITH_IT[1]:
            return NOT_FOLLOWING, share, 0.0
        if now - motion.uneven_at < needed:
            return motion.uneven, motion.unevenness, 0.0
    elif remembers:
        motion.uneven, motion.unevenness, motion.uneven_at = code, number, now
    return code, number, 0.0


@compiled()
def did_not_rest(slowed, motion):
    """Forget the last rest, where the joint only slowed down, or only its stamps say so.

    That it slowed down is a deep dip, unless the reference has it too, or the joint turned there.
    """
    seen_lately = motion.now - motion.rested_at < motion.needed and motion.turned < motion.rest_began
    motion.rested_at = -np.inf
    if not slowed:
        motion.uneven, motion.unevenness, motion.uneven_at = BURSTS, 0.0, motion.now
    elif seen_lately and _DEEPER * reference_slowest_share(motion.now - motion.needed, motion) > kernel.SLOW:
        motion.uneven, motion.unevenness, motion.uneven_at = DIPS, kernel.SLOW, motion.now
