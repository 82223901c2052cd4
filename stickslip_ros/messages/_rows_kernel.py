# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled walks: messages of one layout and parts of each, and whole turns in the positions of one joint."""

from __future__ import annotations

import math

import numpy as np

from stickslip_ros.compilation import kernel


@kernel()
def matching(buffer, offsets, lengths, template, mask, least, most):
    """Which messages agree with a template in all bytes that a mask of 0 and 255 leaves, and have its length."""
    matches = np.zeros(offsets.shape[0], dtype=np.bool_)
    for n in range(offsets.shape[0]):
        if lengths[n] < least or lengths[n] > most:
            continue
        begin = offsets[n]
        # Without a way out of the loop it compares many bytes at once.
        differs = np.uint8(0)
        for k in range(template.shape[0]):
            differs |= (buffer[begin + k] ^ template[k]) & mask[k]
        matches[n] = differs == 0
    return matches


@kernel()
def gather(buffer, offsets, places, sizes, out):
    """Copy parts of every message, one after the other, into its row of bytes."""
    for n in range(offsets.shape[0]):
        to = 0
        for p in range(places.shape[0]):
            begin = offsets[n] + places[p]
            for k in range(sizes[p]):
                out[n, to + k] = buffer[begin + k]
            to += sizes[p]


TURN = 2.0 * math.pi
# Step that is left when the whole turn is taken off: as a share of a turn, and in steps before it. A joint that starts
# or speeds up within one sample stays below that.
SMALL_STEP = 0.02
STEPS_BEFORE = 3.0
LARGEST_STEP = 0.1  # of a turn, however fast the joint was before; no joint moves further from sample to sample
# Width of the interval that a wrapping position never leaves [turns]; a joint that counts its turns leaves it.
WIDEST = 1.0 + SMALL_STEP
# Columns of a joint's state [rad]: last position and lowest and highest one as they came, last step less its turn, and
# what is added.
LAST, LOWEST, HIGHEST, STEP, ADDED = range(5)


@kernel()
def follow(positions, largest, state, added):
    """Set what is added to each position, go on with the state, and return how many whole turns were removed.

    Positions that are NaN, or as large as ``largest``, change nothing.
    """
    turns = 0
    for n in range(positions.shape[0]):
        position = positions[n]
        if abs(position) < largest:
            step = 0.0 if np.isnan(state[LAST]) else position - state[LAST]
            state[LAST] = position
            state[LOWEST], state[HIGHEST] = min(state[LOWEST], position), max(state[HIGHEST], position)
            turn = math.copysign(TURN, step)
            left = abs(step - turn)
            goes_on = left < LARGEST_STEP * TURN and left <= STEPS_BEFORE * abs(state[STEP]) + SMALL_STEP * TURN
            if goes_on and state[HIGHEST] - state[LOWEST] <= WIDEST * TURN:
                state[ADDED] -= turn
                turns += 1
                step -= turn
            elif abs(step) > LARGEST_STEP * TURN:
                # A jump to a wrong value: the jump back is no turn either.
                step = np.nan
            state[STEP] = step
        added[n] = state[ADDED]
    return turns
