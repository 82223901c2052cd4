# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled first stage of detection: samples to crossings, crossings to low-speed intervals.

A crossing of a level is noted whenever the joint has moved by one band: the encoder's resolution, or the noise if that
is larger. Slow motion has long gaps between crossings, fast motion short ones, whatever the sampling
rate. A low-speed interval is a run of gaps much slower than the motion before it; it ends when the joint moves much
faster again. :mod:`.rests` decides whether the joint was at rest in a low-speed interval, :mod:`.cycles` whether the
rest was a stick.

A joint that creeps on a fine encoder crosses a band with every sample. So there is a second, coarse scale: its band is
as wide as the joint's usual motion in a slice of time, and creep is as slow to it as a stand.
"""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import helper, inlined, kernel
from stickslip_ros.monitoring._quantile_kernel import quantile

BLOCK = 32  # raw readings of a block, 1
RING = 4096  # latest crossings that are kept, 1
BLOCKS_KEPT = 64  # latest blocks whose noise is kept, 1

# Columns of a crossing.
(
    TIME,
    POSITION,
    FLAT_END,
    REFERENCE,
    REFERENCE_FLAT_END,
    ADVANCE,  # time integral of the way that the reference went on, until the end of the flat
    EFFORT_FLAT_END,
    SPEED,
    SLOWEST,
    SAMPLE,  # number of the sample that set it
) = range(10)
CROSSING_COLUMNS = SAMPLE + 1

# What is measured of one signal, its resolution and its noise.
SIGNAL = np.dtype(
    [
        ("band", float),  # the smallest motion that is told from rest
        ("resolution", float),
        ("noise", float),
        ("largest", float),  # reading ever, impulses left out
        ("smallest", float, 3),  # steps ever seen
        ("block", float, BLOCK),  # of raw readings
        ("noises", float, (2, BLOCKS_KEPT)),  # of the latest blocks
    ]
)
DETECTOR = np.dtype(
    [
        ("position", SIGNAL),
        ("velocity", SIGNAL),
        ("samples", np.int64),  # ever taken
        ("early", float, (BLOCK, 5)),  # the first block, which waits to be measured
        ("replayed", np.int64),  # of it, the samples taken
        ("median_1", float),
        ("median_2", float),  # the two previous raw positions, the latest first
        ("median_time", float),
        ("median_reference", float),
        ("median_effort", float),
        ("velocity_1", float),
        ("velocity_2", float),  # the two previous measured velocities, the latest first
        ("slowest_velocity", float),  # measured since the last crossing
        ("last_time", float),
        ("last_reference", float),
        ("level_reference", float),  # at the last crossing
        ("advance", float),  # time integral of the way that the reference went on since then
        ("last_effort", float),
        ("crossings", float, (RING, CROSSING_COLUMNS)),
        ("head", np.int64),  # crossings ever set
        ("level", float),  # the last crossing's reading
        ("sign", float),  # direction of the last crossing
        ("interval", float),  # usual time between samples
        ("update", float),  # how often the position changes while the joint moves fast; sensors may be slower
        ("peak", float),  # fastest motion since the last rest
        ("in_low_speed", np.bool_),
        ("longest_gap", np.int64),  # crossing from which the low-speed interval's longest gap runs
        ("longest_time", float),
        ("crossings_to_wait", np.int64),  # see CROSSINGS_TO_WAIT
        ("peak_after", float),  # fastest motion since the longest gap
    ]
)

_LATEST, _ORDERED = 0, 1  # rows of the blocks' noise: as it came, and in order
FAST_SHARE = 0.9  # quantile of speeds, 1: noise and jittered stamps make the faster ones
SLOW = 0.1  # speed in a gap, of the fastest motion beside it: a slower gap is slow
_REVERSALS_KEPT = BLOCK - 2 - 3  # number, 1: a block has two reversals less than readings, and three may be impulses
# Mean of these reversals for white noise, standard deviations: computed on 400,000 blocks.
_REVERSAL_OF_UNIT_NOISE = 0.7236
_BANDS_PER_NOISE = 5.0  # band, standard deviations of the noise
_LEAST_BAND = 1e-15  # band, unit of the signal
_ROUNDING = 1e-10  # difference of two readings, of the largest reading: a smaller one is arithmetic, not motion
STEPS_OF_SPEED = 3.0  # step, bands: a larger one has a speed of its own
_GAPS_OF_UPDATE = 16  # latest gaps that tell how often a sensor is read anew, 1
_HOLD_LIMIT = 2.5  # gap, intervals of a sensor's update: in a longer one the joint stood
_BEFORE_A_HOLD = 4  # crossings before a gap whose fastest motion tells how far the joint would have come, 1
_AS_FAR = (0.6, 1.6)  # way, of that
_ALL_OF_IT = 1.0 + 1e-9  # way of a speed in its gap, of the step
_CROSSINGS_TO_LEAVE = 4  # crossings after the longest gap, 1: with fewer a low-speed interval has not ended
CROSSINGS_TO_WAIT = (128, 512)  # crossings until a slip that gets no faster has ended it, 1: fine scale, coarse scale
_NO_FASTER = 0.6  # speed, of the fastest motion since the longest gap: with less the slip gets no faster
_FAST_AGAIN = 0.4  # speed, of the fastest motion before the low-speed interval


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
def _median(a, b, c):
    return max(min(a, b), min(max(a, b), c))


@helper()
def measure_step(step, signal):
    """Update the resolution, and with it the band, from the size of a step between raw readings.

    ``smallest`` keeps the three smallest steps ever seen; its last one is taken as the resolution, so that two odd
    values do no harm. Before there are three, it is the largest of those seen.
    """
    smallest = signal.smallest
    if not (_ROUNDING * signal.largest < step < smallest[2]):
        return
    if step < smallest[0]:
        smallest[2], smallest[1], smallest[0] = smallest[1], smallest[0], step
    elif step < smallest[1]:
        smallest[2], smallest[1] = smallest[1], step
    else:
        smallest[2] = step
    for i in range(3):
        if np.isfinite(smallest[i]):
            signal.resolution = smallest[i]
    _set_band(signal)


@helper()
def _set_band(signal):
    # As long as nothing has changed nothing is known.
    known = signal.resolution > 0.0
    least = max(4.0 * _ROUNDING * signal.largest, _LEAST_BAND)
    signal.band = max(signal.resolution, _BANDS_PER_NOISE * signal.noise, least) if known else np.inf


@helper()
def measure_noise(signal):
    """Update the noise from the block of raw readings, and with it the band.

    Noise is taken from steps that turn back at once, which steady motion, however fast, does not do. Motion hides it:
    a block that moves by more than its noise from one reading to the next says nothing. Of the last blocks that say
    something the upper quartile is taken.
    """
    block = signal.block
    for i in range(2, block.shape[0]):
        # One wild reading is not where the joint is.
        signal.largest = max(signal.largest, abs(_median(block[i], block[i - 1], block[i - 2])))
    # The sum of what turns back, without the three largest.
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
    moved = abs(block[-1] - block[0]) / (block.shape[0] - 1)
    if _BANDS_PER_NOISE * moved <= signal.band or moved <= noise or np.isnan(signal.noises[_LATEST, 0]):
        signal.noise = _upper_quartile(noise, signal.noises)
    _set_band(signal)


@helper()
def _first_update(between, detector):
    """How often a sensor is read anew, by what came before its resolution was known [s]: no step was called large then.

    That is the median gap of the latest large steps where it is clearly longer than the time between samples.
    """
    gaps, count, n = np.empty(_GAPS_OF_UPDATE), 0, detector.head - 1
    while count < _GAPS_OF_UPDATE and n > max(0, detector.head - RING):
        now, before = n % RING, (n - 1) % RING
        step = abs(detector.crossings[now, POSITION] - detector.crossings[before, POSITION])
        if step >= STEPS_OF_SPEED * detector.position.band:
            gaps[count] = detector.crossings[now, TIME] - detector.crossings[before, TIME]
            count += 1
        n -= 1
    usual = quantile(gaps, count, 0.5) if 4 * count >= _GAPS_OF_UPDATE else 0.0
    return usual if usual > _HOLD_LIMIT * between else between


@helper()
def _makes_up(step, gap, up, detector):
    """Whether a step makes up for all of the gap before it: no joint comes back at once to where it would have been.

    A sensor does, that was not read meanwhile. A slip of few samples is faster than all that lies between two slips.
    """
    fastest, n = 0.0, detector.head - 1
    while n > max(0, detector.head - 1 - _BEFORE_A_HOLD):
        speed = detector.crossings[n % RING, SPEED]
        if (speed > 0.0) != up:
            return False
        fastest, n = max(fastest, abs(speed)), n - 1
    return _AS_FAR[0] * fastest * gap <= step <= _AS_FAR[1] * fastest * gap


@inlined()
def _set_crossing(count, time, position, step, reference, effort, detector):
    """Append a crossing; ``step`` is the signed change of the reading since the last one."""
    head = detector.head
    # Rows of the ring. A view of a row costs a hundredth of a second to compile wherever it is taken.
    new, last, one_before = head % RING, (head - 1) % RING, max(head - 2, 0) % RING
    resolution = detector.position.resolution
    sign = 1.0 if step > 0.0 else -1.0
    crossing_time, crossing_position = time, position
    if head > 0:
        if (
            abs(step) < detector.position.band + 0.5 * resolution
            and resolution >= _BANDS_PER_NOISE * detector.position.noise
        ):
            # One count: the joint stood on the border between two readings, in between two samples.
            crossing_time = 0.5 * (detector.last_time + time)
            crossing_position = position - 0.5 * sign * resolution
        detector.crossings[last, FLAT_END] = max(detector.last_time, detector.crossings[last, TIME])
        detector.crossings[last, REFERENCE_FLAT_END] = detector.last_reference
        detector.crossings[last, ADVANCE] = detector.advance
        detector.crossings[last, EFFORT_FLAT_END] = detector.last_effort
        detector.crossings[last, SLOWEST] = detector.slowest_velocity
    detector.slowest_velocity = np.nan
    detector.crossings[new, TIME] = crossing_time
    detector.crossings[new, POSITION] = crossing_position
    detector.crossings[new, FLAT_END] = crossing_time
    detector.crossings[new, REFERENCE] = reference
    detector.crossings[new, REFERENCE_FLAT_END] = reference
    detector.crossings[new, ADVANCE] = 0.0
    detector.crossings[new, EFFORT_FLAT_END] = effort
    detector.crossings[new, SLOWEST] = np.nan
    detector.crossings[new, SPEED] = 0.0
    detector.crossings[new, SAMPLE] = count
    if head > 0:
        before = last
        if abs(step) >= STEPS_OF_SPEED * detector.position.band:
            gap = crossing_time - detector.crossings[last, TIME]
            between = time - detector.last_time
            # Samples that are missing are no slow sensor.
            seen = between <= _HOLD_LIMIT * detector.interval
            if seen and detector.update == 0.0:
                detector.update = _first_update(between, detector)
            held = gap <= _HOLD_LIMIT * detector.update or _makes_up(abs(step), gap, step > 0.0, detector)
            elapsed = gap if held else max(time - detector.crossings[last, FLAT_END], detector.update)
            if seen:
                # A running median, in steps of a tenth.
                detector.update *= 1.1 if gap > detector.update else 1.0 / 1.1
        else:
            # Over two gaps, because single counts come in whole samples.
            before = one_before
            elapsed = crossing_time - detector.crossings[before, TIME]
        if elapsed > 0.0:
            detector.crossings[new, SPEED] = (crossing_position - detector.crossings[before, POSITION]) / elapsed
    detector.level, detector.level_reference, detector.advance = position, reference, 0.0
    detector.sign = sign
    detector.head = head + 1


@inlined()
def _follow_low_speed(detector):
    """Update the low-speed interval with the gap that the newest crossing has ended; True if that completes it.

    The joint is slow where it takes ten times as long for a band as in the fastest motion before. The interval is
    complete when the joint has been ten times as fast again as it was slowest. Nothing before that motion counts.
    """
    newest = detector.head - 1
    if newest < 1:
        return False
    now, gap = newest % RING, (newest - 1) % RING
    band, speed = detector.position.band, abs(detector.crossings[now, SPEED])
    step = abs(detector.crossings[now, POSITION] - detector.crossings[gap, POSITION])
    large = step >= STEPS_OF_SPEED * band
    stood = _time_for_a_band(newest, detector)
    if not detector.in_low_speed:
        if band < SLOW * detector.peak * stood:
            _begin_low_speed(newest - 1, stood, detector)
        else:
            detector.peak = max(detector.peak, speed)
        return False
    if band < SLOW * detector.peak_after * min(stood, detector.longest_time):
        return True
    if stood > detector.longest_time:
        _begin_low_speed(newest - 1, stood, detector)
        return False
    after = newest - detector.longest_gap
    # A speed over two gaps lies wholly after the longest gap from the third crossing on.
    if after >= 3 or large:
        detector.peak_after = max(detector.peak_after, speed)
    if not band < SLOW * detector.peak_after * detector.longest_time or (after < _CROSSINGS_TO_LEAVE and not large):
        return False
    if speed >= _FAST_AGAIN * detector.peak:
        return True
    # To a fine encoder so many crossings are but the beginning of a slip: as long as it gets faster, it is one.
    return after >= (detector.crossings_to_wait if speed < _NO_FASTER * detector.peak_after else RING // 2)


@helper()
def _time_for_a_band(newest, detector):
    """How long the joint took for a band, in the gap that a crossing has ended: for all of a stand, or at its speed."""
    now, gap = newest % RING, (newest - 1) % RING
    band = detector.position.band
    step = abs(detector.crossings[now, POSITION] - detector.crossings[gap, POSITION])
    lasted = detector.crossings[now, TIME] - detector.crossings[gap, TIME]
    flat = detector.crossings[gap, FLAT_END] - detector.crossings[gap, TIME]
    # A flat before a large step that took all of the gap is a sensor that repeats itself.
    if step >= STEPS_OF_SPEED * band and abs(detector.crossings[now, SPEED]) * lasted <= _ALL_OF_IT * step:
        flat = 0.0
    return max(flat, lasted * band / max(step, band))


@helper()
def _begin_low_speed(gap, stood, detector):
    detector.longest_gap = gap
    detector.longest_time = stood
    detector.peak_after = 0.0
    detector.in_low_speed = True


@kernel()
def close_low_speed(rested, detector):
    """Restart after a low-speed interval, with or without a rest; the newest gap may be the first of the next one.

    Where it did not rest the motion goes on: a bounce on an elastic contact belongs to the slip before it.
    """
    newest = detector.head - 1
    stood = _time_for_a_band(newest, detector)
    goes_on = not rested and np.isfinite(detector.peak)
    detector.peak = max(detector.peak, detector.peak_after) if goes_on else detector.peak_after
    detector.in_low_speed = False
    if newest - 1 > detector.longest_gap and detector.position.band < SLOW * detector.peak * stood:
        _begin_low_speed(newest - 1, stood, detector)


@helper()
def process_sample(count, now, raw, pace_now, way_now, effort_now, detector):
    """Process sample number ``count``; True if it completes a low-speed interval.

    A sample is time, position, velocity, path of the reference and effort. The longest gap of a completed interval
    stands in the state (``LONGEST_GAP``), the crossings about it in the ring.
    """
    # A median of three keeps single-sample impulses out and leaves monotonic motion as it is.
    position = _median(raw, detector.median_1, detector.median_2) if count >= 2 else detector.median_1
    time, reference, effort = detector.median_time, detector.median_reference, detector.median_effort
    detector.median_2, detector.median_1 = detector.median_1, raw
    detector.median_time, detector.median_reference, detector.median_effort = now, way_now, effort_now
    if count == 0:
        return False
    complete = False
    first = detector.head == 0
    step = 0.0 if first else position - detector.level
    needed = detector.position.band if step * detector.sign >= 0.0 else 2.0 * detector.position.band
    if first or abs(step) >= needed * (1.0 - 1e-6):
        _set_crossing(count, time, position, step, reference, effort, detector)
        if first:
            detector.sign = 0.0
        else:
            complete = _follow_low_speed(detector)
    else:
        meanwhile = 0.5 * (detector.last_reference + reference) - detector.level_reference
        detector.advance += meanwhile * (time - detector.last_time)
    # The slowest that a velocity sensor saw since the last crossing, impulses left out.
    pace = abs(_median(pace_now, detector.velocity_1, detector.velocity_2)) if count >= 2 else np.nan
    detector.velocity_2, detector.velocity_1 = detector.velocity_1, pace_now
    if not pace >= detector.slowest_velocity:
        detector.slowest_velocity = pace
    if count >= 2:
        between = time - detector.last_time
        # A running median, in steps of a tenth.
        detector.interval *= 1.1 if between > detector.interval else 1.0 / 1.1
        if detector.interval == 0.0:
            detector.interval = between
    detector.last_time, detector.last_reference, detector.last_effort = time, reference, effort
    return complete
