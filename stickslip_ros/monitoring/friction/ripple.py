# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A periodic part of friction over position, as gears, bearings and cogging make it: found, and how surely.

A sine of every period is fitted beside what is known otherwise (Lomb 1976, Scargle 1982). The more periods there are to
choose from, the better chance alone fits: how well it does is bounded after Baluev, "Assessing the statistical
significance of periodogram peaks", Monthly Notices of the Royal Astronomical Society 385, 2008 (Table 1, residual
variance unknown). Slips that lie evenly cannot tell a period from shorter ones: these are named.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip_ros.model.bounds import TINY
from stickslip_ros.monitoring.friction.regression import Regression, prewhitened, regression
from stickslip_ros.monitoring.samples import FloatArray

_PER_PEAK = 10  # frequencies tried within the width of a peak, 1
_MOST_TRIED = 20_000  # frequencies tried, 1: at most
_SHORTER = 10.0  # range of other periods, of the period found: so much shorter ones are searched
_EQUALLY_LIKELY = 6.0  # twice the logarithm of a likelihood ratio, 1: with less two periods are equally likely
_MOST_ALIASES = 4  # periods reported that explain as much, 1: at most
_DIGITS = 6  # decimals in which two likelihoods are compared, 1: the rest is rounding
_LEAST_SEEN, _LEAST_ROUND = 0.2, 0.05  # of a sine and cosine: beside what is known otherwise, and beside each other
_BLOCK = 2000  # frequencies tried at once, 1
_NARROWED = 4  # refinements of a frequency, 1: by a tenth each
_PERIODS_SEEN = 1.5  # periods in the range of positions, 1: with less there is no period but a bend


@dataclass(frozen=True, kw_only=True)
class Ripple:
    """Friction that is a sine over position: amplitude · sin(2π (x − about)/period + phase).

    Attributes
    ----------
    amplitude, amplitude_std : of the sine, and its standard error [N·m].
    period, period_std : likewise [rad]. phase, phase_std : likewise, from −π to π [rad].
    about : position at which the phase is that [rad].
    significance : probability that chance alone shows as much at some period that was tried.
    aliases : other periods [rad] that explain the slips as well, because these lie too evenly to tell.
    """

    amplitude: float
    amplitude_std: float
    period: float
    period_std: float
    phase: float
    phase_std: float
    about: float
    significance: float
    aliases: tuple[float, ...]

    def at(self, position: FloatArray) -> FloatArray:
        """Its part of the friction [N·m] at positions [rad], of any shape."""
        return np.asarray(self.amplitude * np.sin(2.0 * math.pi * (position - self.about) / self.period + self.phase))

    def columns(self, position: FloatArray) -> FloatArray:
        """Slopes of it by its cosine's and its sine's part, and by its frequency [1/rad], shape (n, 3)."""
        waves = _waves(position - self.about, np.array([1.0 / self.period]))[:, :, 0]
        slope = self.amplitude * np.cos(2.0 * math.pi * (position - self.about) / self.period + self.phase)
        return np.column_stack([waves.T, 2.0 * math.pi * (position - self.about) * slope])


def find_ripple(
    known: FloatArray, values: FloatArray, position: FloatArray, standard_error: float = 0.0
) -> Ripple | None:
    """The sine over position that explains values best beside known columns; None if no period can be tried.

    Parameters
    ----------
    known : columns of what else is fitted, shape (n, p); values : [N·m], position : [rad], shape (n,), in order of
        time. standard_error : that each value has at least [N·m].
    """
    count, size = known.shape
    extent = float(np.ptp(position))
    spacing = spacing_of(position)
    if count < size + 5 or not 0.0 < spacing < extent / 4.0:
        return None
    about = float(position.mean())
    search = _Search(known, values, position - about)
    lowest, highest = _PERIODS_SEEN / extent, 0.5 / spacing
    step = 1.0 / (_PER_PEAK * extent)
    highest = min(highest, lowest + _MOST_TRIED * step)
    tried = np.arange(lowest, highest + step, step)
    powers = search.power(tried)
    if np.argmax(powers) == 0 or not powers.max() > 0.0:
        # None, or less than a period: how long it is cannot be said.
        return None
    frequency, _ = search.narrowed(float(tried[np.argmax(powers)]), step)
    fit, ripple = _fitted(known, values, position, about, frequency, standard_error)
    # Few residuals show less autocorrelation than there is: the sine has to be significant with and without it.
    power = min(
        _prewhitened_power(known, values, position - about, frequency, autocorrelation, standard_error)
        for autocorrelation in (0.0, fit.autocorrelation)
    )
    independent = count * (1.0 - fit.autocorrelation) / (1.0 + fit.autocorrelation)
    return Ripple(
        **ripple,
        about=about,
        significance=false_alarm(power, highest, position, count - size),
        aliases=search.aliases(frequency, highest, step, independent),
    )


