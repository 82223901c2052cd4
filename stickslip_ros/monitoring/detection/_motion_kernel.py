# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled path of the samples: the recent past of a joint, its rests, and a judgement every slice of time.

:mod:`.motion` is its face. A slice closes with the first sample of the next one, so that nothing depends on how
the samples were batched.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.monitoring._quantile_kernel import quantile
from stickslip_ros.monitoring.detection import _knot_kernel as kernel

SLICE_LENGTH = 0.05  # [s] how finely findings are dated
PAST = 4096
STEPS = 256
_INTERVAL_WEIGHT = 0.1
_RECENT_KNOTS = 64
_GAPS_AT_REST = 3.0
_FAST_SHARE = 0.9  # quantile that leaves out the outliers that noise and jittered stamps make

# Indices of the state vector.
(
    FIRST_TIME,
    NOW,
    POSITION,
    REFERENCE,
    REFERENCE_VELOCITY,
    TRAVEL,  # way of the reference
    TRAVELS,  # whether the reference is known
    INTERVAL,  # between samples
    TURNED,  # when the motion turned
    DIRECTION,
    RESTED_AT,  # when it was last seen at rest
    SLICE,  # number of the slice that is open, NaN if none is
    SLICE_BEGIN,  # first stamp in it
    SLICE_ERROR,  # largest tracking error in it
    SLICE_REFERENCED,  # whether each sample in it had a reference position
    SLICE_STEPS,  # intervals in it
    LAST_END,  # last stamp of the slice before
    LAST_POSITION,  # position there
    LAST_REFERENCE,  # reference there
    ENTRIES,  # slices ever remembered
    CLOSED,  # slices reported since this was set to zero
    # What is known of the cycles, set from outside.
    CYCLES,  # recent ones
    PERIOD,  # their median
    LAST_ARREST,
    LAST_BREAKAWAY,  # of the last rest, NaN before the first
    NEEDED,  # how long motion without a rest must last before it is called smooth
    # When to look whether the joint has come to rest.
    LOOKED,  # knots there were at the last look
    LOOK_AFTER,  # for how long it must then have stood
) = range(28)
STATE_SIZE = 28

# What ends a call of `follow`.
ENDED, SPELL, STANDS = range(3)

# Columns of what is remembered of a slice.
TIME, PLACE, REFERENCE_PLACE, WAY, ERROR, VELOCITY_ERROR = range(6)
PAST_COLUMNS = 6
# Columns of what is reported of a slice.
BEGIN, END, CODE, FROM, TO, VELOCITY = range(6)
SLICE_COLUMNS = 6

# What the motion shows.
TOO_FEW, STICKS, AT_REST, REVERSING, TOO_SHORT, DIPS, MOVES = range(7)

PERIODS_TO_TRUST = 2.0  # motion must last so many cycle or natural periods before it is called smooth
_PERIODS_AT_REST = 4.0  # a dwell may last so many periods before the joint is called at rest
_CYCLES_FOR_STICK_SLIP = 2
_LEAST_KNOTS = 20
_DIP_AT_RISK = 0.2  # of the mean speed
_START = 0.25  # of the motion needed: the start from rest is no dip
_LOOK_AGAIN = 1.4  # times as long as at the last look: how long a joint must stand for the next
_WINDOW_KNOTS = 6
_ENOUGH_KNOTS = 3


@compiled()
def unbroken(times, positions, after, silence, largest):
    """Whether samples simply go on after a time: all usable, in strict order, with no silence before or in between."""
    before = after
    for n in range(times.shape[0]):
        # Comparisons with NaN are false.
        if not (before < times[n] <= before + silence and abs(times[n]) < largest and abs(positions[n]) < largest):
            return False
        before = times[n]
    return times.shape[0] > 0


@compiled()
def errors(since, state, past):
    """Largest tracking error and velocity error of the slices since a time; NaN where none is known."""
    tracking, velocity = state[SLICE_ERROR], np.nan
    for n in range(int(state[ENTRIES]) - 1, max(-1, int(state[ENTRIES]) - PAST - 1), -1):
        entry = n % PAST
        if past[entry, TIME] < since:
            break
        if not past[entry, ERROR] <= tracking and np.isfinite(past[entry, ERROR]):
            tracking = past[entry, ERROR]
        if not past[entry, VELOCITY_ERROR] <= velocity and np.isfinite(past[entry, VELOCITY_ERROR]):
            velocity = past[entry, VELOCITY_ERROR]
    return tracking, velocity


