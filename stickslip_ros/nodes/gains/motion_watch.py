# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The motion of a joint while its gains change: its status, and objections to going on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.closed_loop_health import ClosedLoopHealth, health_of, swing_of, what_got_worse
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.nodes.watched_joints import WatchedJoint

WATCH = 1.0  # span of motion that is judged, s: gains that were in force for so long without objection are good
_SILENCE = 1.0  # time without a sample, s: a joint that is silent for longer cannot be watched
_LEAST_BASELINE, _LONGEST_BASELINE = 2.0, 20.0  # span of the motion before the ramp, s: enough for a mean; still recent
_CYCLES = 2.0  # number of stick-slip cycles in that span, 1: their largest errors are then in it
_BAND = 5.0  # bandwidth of the joint's own motion, natural frequencies: faster motion is noise
_SWINGS = 2.0  # number of natural periods, 1: an unstable joint swings to and fro within them
_LONGEST_SWINGS = 5.0  # limit of their duration, s: instability has to be noticed soon


class MotionWatch:
    """Motion of a watched joint.

    Parameters
    ----------
    watched : the joint. clock : a steady time [s].
    """

    def __init__(self, watched: WatchedJoint, clock: Callable[[], float]) -> None:
        self._watched, self._monitor, self._clock = watched, watched.monitor, clock
        self._before: ClosedLoopHealth | None = None
        self._seen: tuple[float, float, float] | None = None  # inputs of the last objection
        self._objection = ""
        self._band = self._swings = math.nan

    def assessment(self) -> Assessment:
        """Present assessment of the joint."""
        return self._monitor.assessment()

    @property
    def status(self) -> Status:
        """Present status."""
        return self._monitor.finding().status

    @property
    def cycles(self) -> int:
        """Number of cycles so far."""
        return self._monitor.cycle_count

    def begin(self, begin: Gains, target: Gains) -> str:
        """Measure the present motion, as the reference of later motion; returns why it cannot be measured, or ""."""
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
        """Sentence that no samples come any more, "" if they do."""
        if self._clock() - self._watched.heard > _SILENCE:
            return f"the joint has not been heard for {_SILENCE:g} s"
        return ""

    def objection(self, softer: float) -> str:
        """Why the gains should not be changed further, silence included, or "".

        Parameters
        ----------
        softer : stiffness before the ramp over the present one.
        """
        if silent := self.silence():
            return silent
        # This is called once more right before each write, seldom with a new sample.
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
