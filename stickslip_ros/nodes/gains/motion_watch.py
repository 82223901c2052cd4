# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether a joint's motion speaks against going on while its gains are changed, and how it moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.closed_loop_health import ClosedLoopHealth, health_of, swing_of, what_got_worse
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.joints.watched_joints import WatchedJoint

WATCH = 1.0  # [s] of motion that is looked at; gains that were in force so long ago are good
_SILENCE = 1.0  # [s] without a sample, from which on there is no watching
_LEAST_BASELINE = 2.0  # [s]
_LONGEST_BASELINE = 20.0
_CYCLES = 2.0  # of stick slip that the baseline has to cover
_BAND = 5.0  # times the natural frequency, up to which the motion is the joint's own
_SWINGS = 2.0  # natural periods in which an unstable joint is seen to go to and fro
_LONGEST_SWINGS = 5.0  # [s]


class Watch(Protocol):
    """The joint's motion, as :class:`MotionWatch` sees it."""

    @property
    def status(self) -> Status:
        """Of now."""

    @property
    def cycles(self) -> int:
        """Counted so far."""

    def assessment(self) -> Assessment:
        """What is known of the joint now."""

    def begin(self, begin: Gains, target: Gains) -> str:
        """Take the motion of now as the measure of that to come; returns why that cannot be, or ""."""

    def silence(self) -> str:
        """That the joint is not heard any more, or ""."""

    def objection(self, softer: float) -> str:
        """Why the gains should not be changed further, silence among it, or ""."""


class MotionWatch:
    """See the module.

    Parameters
    ----------
    watched : the joint. clock : a steady time [s].
    """

    def __init__(self, watched: WatchedJoint, clock: Callable[[], float]) -> None:
        self._watched, self._monitor, self._clock = watched, watched.monitor, clock
        self._before: ClosedLoopHealth | None = None
        self._seen: tuple[float, float, float] | None = None  # what was asked of last, and the answer
        self._objection = ""
        self._band = self._swings = math.nan

    def assessment(self) -> Assessment:
        """What is known of the joint now."""
        return self._monitor.assessment()

    @property
    def status(self) -> Status:
        """Of now."""
        return self._monitor.finding().status

    @property
    def cycles(self) -> int:
        """Counted so far."""
        return self._monitor.cycle_count

    def begin(self, begin: Gains, target: Gains) -> str:
        """Take the motion of now as the measure of that to come; returns why that cannot be, or ""."""
        assessment = self._monitor.assessment()
        stiffnesses = [float(gains.stiffness) for gains in (begin, target)]
        inertia = float(assessment.joint.inertia) if assessment.joint is not None else math.nan
        slowest, fastest = (math.sqrt(k / inertia) / (2.0 * math.pi) for k in (min(stiffnesses), max(stiffnesses)))
        self._band = _BAND * fastest
        self._swings = min(max(WATCH, _SWINGS / slowest), _LONGEST_SWINGS) if slowest > 0.0 else WATCH
        cycle = assessment.last_cycle
        longest = _CYCLES * cycle.period if cycle is not None else 0.0
        self._seen = None
        self._before = self._health(min(max(_LEAST_BASELINE, self._swings, longest), _LONGEST_BASELINE))
        return "" if self._before is not None else "there are no samples of the joint to watch it by"

    def silence(self) -> str:
        """That the joint is not heard any more, or ""."""
        if self._clock() - self._watched.heard > _SILENCE:
            return f"the joint has not been heard for {_SILENCE:g} s"
        return ""

    def objection(self, softer: float) -> str:
        """Why the gains should not be changed further, silence among it, or "".

        Parameters
        ----------
        softer : stiffness before over that of now.
        """
        if silent := self.silence():
            return silent
        # It is asked once more right before each write, when there seldom is a new sample.
        seen = (self._monitor.last_time, softer, self._watched.settings.options.limits.effort)
        if seen != self._seen:
            self._seen, self._objection = seen, self._what_got_worse(softer, effort_limit=seen[2])
        return self._objection

    def _what_got_worse(self, softer: float, effort_limit: float) -> str:
        recent = self._health(WATCH)
        if self._before is None or recent is None:
            return ""
        resolution = self._monitor.resolution
        return what_got_worse(self._before, recent, softer=softer, resolution=resolution, effort_limit=effort_limit)

    def _health(self, duration: float) -> ClosedLoopHealth | None:
        recent = self._monitor.recent(duration)
        swinging = self._monitor.recent(max(duration, self._swings))
        if recent is None or swinging is None:
            return None
        return replace(health_of(recent, self._band), swing=swing_of(swinging, self._monitor.resolution))
