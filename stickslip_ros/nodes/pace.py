# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""When the node ticks, and when it publishes: often while messages come or work is under way, rarely else."""

from __future__ import annotations

import math
from time import monotonic

_PUBLISH_REST = 2.5  # time between publications, mean durations of one: intake has most of the processor
_SMOOTHING = 0.1  # weight of the last duration in the mean duration, 1: one long tick delays no joint
_LONGEST_TICK, SHORTEST_TICK = 0.04, 0.02  # period of ticks, s: 25 Hz suffice, and 50 Hz while gains change
_IDLE_TICK = 0.5  # period of ticks while nothing comes, s: the first message ends it at once
_EARLY = 0.5 * SHORTEST_TICK  # a publication that is due before the middle of the next period is made now
_IDLE_AFTER = 2.0  # time without a message and without work under way, s: a shorter pause of a publisher is usual
_IDLE_PERIOD = 1.0  # time between two statuses of an idle node, s: nothing changes meanwhile, and each costs time


class Pace:
    """Times of ticks and publications; times are steady [s].

    Parameters
    ----------
    rate : rate of publications while messages come [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / rate
        self._publish_at = -math.inf
        self._busy_at, self._came = monotonic(), 0
        self._spent = 0.0  # mean duration of a tick that publishes [s]

    @property
    def idle(self) -> bool:
        """Whether no message has come for a while, and no work is under way."""
        return monotonic() - self._busy_at > _IDLE_AFTER

    @property
    def publish_period(self) -> float:
        """Time between two publications [s]."""
        return max(self._period, _IDLE_PERIOD) if self.idle else self._period

    def is_due(self, now: float, came: int, *, busy: bool) -> bool:
        """Whether a publication is due, with so many messages until now, and work under way or not.

        The status that ends a silence is published at once, however far the next one was away.
        """
        due = now >= self._publish_at - _EARLY
        if came != self._came or busy:
            if self.idle:
                due, self._publish_at = True, now
            self._busy_at, self._came = now, came
        return due

    def published(self, now: float) -> None:
        """Set the time of the next publication, after that of a tick that began at ``now``.

        However many joints there are, intake has most of the time. One long tick delays no later status.
        """
        self._spent += _SMOOTHING * (monotonic() - now - self._spent)
        self._publish_at = max(self._publish_at + self.publish_period, now + _PUBLISH_REST * self._spent)

    def next_tick(self, *, hurry: bool) -> float:
        """Time until the next tick [s].

        A tick costs about as much for few messages as for many, so that there is one tick for each status, and several
        where statuses are rare. There are more ticks while gains change, and few while the node is idle.
        """
        if self.idle:
            return _IDLE_TICK
        if hurry:
            return SHORTEST_TICK
        return max(self._period / math.ceil(self._period / _LONGEST_TICK - 1e-6), SHORTEST_TICK)