def spacing_of(position: FloatArray) -> float:
    """Usual distance between slips [rad]: from one to the next, or all in a row, whichever is the shorter."""
    apart = np.abs(np.diff(position))
    apart = apart[apart > 0]
    return min(float(np.median(apart)), float(np.ptp(position)) / (len(position) - 1)) if len(apart) else 0.0


def false_alarm(power: float, highest: float, position: FloatArray, freedom: float) -> float:
    """Probability that noise has a peak of such a power somewhere below a frequency, an upper bound (Baluev).

    Parameters
    ----------
    power : share of the squares that a sine explains. highest : frequency [1/rad].
    position : [rad], shape (n,). freedom : observations less what is known otherwise.
    """
    left = freedom - 2.0
    if left < 1.0:
        return 1.0
    rest = max(1.0 - power, TINY)
    width = highest * math.sqrt(4.0 * math.pi) * float(position.std())
    factor = math.sqrt(2.0 / freedom) * math.exp(math.lgamma(0.5 * freedom) - math.lgamma(0.5 * (freedom - 1.0)))
    upcrossings = factor * width * rest ** (0.5 * (left - 1.0)) * math.sqrt(0.5 * freedom * power)
    # Exact where it matters: 1 − (1 − single) exp(−upcrossings).
    single = min(rest ** (0.5 * left), 1.0 - 1e-16)
    return min(max(-math.expm1(math.log1p(-single) - upcrossings), 0.0), 1.0)


def _waves(position: FloatArray, frequencies: FloatArray) -> FloatArray:
    """Cosine and sine, shape (2, n, frequencies)."""
    angles = 2.0 * math.pi * position[:, None] * frequencies
    return np.stack([np.cos(angles), np.sin(angles)])


def _prewhitened_power(
    known: FloatArray,
    values: FloatArray,
    position: FloatArray,
    frequency: float,
    autocorrelation: float,
    standard_error: float,
) -> float:
    """Share of the squares that a sine explains of what is new from value to value."""
    waves = _waves(position, np.array([frequency]))[:, :, 0].T
    squares = []
    for columns in (known, np.column_stack([known, waves])):
        basis = np.linalg.qr(prewhitened(columns, autocorrelation))[0]
        left = prewhitened(values, autocorrelation)
        left = left - basis @ (basis.T @ left)
        squares.append(float(left @ left))
    # The sine is worth no more than it is beside the errors that the values have anyway.
    explained = max(squares[0] - squares[1], 0.0)
    rest = max(squares[1], len(values) * standard_error**2)
    return explained / max(explained + rest, TINY)


