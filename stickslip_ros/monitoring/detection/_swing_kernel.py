# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled search for swings about a reference that stands or goes on evenly, from turn to turn.

It takes the records of :mod:`._judgement_kernel`, whose search for rests misses them: a joint that turns round need not
stop.
"""

from __future__ import annotations

from stickslip_ros.compilation import helper
from stickslip_ros.monitoring.detection import _crossing_kernel as kernel

SWING_COLUMNS = 11  # fields of a Swing, 1
FLICKER = 6.0  # motion, bands: a reading that is noisy now and then goes so far to and fro
STANDS = 0.05  # motion of the reference, of a swing or a slip: with less it stands
_LED = 0.5  # motion of the reference the same way, of a swing: with more it leads the joint
_LEAST_TURN = 3.0  # motion back, bands: with more the joint has turned, if the swing is small
_LEAST_SAMPLES = 5.0  # samples in a swing, 1: fewer may be noise
_MIDDLE = 0.1  # ends of a swing that are not its middle, of the swing
_TURNED_BACK = 0.3  # motion back, of a swing: with more the joint has turned for certain


@helper()
def _time_at(place, turn, detector):
    """When the joint passed a place after a turn, between the crossings about it."""
    begin = detector.crossings[turn % kernel.RING, kernel.POSITION]
    after = turn + 1
    while abs(detector.crossings[after % kernel.RING, kernel.POSITION] - begin) < abs(place - begin):
        after += 1
    at, before = after % kernel.RING, (after - 1) % kernel.RING
    since, until = detector.crossings[before, kernel.FLAT_END], detector.crossings[at, kernel.TIME]
    reached = detector.crossings[before, kernel.POSITION]
    share = (place - reached) / (detector.crossings[at, kernel.POSITION] - reached)
    return since + share * (until - since)


@helper()
def _reference_goes_on(swing, motion, detector):
    """Whether the reference has stood or gone one way since the swings are followed; a part of a swing is no matter."""
    if not motion.travels:
        return False
    if not abs(motion.way - motion.way_began) < abs(motion.way_farthest - motion.way_began):
        motion.way_farthest = motion.way
    return abs(motion.way_farthest - motion.way) <= max(detector.position.band, STANDS * abs(swing))


@helper()
def follow_swing(motion, detector):
    """Follow the newest crossing from turn to turn about the reference; True if it completes a swing.

    A turn is certain when the joint has gone back by a share of the swing, as far as the reference did not go along.
    The first motion may be far longer than the swings, so that it is no measure of them.
    """
    newest = detector.head - 1
    now, last = newest % kernel.RING, max(newest - 1, 0) % kernel.RING
    place = detector.crossings[now, kernel.POSITION]
    turn, farthest = motion.turn % kernel.RING, motion.farthest % kernel.RING
    begin, extreme = detector.crossings[turn, kernel.POSITION], detector.crossings[farthest, kernel.POSITION]
    band = detector.position.band
    kept = motion.swing_direction != 0.0 and newest - motion.turn < kernel.RING
    if not (kept and _reference_goes_on(place - begin, motion, detector)):
        motion.way_began = motion.way_farthest = motion.way
        motion.swing_turned = False
        motion.turn, motion.farthest = max(newest - 1, 0), newest
        motion.swing_direction = 1.0 if place > detector.crossings[last, kernel.POSITION] else -1.0
        return False
    back = motion.swing_direction * (extreme - place)
    if back <= 0.0:
        motion.farthest = newest
        return False
    first = not motion.swing_turned
    # Since the joint reached its turn: a reference that goes the same way as the joint may be what moves it.
    travel = detector.crossings[farthest, kernel.REFERENCE] - detector.crossings[turn, kernel.REFERENCE]
    if back < max(_LEAST_TURN * band, 0.0 if first else _TURNED_BACK * abs(extreme - begin - travel)):
        return False
    stood = detector.crossings[turn, kernel.FLAT_END] - detector.crossings[turn, kernel.TIME]
    moved = detector.crossings[farthest, kernel.TIME] - detector.crossings[turn, kernel.FLAT_END]
    # The first motion is a swing only if the joint stood before it.
    swung = (not first or stood > moved) and moved > _LEAST_SAMPLES * motion.interval
    swung &= abs(extreme - begin) > max(FLICKER * band, motion.swing_direction * travel / _LED)
    if swung:
        early = _time_at(begin + _MIDDLE * (extreme - begin), motion.turn, detector)
        late = _time_at(extreme - _MIDDLE * (extreme - begin), motion.turn, detector)
        motion.swing[0], motion.swing[1] = (
            detector.crossings[turn, kernel.TIME],
            detector.crossings[turn, kernel.FLAT_END],
        )
        motion.swing[2] = detector.crossings[farthest, kernel.TIME]
        motion.swing[3], motion.swing[4] = begin, extreme - begin
        motion.swing[5] = motion.reference - begin
        motion.swing[6] = detector.crossings[turn, kernel.EFFORT_FLAT_END]
        motion.swing[7] = late - early
        motion.swing[8], motion.swing[9] = detector.crossings[farthest, kernel.FLAT_END], band
        motion.swing[10] = travel
        motion.swung = True
    motion.swing_turned = True
    motion.turn, motion.farthest = motion.farthest, newest
    motion.swing_direction = -motion.swing_direction
    return swung
