# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled first stage of detection: samples to knots, knots to slow spells.

A knot is set whenever the joint has moved by one band: the encoder's resolution, or the noise if that
is larger. Slow motion has long gaps between knots, fast motion short ones, whatever the sampling
rate. A spell is a run of gaps much slower than the motion before it; it ends when the joint moves much
faster again. Whether a spell was a stick is decided by :mod:`stickslip_ros.monitoring.detection.cycles`.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined, kernel

BLOCK = 32
RING = 4096
BLOCKS_KEPT = 64

# Columns of a knot.
TIME, POSITION, FLAT_END, REFERENCE, REFERENCE_FLAT_END, EFFORT_FLAT_END, SPEED, SLOWEST = range(8)
KNOT_COLUMNS = 8

# Indices of the state vector.
(
    HEAD,  # knots ever set
    LEVEL,  # the last knot's reading
    SIGN,  # direction of the last knot
    LAST_TIME,
    LAST_REFERENCE,
    LAST_EFFORT,
    PEAK,  # fastest motion since the last rest
    IN_SPELL,
    LONGEST_GAP,  # knot from which the spell's longest gap runs
    LONGEST_TIME,
    PEAK_AFTER,  # fastest motion since the longest gap
    SAMPLES,  # samples ever taken
    BAND,
    RESOLUTION,
    NOISE,
    MEDIAN_1,
    MEDIAN_2,  # the two previous raw positions, the latest first
    MEDIAN_TIME,
    MEDIAN_REFERENCE,
    MEDIAN_EFFORT,
    LARGEST,
    SPELL_TIME,  # when the spell began
    MOTION_TIME,  # when the motion before it began
    UPDATE,  # how often the position changes while the joint moves fast; sensors may be slower than messages
    VELOCITY_1,
    VELOCITY_2,  # the two previous measured velocities, the latest first
    SLOWEST_VELOCITY,  # measured since the last knot
    REPLAYED,  # of the first block, which waits to be measured, the samples taken
) = range(28)
STATE_SIZE = 28

_LATEST, _ORDERED = 0, 1  # rows of the noise of the blocks
SLOW = 0.1  # a gap is slow below this share of the fastest motion beside it
_REVERSALS_KEPT = 27  # of the 30 of a block; the three largest are left out as impulses
_REVERSAL_OF_UNIT_NOISE = 0.7236  # their mean for white noise of unit deviation (computed on 400,000 blocks)
_BANDS_PER_NOISE = 5.0
_ROUNDING = 1e-10  # differences below this share of the position are arithmetic, not motion
_STEPS_OF_SPEED = 3.0
_HELD = 2.5
_KNOTS_TO_LEAVE = 4
_KNOTS_TO_WAIT = 128
_LEAVING_SHARE = 0.2
_MEMORY = 4.0  # of the duration of a motion: how long its speed is what the next one is held against


