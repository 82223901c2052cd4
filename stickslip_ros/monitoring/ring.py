# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How a joint rings after its slips: frequency and damping of the oscillation that dies out while it stands.

Where the encoder is on the load, and the motor sticks, the load swings on the spring between them at the antiresonance
(:mod:`stickslip_ros.model.transmission`); a contact that yields rings too, at the root of (k_p + σ₀)/M. To the samples
of each rest a + b t + c t² + exp(−ζ ω t) (p cos ω_d t + q sin ω_d t) is fitted, of which a to c are drift and creep.
The scatter of the rests gives the errors.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from stickslip_ros.monitoring.detection.rests import Rest
from stickslip_ros.monitoring.samples import FloatArray, SampleBuffer

_KEPT = 50  # latest rests that are kept, 1
_LEAST_RESTS, _LEAST_SHARE = 4, 0.5  # rests that ring, 1: at least; of all rests long enough to show it
_LONGEST = 3.0  # span of samples that a ring is fitted to, s
_LEAVING = 0.1  # of the dwell, at its end: there the joint may have begun to leave
_LEAST_SAMPLES, _MOST_SAMPLES = 24, 1000  # samples that are fitted, 1: at least for seven numbers; at most
_LEAST_SWING = 3.0  # ring from peak to peak, bands: at least
_LEAST_PERIODS, _SAMPLES_OF_A_PERIOD = 1.5, 5.0  # periods in a rest, samples in a period, 1: at least
_EVALUATIONS = 30  # evaluations of a fit, 1: at most
_FINER = 4  # lines of the spectrum, of those without zeros behind the samples, 1
_DECAYS = (0.5, 2.0, 6.0)  # decay over the samples from which a fit may begin, 1
# Explained variance about drift and creep, of a start and of the fit, 1: with less something else moves the joint.
_PROMISING, _EXPLAINED = 0.5, 0.85
_DIES = 0.8  # amplitude at the end of the samples, of that at the arrest: with more it is vibration from elsewhere
_MOST_DAMPED = 0.5  # damping ratio, 1: with more there is no ring to speak of
_SCATTER = 0.1  # scatter of the frequency, of it: with more the rests do not ring alike
_NORMAL = 1.4826  # standard deviation of a normal variable, of its median absolute deviation
_OF_A_MEDIAN = 1.2533  # standard error of a median, of that of a mean


@dataclass(frozen=True, kw_only=True)
class RingEstimate:
    """How a joint rings after its slips.

    Attributes
    ----------
    frequency : of the damped oscillation [Hz]. damping_ratio : [1]. Each with its standard error.
    rests : how many it was learnt from.
    """

    frequency: float = field(metadata={"unit": "Hz"})
    frequency_std: float = field(metadata={"unit": "Hz"})
    damping_ratio: float = field(metadata={"unit": "1"})
    damping_ratio_std: float = field(metadata={"unit": "1"})
    rests: int


class RingMeter:
    """Learns the ring rest by rest, from the latest ones; ``estimate`` : what they say together, None if nothing."""

    def __init__(self) -> None:
        self._found: deque[tuple[float, float] | None] = deque(maxlen=_KEPT)
        self.estimate: RingEstimate | None = None

    def add_rest(self, rest: Rest, samples: SampleBuffer) -> None:
        """Take a rest that is known in full."""
        if rest.direction_before == 0:
            return
        end = rest.breakaway - _LEAVING * rest.dwell
        seen = samples.between(rest.arrest, min(end, rest.arrest + _LONGEST))
        if seen is None or len(seen) < _LEAST_SAMPLES:
            return
        few = slice(None, None, 1 + len(seen) // _MOST_SAMPLES)
        self._found.append(_ring(seen.time[few], seen.position[few], rest.band))
        self.estimate = _together(self._found)


def _ring(times: FloatArray, positions: FloatArray, band: float) -> tuple[float, float] | None:
    """Frequency [Hz] and damping ratio of the ring in one rest; None if it has none."""
    span = float(times[-1] - times[0])
    scaled = (times - times[0]) / span
    drift = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=1)
    beside = positions - drift @ np.linalg.lstsq(drift, positions, rcond=None)[0]
    variance = float(beside @ beside)
    if not np.ptp(beside) > _LEAST_SWING * band:
        return None
    # Imported where it is needed, as it takes a fifth of a second.
    from scipy.optimize import least_squares

    # Starts: the highest lines of position and velocity in the spectrum of samples evenly apart, zeros behind them.
    even = np.interp(np.linspace(0.0, 1.0, len(scaled)), scaled, beside)
    lines = np.abs(np.fft.rfft(even, _FINER * len(even)))
    most = len(times) / _SAMPLES_OF_A_PERIOD
    lines[: math.ceil(_FINER * _LEAST_PERIODS)], lines[int(_FINER * most) :] = 0.0, 0.0
    begins = {int(np.argmax(one)) / _FINER for one in (lines, lines * np.arange(len(lines)))}
    scale = math.sqrt(variance)

    def residuals(point: Sequence[float] | FloatArray) -> FloatArray:
        """With the best drift, amplitude and phase, of the variance's root."""
        angle, decay = 2.0 * math.pi * point[0] * scaled, np.exp(-point[1] * scaled)
        columns = np.column_stack([drift, decay * np.cos(angle), decay * np.sin(angle)])
        return np.asarray(positions - columns @ np.linalg.lstsq(columns, positions, rcond=None)[0]) / scale

    left, start = min((float(np.square(residuals(one)).sum()), one) for one in product(begins, _DECAYS))
    if left > 1.0 - _PROMISING or not _LEAST_PERIODS <= start[0] <= most:
        return None
    bounds = [_LEAST_PERIODS, 0.0], [most, 2.0 * math.pi * _MOST_DAMPED * most]
    found = least_squares(residuals, start, bounds=bounds, max_nfev=_EVALUATIONS)
    periods, decay = found.x.tolist()
    damping_ratio = decay / math.hypot(decay, 2.0 * math.pi * periods)
    if 2.0 * found.cost > 1.0 - _EXPLAINED or not math.exp(-decay) < _DIES or damping_ratio > _MOST_DAMPED:
        return None
    return periods / span, damping_ratio


def _together(found: deque[tuple[float, float] | None]) -> RingEstimate | None:
    known = np.array([one for one in found if one is not None])
    if len(known) < max(_LEAST_RESTS, _LEAST_SHARE * len(found)):
        return None
    middle = np.median(known, axis=0)
    scatter = _NORMAL * np.median(np.abs(known - middle), axis=0)
    if scatter[0] > _SCATTER * middle[0]:
        return None
    errors = _OF_A_MEDIAN * scatter / math.sqrt(len(known))
    return RingEstimate(
        frequency=float(middle[0]),
        frequency_std=float(errors[0]),
        damping_ratio=float(middle[1]),
        damping_ratio_std=float(errors[1]),
        rests=len(known),
    )