class _Search:
    """The squares that sines explain beside what is known otherwise."""

    def __init__(self, known: FloatArray, values: FloatArray, position: FloatArray) -> None:
        self._basis = np.linalg.qr(known)[0]
        self._left = values - self._basis @ (self._basis.T @ values)
        self._position = position
        self.total = max(float(self._left @ self._left), TINY)

    def power(self, frequencies: FloatArray) -> FloatArray:
        """Share of the squares that a sine explains, 0 where the positions do not show one of that frequency."""
        blocks = range(0, len(frequencies), _BLOCK)
        return np.concatenate([self._power(frequencies[first : first + _BLOCK]) for first in blocks])

    def _power(self, frequencies: FloatArray) -> FloatArray:
        cosine, sine = _waves(self._position, frequencies)
        cosine, sine = (wave - self._basis @ (self._basis.T @ wave) for wave in (cosine, sine))
        cc, ss, cs = (cosine**2).sum(axis=0), (sine**2).sum(axis=0), (cosine * sine).sum(axis=0)
        c, s = self._left @ cosine, self._left @ sine
        determinant, trace = cc * ss - cs**2, cc + ss
        # Where positions repeat every period, or every half one, a sine of any size would do.
        seen = (trace > _LEAST_SEEN * len(self._position)) & (determinant > _LEAST_ROUND * (0.5 * trace) ** 2)
        explained = (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / np.where(seen, determinant, 1.0)
        return np.where(seen, np.clip(explained / self.total, 0.0, 1.0), 0.0)

    def narrowed(self, frequency: float, step: float) -> tuple[float, float]:
        """The peak next to a frequency tried, and its power."""
        for _ in range(_NARROWED):
            near = frequency + step * np.linspace(-1.0, 1.0, 21)
            powers = self.power(near)
            frequency, power = float(near[np.argmax(powers)]), float(powers.max())
            step *= 0.1
        return frequency, power

    def aliases(self, frequency: float, highest: float, step: float, observations: float) -> tuple[float, ...]:
        """Periods of other peaks that explain as much, the best first, and of equal ones the longest."""
        number = min(int(_SHORTER * highest / step), _MOST_TRIED)
        tried: FloatArray = np.asarray(step * np.arange(1, number), dtype=np.float64)
        powers = self.power(tried)
        best = self.narrowed(frequency, step)[1]
        inner = powers[1:-1]
        peaks = 1 + np.flatnonzero((inner > 0.7 * best) & (inner >= powers[:-2]) & (inner >= powers[2:]))
        found = []
        for peak in peaks:
            other, power = self.narrowed(float(tried[peak]), step)
            worse = observations * math.log(max(1.0 - power, 1e-12) / max(1.0 - best, 1e-12))
            if worse < _EQUALLY_LIKELY and abs(other - frequency) > _PER_PEAK * step:
                found.append((worse, 1.0 / other))
        # Those that explain just as much, but for rounding, in the order of their length.
        found.sort(key=lambda one: (round(one[0], _DIGITS), -one[1]))
        return tuple(period for _, period in found[:_MOST_ALIASES])


def _fitted(
    known: FloatArray, values: FloatArray, position: FloatArray, about: float, frequency: float, standard_error: float
) -> tuple[Regression, dict[str, float]]:
    """The fit of a sine of about that frequency; amplitude, period and phase with their errors."""
    waves = _waves(position - about, np.array([frequency]))[:, :, 0]
    size = known.shape[1]
    cosine, sine = regression(np.column_stack([known, waves.T]), values).coefficients[size:]
    slope = 2.0 * math.pi * (position - about) * (sine * waves[0] - cosine * waves[1])
    # With the frequency among the unknowns, for what it leaves uncertain of the others.
    fit = regression(np.column_stack([known, waves.T, slope]), values, standard_error)
    amplitude = math.hypot(cosine, sine)
    covariance = fit.covariance[size:, size:]
    along = np.array([cosine, sine, 0.0]) / max(amplitude, TINY)
    across = np.array([sine, -cosine, 0.0]) / max(amplitude, TINY)
    return fit, {
        "amplitude": amplitude,
        "amplitude_std": math.sqrt(max(float(along @ covariance @ along), 0.0)),
        "period": 1.0 / frequency,
        "period_std": math.sqrt(max(float(covariance[2, 2]), 0.0)) / frequency**2,
        "phase": math.atan2(cosine, sine),
        "phase_std": math.sqrt(max(float(across @ covariance @ across), 0.0)) / max(amplitude, TINY),
    }
