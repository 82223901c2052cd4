# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled path of the samples: they fill the record of a joint's recent past, which is judged every slice of time.

:mod:`.motion` is its face, and :mod:`stickslip_ros.monitoring.samples` that of what scans and stores them. A slice
closes with the first sample of the next one, so that nothing depends on how the samples were batched.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined
from stickslip_ros.compilation import kernel as compiled
from stickslip_ros.monitoring._quantile_kernel import quantile
from stickslip_ros.monitoring.detection import _crossing_kernel as kernel
from stickslip_ros.monitoring.detection import _judgement_kernel as judgement
from stickslip_ros.monitoring.detection import _swing_kernel as swings

SLICE_LENGTH = 0.05  # length of a slice, s: how finely findings are dated
LONGEST_SILENCE = 2.0  # time without a sample, s
_SHORTEST_SILENCE = 0.6  # time without a sample, s: a network may lose so much now and then
_UNSEEN_INTERVALS = 10.0  # time without a reference, usual sample intervals
_INTERVAL_WEIGHT = 0.1  # weight of the last interval in the mean one, 1
_LOOK_AGAIN = 1.4  # time that a joint stands, of that at the last look: with more there is a new look

# What ends a call of `follow`.
ENDED, LOW_SPEED, STANDS, SWUNG, SILENT, LOW_SPEED_COARSE = range(6)

# Columns of what is reported of a slice.
BEGIN, END, CODE, NUMBER, FROM, TO, VELOCITY = range(7)
SLICE_COLUMNS = VELOCITY + 1

# Whether a reference repeats what was measured.
_COMPARED = 3.0  # way from one comparison to the next, bands
_SAME = 1e-3  # difference of joint and reference, of a band: with less they are the same
_KEPT = 0.99  # weight of what was seen before, at each comparison, 1
_ENOUGH_COMPARED = 20.0  # weight of the comparisons, 1: with less there is no finding
# Share of comparisons in which the reference repeats the joint, 1: to begin with, and to go on.
_FOLLOWS, _FOLLOWS_STILL = 0.95, 0.7


@compiled()
def unbroken(times, positions, after, largest):
    """Whether samples simply go on after a time: all usable, and in strict order."""
    before = after
    for n in range(times.shape[0]):
        # Comparisons with NaN are false.
        if not (before < times[n] and abs(times[n]) < largest and abs(positions[n]) < largest):
            return False
        before = times[n]
    return times.shape[0] > 0


@inlined()
def _all_finite(values):
    finite = True
    for n in range(values.shape[0]):
        finite = finite and np.isfinite(values[n])
    return finite


@compiled()
def close_slice(slices, motion, detector, coarse):
    """End the slice that is open, if one is: remember it, judge it, report it."""
    if np.isnan(motion.slice):
        return
    now = motion.now
    count = motion.slice_steps
    if count:
        interval = quantile(motion.steps, count, 0.5)
        motion.interval = (
            interval if np.isnan(motion.interval) else motion.interval + _INTERVAL_WEIGHT * (interval - motion.interval)
        )
    moved, duration = motion.position - motion.last_position, now - motion.last_end
    velocity_error = np.nan
    if 0.0 < duration < np.inf:
        desired = motion.reference_velocity
        if not np.isfinite(desired) and motion.slice_referenced:
            desired = (motion.reference - motion.last_reference) / duration
        velocity_error = abs(desired - moved / duration)
    way = abs(moved)
    if way < np.inf:
        # A running median, in steps of a tenth.
        motion.pace = max(motion.pace * (1.1 if way > motion.pace else 1.0 / 1.1), 0.01 * way)
        coarse.position.band = max(detector.position.band, motion.pace)
    entry = motion.entries % judgement.PAST
    (
        motion.past[entry, judgement.TIME],
        motion.past[entry, judgement.PLACE],
        motion.past[entry, judgement.REFERENCE_PLACE],
    ) = (
        now,
        motion.position,
        motion.reference,
    )
    motion.past[entry, judgement.WAY] = motion.way if motion.travels else np.nan
    motion.past[entry, judgement.ERROR], motion.past[entry, judgement.VELOCITY_ERROR] = (
        motion.slice_error,
        velocity_error,
    )
    motion.entries += 1
    sign = detector.sign
    if sign != 0.0 and sign != motion.direction:
        if motion.direction != 0.0:
            motion.turned = judgement.last_crossing_time(detector)
            motion.turns[motion.turn_count % judgement.TURNS] = motion.turned
            motion.turn_count += 1
        motion.direction = sign
    rest = judgement.open_rest(motion.window, detector)
    if np.isfinite(rest):
        motion.rested_at, motion.rest_began = now, rest
    code, number, _ = judgement.judge(rest, motion, detector, coarse, True)
    stands = code in (judgement.AT_REST, judgement.STUCK)
    if stands and rest > motion.slice_begin and abs(moved) > swings.FLICKER * detector.position.band:
        # It came to rest within the slice, after the end of a motion or after a step.
        code = judgement.STICKS if motion.code == judgement.STICKS else judgement.TOO_SHORT
    motion.code = code
    # What the reference did before the joint stood does not count.
    stood = motion.window
    if code == judgement.STUCK and np.isfinite(rest):
        stood = now - judgement.end_of_slice(rest, motion)
    velocity = judgement.reference_velocity(min(stood, motion.window), motion)
    if code in (judgement.MOVES, judgement.STUCK) and not np.isfinite(velocity):
        velocity = judgement.mean_velocity(motion.window, motion)
    row = motion.closed
    slices[row, BEGIN], slices[row, END] = motion.slice_begin, now
    slices[row, CODE], slices[row, NUMBER], slices[row, VELOCITY] = code, number, velocity
    slices[row, FROM], slices[row, TO] = motion.last_position, motion.position
    motion.closed += 1
    motion.slice = np.nan
    motion.last_end, motion.last_position, motion.last_reference = now, motion.position, motion.reference


