# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Compiled walks through messages of one layout: which have it, and parts of each."""

from __future__ import annotations

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
