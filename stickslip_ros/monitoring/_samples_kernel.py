# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled loops over the samples of a joint: whether they are within bounds, and their copy into a block."""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import kernel


@kernel()
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


@kernel()
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