@inlined()
def _all_finite(values):
    finite = True
    for n in range(values.shape[0]):
        finite = finite and np.isfinite(values[n])
    return finite


@helper()
def _last_knot_time(detector, knots):
    head = int(detector[kernel.HEAD])
    return knots[(head - 1) % kernel.RING, kernel.TIME] if head else -np.inf


@compiled()
def open_rest(detector, knots):
    """Since when the joint has been at rest, if by now that can be told from slow motion; else NaN."""
    head = int(detector[kernel.HEAD])
    last = _last_knot_time(detector, knots)
    if head < 2:
        return last if head else np.nan
    flat = detector[kernel.LAST_TIME] - last
    if not flat > _GAPS_AT_REST * detector[kernel.UPDATE]:
        return np.nan
    count = min(head, _RECENT_KNOTS) - 1
    gaps, speeds = np.empty(count), np.empty(count)
    for n in range(count):
        knot, before = (head - 1 - n) % kernel.RING, (head - 2 - n) % kernel.RING
        gaps[n] = knots[knot, kernel.TIME] - knots[before, kernel.TIME]
        speeds[n] = abs(knots[knot, kernel.SPEED])
    usual = max(quantile(gaps, count, 0.5), detector[kernel.UPDATE])
    fastest = quantile(speeds, count, _FAST_SHARE)
    stands = flat > _GAPS_AT_REST * usual and detector[kernel.BAND] < kernel.SLOW * fastest * flat
    return last if stands else np.nan


@inlined()
def slowest_share(since, detector, knots):
    """Slowest motion since a time over the mean there, 0 to 1; 1 if there is too little to tell."""
    head = int(detector[kernel.HEAD])
    first = head
    while first > max(0, head - kernel.RING) and knots[(first - 1) % kernel.RING, kernel.TIME] >= since:
        first -= 1
    if head - first < 2 * _WINDOW_KNOTS:
        return 1.0
    begin, end = first % kernel.RING, (head - 1) % kernel.RING
    way = abs(knots[end, kernel.POSITION] - knots[begin, kernel.POSITION])
    mean = way / (knots[end, kernel.TIME] - knots[begin, kernel.TIME])
    if mean == 0.0:
        return 1.0
    # Over several gaps, so that the rhythm of counts and samples does not pass for a change of speed. Slowing
    # down at the end is no dip before the motion has picked up again.
    recovered, slowest, candidate = False, np.inf, np.inf
    for n in range(first + _ENOUGH_KNOTS, head):
        knot, before = n % kernel.RING, (n - _ENOUGH_KNOTS) % kernel.RING
        way = abs(knots[knot, kernel.POSITION] - knots[before, kernel.POSITION])
        speed = way / (knots[knot, kernel.TIME] - knots[before, kernel.TIME])
        candidate = min(candidate, speed)
        if speed >= 0.5 * mean:
            recovered = True
            slowest = min(slowest, candidate)
    return min(slowest / mean, 1.0) if recovered else 1.0


@helper()
def _entry_at(time, state, past):
    """Index of the latest slice remembered that ends not after a time, or of the oldest; -1 if there is none."""
    entries = int(state[ENTRIES])
    oldest = max(0, entries - PAST)
    low, high = oldest, entries
    while low < high:
        middle = (low + high) // 2
        if past[middle % PAST, TIME] <= time:
            low = middle + 1
        else:
            high = middle
    return max(low - 1, oldest) % PAST if entries else -1


@inlined()
def travel_since(time, state, past):
    """Way of the reference since a time; 0 if unknown."""
    at = _entry_at(time, state, past)
    travel = state[TRAVEL] - past[at, WAY] if at >= 0 and state[TRAVELS] else np.nan
    return travel if np.isfinite(travel) else 0.0


@compiled()
def mean_velocity(window, state, past):
    """Mean velocity of the joint over the last ``window`` seconds; NaN if unknown."""
    at = _entry_at(state[NOW] - window, state, past)
    if at < 0 or not state[NOW] > past[at, TIME]:
        return np.nan
    return (state[POSITION] - past[at, PLACE]) / (state[NOW] - past[at, TIME])


@compiled()
def reference_velocity(window, state, past):
    """Desired velocity now: as given, else over the last ``window`` seconds; NaN if unknown."""
    if np.isfinite(state[REFERENCE_VELOCITY]):
        return state[REFERENCE_VELOCITY]
    at = _entry_at(state[NOW] - window, state, past)
    if at < 0 or not state[NOW] > past[at, TIME]:
        return np.nan
    return (state[REFERENCE] - past[at, REFERENCE_PLACE]) / (state[NOW] - past[at, TIME])