@helper()
def _compare(position, reference, reference_speed, motion, detector):
    """Compare the reference with what is measured, whenever the joint has moved on a little.

    A command leads the joint, and a stiff servo comes within a count of it. A reference that was there before is where
    the joint is, to the digit, or where it has just been.
    """
    band = detector.position.band
    moved = position - motion.before
    if not abs(moved) >= _COMPARED * band or band == 0.0:
        if np.isnan(motion.before):
            motion.before = position
        return
    motion.before = position
    ahead = (reference - position) * (1.0 if moved > 0.0 else -1.0)
    if np.isfinite(ahead):
        same = abs(ahead) <= _SAME * band
        if not same and -band < ahead < 0.0:
            return
        followed = same or -abs(moved) <= ahead < 0.0
    elif np.isfinite(reference_speed):
        followed = reference_speed == 0.0
    else:
        return
    motion.compared = _KEPT * motion.compared + 1.0
    motion.followed = _KEPT * motion.followed + (1.0 if followed else 0.0)
    if motion.compared >= _ENOUGH_COMPARED:
        share = motion.followed / motion.compared
        motion.follows = share > (_FOLLOWS_STILL if motion.follows else _FOLLOWS)


@inlined()
def _note(time, position, reference, reference_speed, motion, detector):
    """Remember a sample; returns the way of the reference, NaN if unknown."""
    step = time - motion.now
    if np.isnan(motion.first_time):
        motion.first_time = time
        motion.last_position = position
        step = 0.0
    elif motion.slice_steps < judgement.STEPS:
        motion.steps[motion.slice_steps] = step
        motion.slice_steps += 1
    motion.now, motion.position = time, position
    _compare(position, reference, reference_speed, motion, detector)
    if motion.follows:
        reference, reference_speed = np.nan, np.nan
    elif np.isfinite(reference) or np.isfinite(reference_speed):
        motion.referenced = time
    elif not time - motion.referenced > _UNSEEN_INTERVALS * motion.interval:
        # A few samples without a reference say nothing of it.
        return motion.way if motion.travels else np.nan
    # From its position if given, else from its velocity.
    if np.isfinite(reference):
        motion.way = reference
        error = abs(reference - position)
        if not error <= motion.slice_error:
            motion.slice_error = error
    else:
        motion.slice_referenced = False
        if np.isfinite(reference_speed):
            motion.way += reference_speed * step
    motion.reference, motion.reference_velocity = reference, reference_speed
    motion.travels = np.isfinite(reference) or np.isfinite(reference_speed)
    return motion.way if motion.travels else np.nan


@inlined()
def _may_rest(motion, detector):
    """Whether it is time to look if the joint has come to rest: it stands, and did so for too short a time before."""
    head = detector.head
    flat = detector.last_time - judgement.last_crossing_time(detector)
    if head != motion.looked:
        if head < 3 or not np.isfinite(detector.peak):
            return False
        newest, before = (head - 1) % kernel.RING, (head - 2) % kernel.RING
        gap = detector.crossings[newest, kernel.TIME] - detector.crossings[before, kernel.TIME]
        motion.looked = head
        motion.look_after = judgement.GAPS_AT_REST * max(gap, motion.now - detector.last_time)
    # Times that differ by less than the samples do are equal, however stamps are rounded.
    equal = 0.25 * (motion.now - detector.last_time)
    if not flat >= motion.look_after - equal or not detector.position.band < kernel.SLOW * detector.peak * flat:
        return False
    motion.look_after = _LOOK_AGAIN * flat
    return motion.awaits_rest


@compiled()
def replay(detector):
    """Process the first block, which had to be measured first; True whenever a low-speed interval is complete."""
    early = detector.early
    while detector.samples >= kernel.BLOCK and detector.replayed < kernel.BLOCK:
        n = detector.replayed
        detector.replayed += 1
        if kernel.process_sample(n, early[n, 0], early[n, 1], early[n, 2], early[n, 3], early[n, 4], detector):
            return True
    return False


