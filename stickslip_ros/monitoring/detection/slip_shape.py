# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The course of a motion between two rests, from when it had gone which share of its way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Parts of a slip whose speeds are compared, 1: at most; crossings of each, 1: at least.
_PARTS, _CROSSINGS_A_PART = 32, 2
_BURST, _DIP = 0.3, 0.125  # speed of a burst and its fall between two bursts, of the fastest motion
_UPPER_QUARTILE = 0.92  # speed in half a cosine, of the fastest: upper quartile
_STRAIGHT = 0.43  # duration of the middle half, of the motion's: half a cosine takes 0.33, a steady slide 0.5
_SHARES = np.array([0.1, 0.25, 0.5, 0.75, 0.9])  # shares of a slip's way whose times are compared, 1


@dataclass(frozen=True, kw_only=True)
class SlipShape:
    """See the module. The ends, which are hard to date, do not count.

    Attributes
    ----------
    middle_half : from a quarter to three quarters of the way [s], NaN if unknown; a slip's is set by the natural
        frequency, whatever its distance.
    asymmetry : from half of the way to nine tenths, over from a tenth to half [1]; NaN if unknown. Above 1 the motion
        is fastest early, as one that follows a step of its reference.
    path_efficiency : net travel over the length of the path [1]; NaN if unknown.
    peak_speed_ratio : peak speed of the joint over that of the reference [1], each over a small part of the duration;
        infinite if the reference stood, NaN if unknown. A joint that follows has about 1, a spring that lets go more.
        In a steady slide, whose fastest part may be noise, the upper quartile counts.
    bursts : how often it got fast on its way [1]; a slip is one burst, and its bounce back none.
    straight : whether it is a steady slide with corners, which no spring makes.
    """

    middle_half: float = math.nan
    asymmetry: float = math.nan
    path_efficiency: float = math.nan
    peak_speed_ratio: float = math.nan
    bursts: int = 1
    straight: bool = False


def slip_shape(
    times: NDArray[np.float64], positions: NDArray[np.float64], references: NDArray[np.float64]
) -> SlipShape:
    """The shape of a motion through these places, the first and the last of which are rests; arrays of shape (n,)."""
    way = float(positions[-1] - positions[0])
    if way == 0.0:
        return SlipShape()
    shares = np.maximum.accumulate((positions - positions[0]) / way)
    middle_half = asymmetry = math.nan
    after = np.searchsorted(shares, _SHARES)
    if after[0] > 0 and after[-1] < len(shares):
        low, high = shares[after - 1], shares[after]
        at = times[after - 1] + (_SHARES - low) / (high - low) * (times[after] - times[after - 1])
        tenth, quarter, half, three_quarters, nine_tenths = at.tolist()
        if quarter < three_quarters and tenth < half:
            middle_half, asymmetry = three_quarters - quarter, (nine_tenths - half) / (half - tenth)
    straight = middle_half > _STRAIGHT * float(times[-1] - times[0])
    changes = np.flatnonzero(np.diff(references)) + 1
    if len(changes) > 1:
        # One that comes more slowly than the samples stands in between, and goes on evenly all the same.
        references = np.interp(times, times[changes], references[changes])
    elif len(changes) == 1:
        # A joint that answers a single step by as much is about twice as fast as the mean at its fastest.
        references = np.interp(times, [times[0], 0.5 * (times[0] + times[-1])], references[[0, -1]])
    edges = np.linspace(times[0], times[-1], min(len(times) // _CROSSINGS_A_PART, _PARTS) + 1)
    forward, of_reference = (np.diff(np.interp(edges, times, places)) for places in (positions, references))
    steps, of_reference = np.abs(forward), np.abs(of_reference)
    fast, reference = float(np.max(steps)), float(np.max(of_reference))
    if straight:
        fast, reference = float(np.quantile(steps, 0.75)) / _UPPER_QUARTILE, float(np.quantile(of_reference, 0.75))
    return SlipShape(
        middle_half=middle_half,
        asymmetry=asymmetry,
        path_efficiency=abs(way) / float(np.sum(np.abs(np.diff(positions)))),
        peak_speed_ratio=math.inf if reference == 0.0 else fast / reference,
        bursts=_bursts((math.copysign(1.0, way) * forward).tolist()),
        straight=straight,
    )


def _bursts(speeds: list[float]) -> int:
    """How often the speed gets fast after it was slow."""
    fastest, bursts, slow = max(speeds), 0, True
    for speed in speeds:
        if slow and speed >= _BURST * fastest:
            bursts, slow = bursts + 1, False
        slow = slow or speed < _DIP * fastest
    return bursts
