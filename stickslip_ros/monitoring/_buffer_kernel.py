# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled copy of samples into a block of :mod:`.sample_buffer`."""

from __future__ import annotations

import numpy as np

from stickslip_ros.compilation import kernel


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