@helper()
def _silence(motion):
    """Time without a sample [s], from which on nothing is known of what the joint did meanwhile."""
    usual = motion.interval if motion.interval == motion.interval else np.inf
    return min(max(_UNSEEN_INTERVALS * usual, _SHORTEST_SILENCE), LONGEST_SILENCE)


@helper()
def _note_reading(reading, count, signal):
    """Remember a raw reading, and what its step from the last one says of the resolution."""
    kernel.measure_step(abs(reading - signal.block[(count - 1) % kernel.BLOCK]), signal)
    signal.block[count % kernel.BLOCK] = reading


@compiled()
def follow(start, times, positions, velocities, efforts, references, reference_speeds, slices, motions, detectors):
    """Process samples from ``start`` until a low-speed interval or a swing ends, the joint may rest, or after silence.

    Returns the index of the next sample, and which of these it is. The records come in arrays of one each: unpacking
    two records takes numba microseconds, and their arrays less than a tenth of that.
    """
    motion, detector, coarse = motions[0], detectors[0], detectors[1]
    early = detector.early
    for i in range(start, times.shape[0]):
        if times[i] - motion.now > _silence(motion) and motion.now > -np.inf:
            return i, SILENT
        number = np.floor(times[i] / SLICE_LENGTH)
        if number != motion.slice:
            close_slice(slices, motion, detector, coarse)
            motion.slice, motion.slice_begin = number, times[i]
            motion.slice_error, motion.slice_referenced, motion.slice_steps = np.nan, True, 0
        way = _note(times[i], positions[i], references[i], reference_speeds[i], motion, detector)
        count = detector.samples
        _note_reading(positions[i], count, detector.position)
        _note_reading(velocities[i], count, detector.velocity)
        detector.samples = count + 1
        if (count + 1) % kernel.BLOCK == 0:
            kernel.measure_noise(detector.position)
            if _all_finite(detector.velocity.block):
                kernel.measure_noise(detector.velocity)
        if count < kernel.BLOCK:
            early[count, 0], early[count, 1], early[count, 2] = times[i], positions[i], velocities[i]
            early[count, 3], early[count, 4] = way, efforts[i]
            if count + 1 == kernel.BLOCK and replay(detector):
                return i + 1, LOW_SPEED
            continue
        head = detector.head
        complete = kernel.process_sample(count, times[i], positions[i], velocities[i], way, efforts[i], detector)
        coarse_count = coarse.samples
        coarse.samples = coarse_count + 1
        motion.coarse_complete = kernel.process_sample(
            coarse_count, times[i], positions[i], velocities[i], way, efforts[i], coarse
        )
        swung = detector.head > head and swings.follow_swing(motion, detector)
        if complete:
            return i + 1, LOW_SPEED
        if motion.coarse_complete:
            return i + 1, LOW_SPEED_COARSE
        if swung:
            return i + 1, SWUNG
        if _may_rest(motion, detector):
            return i + 1, STANDS
    return times.shape[0], ENDED


@compiled()
def scan_bounds(
    extremes, referred, largest, smallest, positions, velocities, efforts, references, reference_velocities
):
    """Whether no value but a position is as large as ``largest`` and no effort denormal; NaN is within.

    The extremes, lowest and highest effort and position, shape (2, 2), are widened by samples with both; ``referred``,
    shape (2,), becomes True where a reference position, or a reference velocity, is known.
    """
    within = True
    for n in range(efforts.shape[0]):
        effort, position = efforts[n], positions[n]
        # Comparisons with NaN are false.
        if abs(velocities[n]) >= largest or abs(references[n]) >= largest or abs(reference_velocities[n]) >= largest:
            within = False
        referred[0] = referred[0] or abs(references[n]) < largest
        referred[1] = referred[1] or abs(reference_velocities[n]) < largest
        if abs(effort) >= largest or 0.0 < abs(effort) < smallest:
            within = False
        elif abs(effort) < largest and abs(position) < largest:
            extremes[0, 0], extremes[0, 1] = min(extremes[0, 0], effort), max(extremes[0, 1], effort)
            extremes[1, 0], extremes[1, 1] = min(extremes[1, 0], position), max(extremes[1, 1], position)
    return within


@compiled()
def store(columns, known, at, begin, count, time, position, velocity, effort, reference, reference_velocity):
    """Copy samples into the columns of a block, but those that have nothing to say yet."""
    for number, values in enumerate((time, position, velocity, effort, reference, reference_velocity)):
        if not known[number]:
            some = False
            for n in range(begin, begin + count):
                some = some or not np.isnan(values[n])
            if not some:
                continue
            known[number] = True
            for n in range(at):
                columns[number, n] = np.nan
        # An assignment of slices takes ten times as long to compile.
        for n in range(count):
            columns[number, at + n] = values[begin + n]