@compiled()
def judge(rest, state, past, detector, knots):
    """What the motion shows now, with the rest that is open: a code, and two numbers that explain it."""
    now = state[NOW]
    if detector[kernel.SAMPLES] < kernel.BLOCK:
        return TOO_FEW, 0.0, 0.0
    left = state[LAST_BREAKAWAY] if np.isfinite(state[LAST_BREAKAWAY]) else state[FIRST_TIME]
    if state[CYCLES] >= _CYCLES_FOR_STICK_SLIP:
        # A cycle becomes known only when the next one begins; until then the last breakaway speaks.
        patience = PERIODS_TO_TRUST if np.isnan(rest) else _PERIODS_AT_REST
        if now - max(state[LAST_ARREST], left) <= patience * state[PERIOD]:
            return STICKS, 0.0, 0.0
    if np.isfinite(rest) or detector[kernel.HEAD] <= 1:
        since = rest if np.isfinite(rest) else state[FIRST_TIME]
        return AT_REST, now - since, travel_since(since, state, past)
    # A rest is known in full only some time after its end.
    began = max(left, state[RESTED_AT])
    moving, needed = now - max(state[TURNED], began), state[NEEDED]
    if moving < needed or detector[kernel.HEAD] < _LEAST_KNOTS:
        return REVERSING if state[TURNED] > began else TOO_SHORT, moving, needed
    dip = slowest_share(max(now - needed, began + _START * needed), detector, knots)
    return DIPS if dip < _DIP_AT_RISK else MOVES, dip, 0.0


@compiled()
def close_slice(window, state, past, steps, slices, detector, knots):
    """End the slice that is open, if one is: remember it, judge it, report it."""
    if np.isnan(state[SLICE]):
        return
    now = state[NOW]
    count = int(state[SLICE_STEPS])
    if count:
        interval = quantile(steps, count, 0.5)
        state[INTERVAL] = (
            interval if np.isnan(state[INTERVAL]) else state[INTERVAL] + _INTERVAL_WEIGHT * (interval - state[INTERVAL])
        )
    moved, duration = state[POSITION] - state[LAST_POSITION], now - state[LAST_END]
    velocity_error = np.nan
    if 0.0 < duration < np.inf:
        desired = state[REFERENCE_VELOCITY]
        if not np.isfinite(desired) and state[SLICE_REFERENCED]:
            desired = (state[REFERENCE] - state[LAST_REFERENCE]) / duration
        velocity_error = abs(desired - moved / duration)
    entry = int(state[ENTRIES]) % PAST
    past[entry, TIME], past[entry, PLACE], past[entry, REFERENCE_PLACE] = now, state[POSITION], state[REFERENCE]
    past[entry, WAY] = state[TRAVEL] if state[TRAVELS] else np.nan
    past[entry, ERROR], past[entry, VELOCITY_ERROR] = state[SLICE_ERROR], velocity_error
    state[ENTRIES] += 1.0
    sign = detector[kernel.SIGN]
    if sign != 0.0 and sign != state[DIRECTION]:
        if state[DIRECTION] != 0.0:
            state[TURNED] = _last_knot_time(detector, knots)
        state[DIRECTION] = sign
    rest = open_rest(detector, knots)
    if np.isfinite(rest):
        state[RESTED_AT] = now
    code, _, _ = judge(rest, state, past, detector, knots)
    velocity = np.nan
    if code == MOVES:
        velocity = reference_velocity(window, state, past)
        if not np.isfinite(velocity):
            velocity = mean_velocity(window, state, past)
    row = int(state[CLOSED])
    slices[row, BEGIN], slices[row, END] = state[SLICE_BEGIN], now
    slices[row, CODE], slices[row, VELOCITY] = code, velocity
    slices[row, FROM], slices[row, TO] = state[LAST_POSITION], state[POSITION]
    state[CLOSED] += 1.0
    state[SLICE] = np.nan
    state[LAST_END], state[LAST_POSITION], state[LAST_REFERENCE] = now, state[POSITION], state[REFERENCE]


