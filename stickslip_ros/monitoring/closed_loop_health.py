# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Closed-loop health while gains are changed: tracking error, swinging, oscillation, saturation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.reversal import turning_points
from stickslip_ros.monitoring.samples import Batch, FloatArray

_LEAST_SAMPLES = 16  # samples, 1: fewer show no oscillation
_ERROR_GROWTH = 1.5  # ratio of a tracking error or swing to that before, 1: a larger one is worse
_OSCILLATION_GROWTH = 3.0  # ratio of an oscillation to that before, 1: a larger one is worse
_RESOLUTIONS = 3.0  # amplitude, resolutions of the encoder: below it nothing is an oscillation
_SHARE_OF_EFFORT = 0.1  # oscillation of the effort, of the effort: a smaller one is none
_AT_LIMIT = 0.98  # effort, of its limit: a larger one is at the limit
_FOLLOWABLE = 0.4  # frequency, of the sample rate: a higher one is not seen
_LEAST_PERIODS = 6.0  # periods of an oscillation between two gaps, 1: slow motion seen for a moment only looks like one


@dataclass(frozen=True, kw_only=True)
class ClosedLoopHealth:
    """Health of a closed loop over one stretch of time; NaN for what is not known.

    Attributes
    ----------
    tracking_error : largest [rad].
    swing : to and fro, where no reference tells a tracking error; see :func:`swing_of` [rad].
    oscillation : root mean square of the position above the mechanical band [rad].
    effort_oscillation : the same of the effort [N·m].
    effort : largest [N·m].
    """

    tracking_error: float
    oscillation: float
    effort_oscillation: float
    effort: float
    swing: float = math.nan


def health_of(batch: Batch, band: float) -> ClosedLoopHealth:
    """Health over a stretch of samples.

    Parameters
    ----------
    band : frequency [Hz] up to which the joint moves by itself; what is above comes from the controller.
    """
    errors = np.abs(batch.reference_position - batch.position)
    return ClosedLoopHealth(
        tracking_error=_largest(errors),
        oscillation=_above(band, batch.time, batch.position),
        effort_oscillation=_above(band, batch.time, batch.effort),
        effort=_largest(np.abs(batch.effort)),
    )


def what_got_worse(
    before: ClosedLoopHealth,
    now: ClosedLoopHealth,
    *,
    softer: float = 1.0,
    resolution: float = 0.0,
    effort_limit: float = math.inf,
) -> str:
    """What got worse, for a person; "" if nothing did. What is not known is no finding.

    Parameters
    ----------
    softer : stiffness before over that of now: by so much a tracking error may grow.
    resolution : of the position [rad]. effort_limit : [N·m].
    """
    allowed = _ERROR_GROWTH * max(softer, 1.0) * before.tracking_error + _RESOLUTIONS * resolution
    if now.tracking_error > allowed:
        return f"the tracking error grew from {before.tracking_error:.3g} to {now.tracking_error:.3g} rad"
    if now.swing > _ERROR_GROWTH * max(softer, 1.0) * before.swing + _RESOLUTIONS * resolution:
        return f"the joint swings to and fro by {now.swing:.3g} rad; it was {before.swing:.3g}"
    if now.oscillation > max(_OSCILLATION_GROWTH * before.oscillation, _RESOLUTIONS * resolution):
        return f"an oscillation of {now.oscillation:.3g} rad (root mean square) began; it was {before.oscillation:.3g}"
    if now.effort_oscillation > max(_OSCILLATION_GROWTH * before.effort_oscillation, _SHARE_OF_EFFORT * before.effort):
        return (
            f"an oscillation of the effort of {now.effort_oscillation:.3g} N·m (root mean square) began; "
            f"it was {before.effort_oscillation:.3g}"
        )
    if now.effort >= _AT_LIMIT * effort_limit > before.effort:
        return f"the effort of {now.effort:.3g} N·m is at its limit"
    return ""


def swing_of(batch: Batch, resolution: float) -> float:
    """How far the joint goes to and fro [rad]: 0 as long as it turns less than three times, NaN with a reference.

    A joint that sticks and slips goes one way, and one that is told to turn turns once. One whose control is unstable
    turns again and again, sooner or later by more than it moves on in half a period.

    Parameters
    ----------
    resolution : of the position [rad]; a turn by less than three of it is none.
    """
    if np.isfinite(batch.reference_position).any():
        return math.nan
    turns = [at for at, _ in turning_points(batch.position, _RESOLUTIONS * resolution)]
    ways = np.abs(np.diff(batch.position[turns]))
    return float(np.minimum(ways[1:], ways[:-1]).max(initial=0.0))


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else math.nan


def _above(band: float, times: FloatArray, values: FloatArray) -> float:
    """Root mean square of what is above a frequency; NaN where too few samples could show it.

    A straight line over a gap would be an oscillation that nobody made: what lies between gaps is looked at by itself,
    and the strongest counts.
    """
    known = np.isfinite(values)
    if known.sum() < _LEAST_SAMPLES:
        return math.nan
    times, values = times[known], values[known]
    steps = np.diff(times)
    interval = float(np.median(steps))
    if not 0.0 < band < _FOLLOWABLE / interval:
        return math.nan
    gaps = np.flatnonzero(steps > _FOLLOWABLE / band) + 1
    if not len(gaps):
        return _oscillation(band, interval, times, values)
    found = []
    for time, value in zip(np.split(times, gaps), np.split(values, gaps), strict=True):
        duration = float(time[-1] - time[0])
        least = max(band, _LEAST_PERIODS / duration) if duration > 0.0 else math.inf
        if least < _FOLLOWABLE / interval:
            found.append(_oscillation(least, interval, time, value))
    return _largest(np.array(found))


def _oscillation(band: float, interval: float, times: FloatArray, values: FloatArray) -> float:
    """The same of samples without gaps, ``interval`` [s] apart for the most part."""
    grid = np.arange(times[0], times[-1], interval)
    if len(grid) < _LEAST_SAMPLES:
        return math.nan
    even = np.interp(grid, times, values)
    trend = np.polynomial.Polynomial.fit(grid, even, 1)
    window = np.hanning(len(grid))
    spectrum = np.abs(np.fft.rfft((even - trend(grid)) * window)) ** 2
    frequencies = np.fft.rfftfreq(len(grid), interval)
    power = 2.0 * spectrum[frequencies > band].sum() / (len(grid) * np.sum(window**2))
    return math.sqrt(float(power))
