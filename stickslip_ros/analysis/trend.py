# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Values with standard errors, and the trend of a joint's over the dates of its recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DAY = 86_400.0  # [s]
MONTH = 365.25 / 12.0 * DAY  # [s]
YEAR_2001 = 978_307_200.0  # [s] stamps before it are no dates
_LEAST_RECORDINGS = 3
_LEAST_DAYS = 3.0
_SURE = 0.975  # of Student's t: 95 % on both sides
BEYOND_CHANCE = 1.96  # standard errors: 95 % of what chance makes


@dataclass(frozen=True)
class Measured:
    """A value with its standard error; NaN where it is not known. ``exact``: it was set, and has none."""

    value: float = math.nan
    error: float = math.nan
    exact: bool = False


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A straight line through values over dates.

    Attributes
    ----------
    a_month : change a month, in the quantity's unit. error : its standard error.
    relative : change a month as a share of the line's value at the first date; NaN if that is not above zero.
    significant : whether the change is beyond 95 % of what chance makes of as many recordings.
    """

    a_month: float
    error: float
    relative: float
    significant: bool


def trend(times: Sequence[float], values: Sequence[float], errors: Sequence[float]) -> Trend | None:
    """The line by weighted least squares; None if there are too few recordings, or too few days, for one.

    Where every value has a standard error the weights are 1/error², else all are the same. The line's own error is by
    the scatter about it, and no smaller than the values' errors make it.

    Parameters
    ----------
    times : dates [s]. values, errors : each of shape (n,); an error is NaN or 0 where none is known.
    """
    # Imported late: it is half of the imports of `stickslip analyze`, and few recordings have a trend.
    from scipy.special import stdtrit

    at = np.asarray(times, dtype=float)
    y, std = np.asarray(values, dtype=float), np.asarray(errors, dtype=float)
    if len(at) < _LEAST_RECORDINGS or float(np.ptp(at)) < _LEAST_DAYS * DAY:
        return None
    known = bool(np.all(np.isfinite(std) & (std > 0.0)))
    weights = 1.0 / std**2 if known else np.ones(len(at))
    months = (at - at[0]) / MONTH
    middle = float(np.average(months, weights=weights))
    spread = float(np.sum(weights * (months - middle) ** 2))
    slope = float(np.sum(weights * (months - middle) * y)) / spread
    mean = float(np.average(y, weights=weights))
    left = y - mean - slope * (months - middle)
    scatter = float(np.sum(weights * left**2)) / (len(at) - 2)
    error = math.sqrt((max(1.0, scatter) if known else scatter) / spread)
    first = mean - slope * middle
    return Trend(
        a_month=slope,
        error=error,
        relative=slope / first if first > 0.0 else math.nan,
        significant=abs(slope) > float(stdtrit(len(at) - 2, _SURE)) * error,
    )