@inlined()
def _note(time, position, reference, reference_speed, state, steps):
    """Remember a sample; returns the way that the reference has gone, NaN if unknown."""
    step = time - state[NOW]
    if np.isnan(state[FIRST_TIME]):
        state[FIRST_TIME] = time
        state[LAST_POSITION] = position
    elif int(state[SLICE_STEPS]) < STEPS:
        steps[int(state[SLICE_STEPS])] = step
        state[SLICE_STEPS] += 1.0
    state[NOW], state[POSITION] = time, position
    # From its position if given, else from its velocity.
    if np.isfinite(reference):
        if np.isfinite(state[REFERENCE]):
            state[TRAVEL] += abs(reference - state[REFERENCE])
        error = abs(reference - position)
        if not error <= state[SLICE_ERROR]:
            state[SLICE_ERROR] = error
    else:
        state[SLICE_REFERENCED] = 0.0
        if np.isfinite(reference_speed) and np.isfinite(step):
            state[TRAVEL] += abs(reference_speed) * step
    state[REFERENCE], state[REFERENCE_VELOCITY] = reference, reference_speed
    state[TRAVELS] = 1.0 if np.isfinite(reference) or np.isfinite(reference_speed) else 0.0
    return state[TRAVEL] if state[TRAVELS] else np.nan


@inlined()
def _may_rest(state, detector, knots):
    """Whether it is time to look if the joint has come to rest: it stands, and did so for too short a time before."""
    head = detector[kernel.HEAD]
    flat = detector[kernel.LAST_TIME] - _last_knot_time(detector, knots)
    if head != state[LOOKED]:
        if head < 3.0 or not np.isfinite(detector[kernel.PEAK]):
            return False
        newest = int(head) - 1
        gap = knots[newest % kernel.RING, kernel.TIME] - knots[(newest - 1) % kernel.RING, kernel.TIME]
        state[LOOKED] = head
        state[LOOK_AFTER] = _GAPS_AT_REST * max(gap, state[NOW] - detector[kernel.LAST_TIME])
    # Times that differ by less than the samples do are equal, however stamps are rounded.
    equal = 0.25 * (state[NOW] - detector[kernel.LAST_TIME])
    if not flat >= state[LOOK_AFTER] - equal or not detector[kernel.BAND] < kernel.SLOW * detector[kernel.PEAK] * flat:
        return False
    state[LOOK_AFTER] = _LOOK_AGAIN * flat
    return True


@compiled()
def replay(early, detector, knots):
    """Take the first block, which had to be measured first; True whenever a spell is complete."""
    while detector[kernel.SAMPLES] >= kernel.BLOCK and detector[kernel.REPLAYED] < kernel.BLOCK:
        number = int(detector[kernel.REPLAYED])
        detector[kernel.REPLAYED] += 1.0
        if kernel.take(
            number, early[number, 0], early[number, 1], early[number, 2], early[number, 3], early[number, 4],
            detector, knots,
        ):  # fmt: skip
            return True
    return False


@compiled()
def follow(
    start, times, positions, velocities, efforts, references, reference_speeds,
    window, state, past, steps, slices,
    early, block, detector, smallest, noises, velocity_block, velocity_detector, velocity_smallest, velocity_noises,
    knots,
):  # fmt: skip
    """Take samples from ``start`` until a spell is complete, the joint may have come to rest, or the samples end.

    Returns the index of the next sample, and which of these it is.
    """
    for i in range(start, times.shape[0]):
        number = np.floor(times[i] / SLICE_LENGTH)
        if number != state[SLICE]:
            close_slice(window, state, past, steps, slices, detector, knots)
            state[SLICE], state[SLICE_BEGIN] = number, times[i]
            state[SLICE_ERROR], state[SLICE_REFERENCED], state[SLICE_STEPS] = np.nan, 1.0, 0.0
        travel = _note(times[i], positions[i], references[i], reference_speeds[i], state, steps)
        count = int(detector[kernel.SAMPLES])
        block[count % kernel.BLOCK] = positions[i]
        velocity_block[count % kernel.BLOCK] = velocities[i]
        detector[kernel.SAMPLES] = count + 1
        if (count + 1) % kernel.BLOCK == 0:
            kernel.measure_block(block, detector, smallest, noises)
            if _all_finite(velocity_block):
                kernel.measure_block(velocity_block, velocity_detector, velocity_smallest, velocity_noises)
        if count < kernel.BLOCK:
            early[count, 0], early[count, 1], early[count, 2] = times[i], positions[i], velocities[i]
            early[count, 3], early[count, 4] = travel, efforts[i]
            if count + 1 == kernel.BLOCK and replay(early, detector, knots):
                return i + 1, SPELL
        elif kernel.take(count, times[i], positions[i], velocities[i], travel, efforts[i], detector, knots):
            return i + 1, SPELL
        elif _may_rest(state, detector, knots):
            return i + 1, STANDS
    return times.shape[0], ENDED
