# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether motions between rests are slips of a spring that is drawn on steadily, told without the reference.

A person, a planner and a pick-and-place program stop and go as well. But the slips of one joint under one controller
are pieces of one damped cosine: whatever their distance, their middle halves last equally long. And since the spring
is wound up at one speed, dwell and slip together last as long as the distance takes at that speed. Motions that are
commanded one by one have neither, or they have both without the scatter of friction, and are told by their number.

The evidence is the logarithm of the ratio of two likelihoods, added up from motion to motion (Wald's sequential test,
in the cumulative form of Page): that of slips of one natural frequency at one speed, and that of separate motions. The
widths are in logarithms, so that no constant carries a unit; `docs/detection.md` has the figures that they rest on.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median

from stickslip_ros.monitoring.detection.slip_shape import SlipShape

ENOUGH = 14.0  # evidence, nats: one motion in a million taken by chance; see the receiver operating curve
_MOST = 1.5 * ENOUGH  # evidence, nats: at most, so that what was certain can be given up
_GIVEN_UP = 0.5 * ENOUGH  # evidence with which a train is given up, nats
_LOOKED_BACK = 15  # latest motions of a train, 1
_ODD_ONES = 0.15  # real slips that do not fit, of all: two in one, or an impulse
# Standard deviations of the logarithms about their median, among slips and among separate motions.
_DURATION, _DURATION_APART = 0.3, 1.1
_SPEED, _SPEED_APART = 0.45, 1.8
_ONE_WAY, _ONE_WAY_APART = 0.95, 0.55
_LEAST = -3.0  # evidence of a motion in a train, nats: with less it is none of the train's slips
_LARGEST_ASYMMETRY = 1.45  # of most slips of a train; what follows a step of its reference is front-loaded
_SCATTER_RATIO = 0.8  # speeds of slips scatter less than their distances: a larger one has a longer dwell
_LEAST_SCATTER = 0.09  # scatter of the logarithms of speeds in this comparison, 1: at least
_READINGS = 3.0  # scatter that a count makes, counts of a slip
_ENOUGH_FOR_SCATTER = 4  # motions that a scatter is estimated from, 1: at least


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A motion between two rests.

    Attributes
    ----------
    distance : signed [rad]; period : with the dwell before it [s].
    shape : its course; bands : its distance in bands, the smallest motion that is told from rest.
    """

    distance: float
    period: float
    shape: SlipShape
    bands: float

    @property
    def log_speed(self) -> float:
        """Logarithm of the mean speed, rest included."""
        return math.log(abs(self.distance) / self.period)


class SpringEvidence:
    """See the module.

    Attributes
    ----------
    total : the logarithm of the likelihood ratio for the present train.
    certain : whether its motions are slips.
    """

    def __init__(self) -> None:
        self.total = 0.0
        self.certain = False
        self._train: deque[Motion] = deque(maxlen=_LOOKED_BACK)

    def fits(self, motion: Motion) -> bool:
        """Whether a motion would be another slip of a train of which it is certain."""
        return self.certain and self._evidence(motion) > _LEAST

    def add_motion(self, motion: Motion) -> bool:
        """Take the next motion; returns whether the train goes on, else it begins with this one."""
        evidence = self._evidence(motion)
        self.total = min(self.total + evidence, _MOST)
        goes_on = bool(self._train) and self.total > 0.0 and not self._scatters([*self._train, motion])
        if not goes_on:
            self.restart()
        self._train.append(motion)
        if self.total < _GIVEN_UP or self._is_front_loaded() or self._is_straight():
            self.certain = False
        elif self.total >= ENOUGH:
            self.certain = True
        return goes_on

    def restart(self) -> None:
        """Forget the train."""
        self.total, self.certain = 0.0, False
        self._train.clear()

    def _evidence(self, motion: Motion) -> float:
        """Logarithm of the likelihood ratio of one motion, given those before it."""
        if not self._train:
            return 0.0
        one_way = motion.distance * self._train[-1].distance > 0
        if not (one_way or self.certain):
            # Slips at a steady speed go one way.
            return -math.inf
        known = [math.log(one.shape.middle_half) for one in self._train if one.shape.middle_half > 0]
        duration = motion.shape.middle_half
        deviation = math.log(duration) - median(known) if duration > 0 and known else math.inf
        evidence = _fit(deviation, _DURATION, _DURATION_APART, len(known))
        # The first dwell of a train may have begun long before it mattered.
        speeds = [one.log_speed for one in self._train][1 if len(self._train) > 1 else 0 :]
        evidence += _fit(motion.log_speed - median(speeds), _SPEED, _SPEED_APART, len(self._train))
        share, share_apart = (_ONE_WAY, _ONE_WAY_APART) if one_way else (1 - _ONE_WAY, 1 - _ONE_WAY_APART)
        return evidence + math.log(share / share_apart)

    def _scatters(self, train: list[Motion]) -> bool:
        """Whether speeds scatter as distances do: nothing ties these to the periods, as when each motion is set off."""
        train = train[-_LOOKED_BACK:]
        if len(train) < _ENOUGH_FOR_SCATTER:
            return False
        speeds = _scatter([one.log_speed for one in train[1:]])
        distances = _scatter([math.log(abs(one.distance)) for one in train])
        readings = 1.0 / median(one.bands for one in train)
        return speeds > math.hypot(_LEAST_SCATTER, _READINGS * readings, _SCATTER_RATIO * distances)

    def _is_front_loaded(self) -> bool:
        known = [one.shape.asymmetry for one in self._train if math.isfinite(one.shape.asymmetry)]
        return bool(known) and median(known) > _LARGEST_ASYMMETRY

    def _is_straight(self) -> bool:
        return 2 * sum(one.shape.straight for one in self._train) > len(self._train)


def _scatter(logarithms: list[float]) -> float:
    """Standard deviation by the differences from one to the next: a change of speed now and then is no scatter."""
    return math.sqrt(0.5 * fmean((one - other) ** 2 for one, other in pairwise(logarithms)))


def _fit(deviation: float, width: float, width_apart: float, count: int) -> float:
    """Logarithm of the likelihood ratio of a deviation from the median of so many."""
    if not math.isfinite(deviation):
        return math.log(_ODD_ONES)
    # What few have is known no better than that.
    width *= math.sqrt(1.0 + 1.0 / count)
    exponent = -0.5 * deviation**2 * (width**-2 - width_apart**-2)
    return math.log((1.0 - _ODD_ONES) * width_apart / width * math.exp(exponent) + _ODD_ONES)