@inlined()
def _upper_quartile(noise, noises):
    """The upper quartile of the latest values: the new one, and those kept in the order of time and in their own."""
    count = 0
    while count < BLOCKS_KEPT and not np.isnan(noises[_ORDERED, count]):
        count += 1
    if count == BLOCKS_KEPT:
        # The oldest one goes.
        count -= 1
        place = 0
        while noises[_ORDERED, place] < noises[_LATEST, count]:
            place += 1
        for i in range(place, count):
            noises[_ORDERED, i] = noises[_ORDERED, i + 1]
    for i in range(count, 0, -1):
        noises[_LATEST, i] = noises[_LATEST, i - 1]
    noises[_LATEST, 0] = noise
    place = count
    while place > 0 and noises[_ORDERED, place - 1] > noise:
        noises[_ORDERED, place] = noises[_ORDERED, place - 1]
        place -= 1
    noises[_ORDERED, place] = noise
    return noises[_ORDERED, (3 * (count + 1)) // 4]


@helper()
def measure_block(block, state, smallest, noises):
    """Update resolution and noise from one block of raw positions, and from these the band.

    ``smallest`` keeps the three smallest steps ever seen; its last one is taken as the resolution, so
    that two odd values do no harm. Noise is taken from steps that turn back at once, which steady
    motion, however fast, does not do; the upper quartile over the last blocks, because motion hides it.
    """
    largest = state[LARGEST]
    for i in range(block.shape[0]):
        largest = max(largest, abs(block[i]))
    state[LARGEST] = largest
    for i in range(1, block.shape[0]):
        step = abs(block[i] - block[i - 1])
        if step > _ROUNDING * largest and step > 0.0:
            if step < smallest[0]:
                smallest[2], smallest[1], smallest[0] = smallest[1], smallest[0], step
            elif step < smallest[1]:
                smallest[2], smallest[1] = smallest[1], step
            elif step < smallest[2]:
                smallest[2] = step
    # Their sum without the three largest.
    total, first, second, third = 0.0, 0.0, 0.0, 0.0
    for i in range(2, block.shape[0]):
        reversal = max(0.0, -(block[i] - block[i - 1]) * (block[i - 1] - block[i - 2]))
        total += reversal
        if reversal > first:
            third, second, first = second, first, reversal
        elif reversal > second:
            third, second = second, reversal
        elif reversal > third:
            third = reversal
    kept = max(0.0, total - first - second - third)
    noise = np.sqrt(kept / _REVERSALS_KEPT / _REVERSAL_OF_UNIT_NOISE)
    state[NOISE] = _upper_quartile(noise, noises)
    resolution = smallest[2]
    state[RESOLUTION] = resolution if np.isfinite(resolution) else 0.0
    state[BAND] = max(state[RESOLUTION], _BANDS_PER_NOISE * state[NOISE], 4.0 * _ROUNDING * largest, 1e-15)


@helper()
def _median(a, b, c):
    return max(min(a, b), min(max(a, b), c))


@inlined()
def _set_knot(time, position, step, reference, effort, state, knots):
    """Append a knot; ``step`` is the signed change of the reading since the last one."""
    head = int(state[HEAD])
    # Rows of the ring. A view of a row costs a hundredth of a second to compile wherever it is taken.
    new, last, one_before = head % RING, (head - 1) % RING, max(head - 2, 0) % RING
    resolution = state[RESOLUTION]
    sign = 1.0 if step > 0.0 else -1.0
    knot_time, knot_position = time, position
    if head > 0:
        if abs(step) < state[BAND] + 0.5 * resolution and resolution >= _BANDS_PER_NOISE * state[NOISE]:
            # One count: the joint stood on the border between two readings, in between two samples.
            knot_time = 0.5 * (state[LAST_TIME] + time)
            knot_position = position - 0.5 * sign * resolution
        knots[last, FLAT_END] = max(state[LAST_TIME], knots[last, TIME])
        knots[last, REFERENCE_FLAT_END] = state[LAST_REFERENCE]
        knots[last, EFFORT_FLAT_END] = state[LAST_EFFORT]
        knots[last, SLOWEST] = state[SLOWEST_VELOCITY]
    state[SLOWEST_VELOCITY] = np.nan
    knots[new, TIME] = knot_time
    knots[new, POSITION] = knot_position
    knots[new, FLAT_END] = knot_time
    knots[new, REFERENCE] = reference
    knots[new, REFERENCE_FLAT_END] = reference
    knots[new, EFFORT_FLAT_END] = effort
    knots[new, SLOWEST] = np.nan
    knots[new, SPEED] = 0.0
    if head > 0:
        before = last
        if abs(step) >= _STEPS_OF_SPEED * state[BAND]:
            gap = knot_time - knots[last, TIME]
            if state[UPDATE] == 0.0:
                state[UPDATE] = time - state[LAST_TIME]
            held = gap <= _HELD * state[UPDATE]
            elapsed = gap if held else max(time - knots[last, FLAT_END], state[UPDATE])
            # A running median, in steps of a tenth.
            state[UPDATE] *= 1.1 if gap > state[UPDATE] else 1.0 / 1.1
        else:
            # Over two gaps, because single counts come in whole samples.
            before = one_before
            elapsed = knot_time - knots[before, TIME]
        if elapsed > 0.0:
            knots[new, SPEED] = (knot_position - knots[before, POSITION]) / elapsed
    state[LEVEL] = position
    state[SIGN] = sign
    state[HEAD] = head + 1


@inlined()
def _follow_spell(state, knots):
    """Update the spell with the gap that the newest knot has ended; True when a spell is complete."""
    newest = int(state[HEAD]) - 1
    if newest < 1:
        return False
    now, gap = newest % RING, (newest - 1) % RING
    flat = knots[gap, FLAT_END] - knots[gap, TIME]
    speed = abs(knots[now, SPEED])
    step = abs(knots[now, POSITION] - knots[gap, POSITION])
    large = step >= _STEPS_OF_SPEED * state[BAND]
    # A flat of few updates before a large step is a sensor that repeats itself.
    stood = flat > (_HELD - 1.0) * state[UPDATE] if large else flat > 0.0
    slow = stood and state[BAND] < SLOW * state[PEAK] * flat
    if state[IN_SPELL] == 0.0:
        if not slow:
            state[PEAK] = max(state[PEAK], speed)
            return False
        _begin_spell(newest - 1, flat, state, knots)
        return False
    time = knots[now, TIME]
    left = _has_left(time, state)
    if left and stood and state[BAND] < SLOW * state[PEAK_AFTER] * flat:
        return True
    if stood and flat > state[LONGEST_TIME]:
        state[LONGEST_GAP], state[LONGEST_TIME], state[PEAK_AFTER] = newest - 1, flat, 0.0
        return False
    after = newest - int(state[LONGEST_GAP])
    # A speed over two gaps lies wholly after the longest gap from the third knot on.
    if after >= 3 or large:
        state[PEAK_AFTER] = max(state[PEAK_AFTER], speed)
    if not _has_left(time, state) or after < _KNOTS_TO_LEAVE:
        return False
    return speed >= 0.4 * state[PEAK] or speed < 0.5 * state[PEAK_AFTER] or after >= _KNOTS_TO_WAIT


@helper()
def _has_left(time, state):
    """Whether the motion since the longest gap is much faster than that gap, and not slow beside the last motion.

    The second keeps a creep at rest from passing for motion; it fades, because after a fast move the
    joint may well stick and slip at a much lower speed.
    """
    if not state[BAND] < SLOW * state[PEAK_AFTER] * state[LONGEST_TIME]:
        return False
    if not np.isfinite(state[PEAK]):
        return True
    memory = _MEMORY * max(state[SPELL_TIME] - state[MOTION_TIME], 1e-9)
    return state[PEAK_AFTER] >= _LEAVING_SHARE * state[PEAK] * np.exp(-(time - state[SPELL_TIME]) / memory)


@helper()
def _begin_spell(gap, flat, state, knots):
    state[LONGEST_GAP] = gap
    state[LONGEST_TIME] = flat
    state[PEAK_AFTER] = 0.0
    state[IN_SPELL] = 1.0
    state[SPELL_TIME] = knots[gap % RING, TIME]


@kernel()
def close_spell(state, knots):
    """Begin anew after a spell; the newest gap may be the first of the next one."""
    newest = int(state[HEAD]) - 1
    gap = (newest - 1) % RING
    flat = knots[gap, FLAT_END] - knots[gap, TIME]
    state[MOTION_TIME] = knots[int(state[LONGEST_GAP]) % RING, FLAT_END]
    state[PEAK] = state[PEAK_AFTER]
    state[IN_SPELL] = 0.0
    if newest - 1 > state[LONGEST_GAP] and flat > 0.0 and state[BAND] < SLOW * state[PEAK] * flat:
        _begin_spell(newest - 1, flat, state, knots)


@helper()
def take(count, now, raw, pace_now, travel, effort_now, state, knots):
    """Take sample number ``count``; True if it completes a spell.

    It is time, position, velocity, travel of the reference and effort. The longest gap of a completed spell stands in
    the state (``LONGEST_GAP``), its surroundings in the ring of knots.
    """
    # A median of three keeps single-sample impulses out and leaves monotonic motion as it is.
    position = _median(raw, state[MEDIAN_1], state[MEDIAN_2]) if count >= 2 else state[MEDIAN_1]
    time, reference, effort = state[MEDIAN_TIME], state[MEDIAN_REFERENCE], state[MEDIAN_EFFORT]
    state[MEDIAN_2], state[MEDIAN_1] = state[MEDIAN_1], raw
    state[MEDIAN_TIME], state[MEDIAN_REFERENCE], state[MEDIAN_EFFORT] = now, travel, effort_now
    if count == 0:
        return False
    complete = False
    first = state[HEAD] == 0.0
    step = 0.0 if first else position - state[LEVEL]
    needed = state[BAND] if step * state[SIGN] >= 0.0 else 2.0 * state[BAND]
    if first or abs(step) >= needed * (1.0 - 1e-6):
        _set_knot(time, position, step, reference, effort, state, knots)
        if first:
            state[SIGN] = 0.0
        else:
            complete = _follow_spell(state, knots)
    # The slowest that a velocity sensor saw since the last knot, impulses left out.
    pace = abs(_median(pace_now, state[VELOCITY_1], state[VELOCITY_2])) if count >= 2 else np.nan
    state[VELOCITY_2], state[VELOCITY_1] = state[VELOCITY_1], pace_now
    if not pace >= state[SLOWEST_VELOCITY]:
        state[SLOWEST_VELOCITY] = pace
    state[LAST_TIME], state[LAST_REFERENCE], state[LAST_EFFORT] = time, reference, effort
    return complete
