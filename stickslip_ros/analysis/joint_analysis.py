# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint of a recording: followed sample by sample as the node does, and judged as a whole at the end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.analysis import judgement
from stickslip_ros.analysis.judgement import NOT_JUDGED, SEVERITY, Transient
from stickslip_ros.analysis.sample_checks import SampleChecks, data_problems
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment, ExactQuestion, as_seen
from stickslip_ros.monitoring.detection._judgement_kernel import DIP_AGAIN
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import (
    Finding,
    NoSamples,
    Reason,
    Segment,
    SpeedFalls,
    Status,
    Stuck,
    TooShort,
)
from stickslip_ros.monitoring.friction.sliding import sliding_points
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, FloatArray, ReferencePairing
from stickslip_ros.output.wording import reason_text
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameters import JointSettings

OTHERWISE = "it moves too little, or reverses too often"
_BUCKETS = 2000  # of an outline, up to twice as many while it is made
_CYCLES_KEPT = 5
_CYCLES_SHOWN, _AFTER = 3.0, 1.0  # periods before and after the end of the one that is drawn
_MOST_SAMPLES = 3000  # of a close-up
_MOST_POINTS = 4000  # of speed and friction
_POINTS_FROM = 20.0  # [s] of samples that are looked at at once for them


@dataclass(frozen=True, kw_only=True)
class JointAnalysis:
    """What a recording shows of one joint.

    Attributes
    ----------
    samples : how many were used. start, end : stamps of the first and the last one, or of the earliest and the latest
        where stamps go backwards [s].
    problems : what is wrong with the data, a sentence each.
    status : what held for most of the time; worst : the most severe that occurred; `judgement.py` defines both.
    reason : of the status, "" where it says it all. stuck : for how long it stood while its reference went on, or None.
    segments : stretches of one status; cycles : all that were found.
    transient : what the stick-slip was, if it died out after starting; None if not.
    velocity : at which margin and advice are worked out [rad/s], the usual one of the worst status; NaN if the joint
        did not move.
    assessment : what is known at the end. exact : verdict by integration; where friction is known to
        vary with place or load it is that of the worst place, and exact_here that of the last position; else None.
    settings : what was given of the joint. traces : for drawing, None unless asked for.
    """

    name: str
    samples: int
    start: float
    end: float
    status: Status
    worst: Status
    reason: str
    segments: tuple[Segment, ...]
    cycles: tuple[Cycle, ...]
    transient: Transient | None
    velocity: float
    assessment: Assessment
    exact: ExactVerdict
    settings: JointSettings
    traces: _JointTraces | None
    problems: tuple[str, ...] = ()
    exact_here: ExactVerdict | None = None
    stuck: Stuck | None = None

    @property
    def duration(self) -> float:
        """From the first sample to the last, or the time that was followed where stamps go backwards [s]; NaN without
        any.
        """
        if self.assessment.restarts:
            return sum(segment.end - segment.start for segment in self.segments)
        return self.end - self.start

    @property
    def usual_slip(self) -> float:
        """Median slip distance [rad]; NaN without cycles."""
        slips = sorted(abs(cycle.slip_distance) for cycle in self.cycles)
        return slips[len(slips) // 2] if slips else math.nan

    @property
    def reserve(self) -> float:
        """Relative damping reserve ρ/ρ_c − 1 by integration; NaN if unknown, ∞ where no damping is needed."""
        return self.exact.damping_reserve

    def time_in(self, status: Status) -> float:
        """How long the joint was in a status [s]."""
        return judgement.time_in(self.segments, status)

    @property
    def moving_time(self) -> float:
        """How long the joint moved or stuck [s]."""
        return judgement.moving_time(self.segments)

    @property
    def caveat(self) -> tuple[Reason | None, float]:
        """Why most of the time that bears on the whole was not judged, and how long that was so [s]."""
        return judgement.caveat(self.segments)

    @property
    def stick_slip_share(self) -> float:
        """Share of the moving time in stick-slip, 0 to 1; NaN if the joint did not move."""
        return judgement.stick_slip_share(self.segments)


class JointAnalyzer:
    """One joint while its recording is read."""

    def __init__(self, name: str, parameters: Parameters, *, with_traces: bool, at_once: int) -> None:
        self.name = name
        self._at_once = at_once
        self.settings = parameters.settings_of(name)
        self.monitor = JointMonitor(
            self.settings.joint, self.settings.gains, self.settings.options,
            studies_at_once=True, segments_kept=None, at_arrest=True,  # as the node has it
        )  # fmt: skip
        self.cycles: list[Cycle] = []
        self._pairing = ReferencePairing()
        self._checks = SampleChecks()
        self._samples = 0
        self._start = math.nan
        self._traces = _JointTraces() if with_traces else None

    def process(self, samples: FloatArray | None, references: FloatArray | None) -> list[Cycle]:
        """Take samples and references; returns the cycles found meanwhile."""
        if references is not None:
            self._pairing.add_references(references)
        if samples is not None:
            self._pairing.add_samples(samples, self.settings.effort_scale)
        # Many samples at once cost less; what is found does not depend on it.
        return self._process(self._pairing.next_batch()) if self._pairing.waiting >= self._at_once else []

    def change_gains(self, gains: Gains) -> list[Cycle]:
        """From now on these gains are in force, in the controller's units; returns the cycles found meanwhile."""
        found = self._process(self._pairing.next_batch())
        self.monitor.gains = self.settings.to_si(gains)
        return found

    def finish(self) -> list[Cycle]:
        """No more samples come; returns the cycles that they complete."""
        found = self._process(self._pairing.next_batch(all_of_them=True))
        closing = self.monitor.finish()
        if self._traces is not None and closing:
            self._traces.add(None, closing, self.monitor)
        self.cycles += closing
        return found + closing

    def _process(self, batch: Batch | None) -> list[Cycle]:
        if batch is None:
            return []
        usable = batch.usable()
        if math.isnan(self._start) and len(usable):
            self._start = float(usable.time[0])
        self._samples += len(batch)
        self._checks.add(usable)
        found = self.monitor.process(batch)
        if self._traces is not None:
            self._traces.add(usable, found, self.monitor)
        self.cycles += found
        return found

    def analysis(self) -> JointAnalysis:
        """What has been found, after the last samples."""
        segments = tuple(self.monitor.segments)
        band = self.monitor.band
        status, worst = judgement.overall_status(segments, band), judgement.worst_status(segments, band)
        stuck, why = judgement.stuck(segments, band), self.monitor.why_not_judged()
        not_judged = judgement.time_in(segments, Status.NOT_JUDGED)
        caveat, unsettled = judgement.caveat(segments)
        if unsettled > 0.5 * not_judged:
            why = caveat
        if stuck is not None and stuck.duration > not_judged:
            why = stuck
        # Advice is for where it is wanted: at the speed at which it went worst.
        velocity = _judged_velocity(segments, worst, self.cycles)
        assessment = self.monitor.assessment(velocity)
        exact, exact_here = ExactVerdict(smooth=None, reason=assessment.margin_reason), None
        question = ExactQuestion.on(assessment, assessment.margin_gains, self.settings.options.conditions)
        if question is not None:
            exact = as_seen(question.verdict(), worst)
            if assessment.here is not None:
                exact_here = replace(question, joint=assessment.here, uncertainty=None).verdict()
        problems = (
            *data_problems(assessment, self._samples, self._pairing.offset),
            *self._checks.problems(),
        )
        start, end = self._start, assessment.time
        if assessment.restarts:
            start = min((segment.start for segment in segments), default=end)
            end = max((segment.end for segment in segments), default=end)
        return JointAnalysis(
            name=self.name,
            samples=self._samples - sum(assessment.dropped.values()),
            start=start,
            end=end,
            status=status,
            worst=worst,
            reason=_reason(status, assessment, why, problems),
            stuck=stuck,
            segments=segments,
            cycles=tuple(self.cycles),
            transient=judgement.transient(segments, self.cycles),
            velocity=velocity,
            assessment=assessment,
            exact=exact,
            settings=self.settings,
            traces=self._traces,
            problems=problems,
            exact_here=exact_here,
        )


def _reason(status: Status, assessment: Assessment, usual: Reason | None, problems: Sequence[str]) -> str:
    """Why a recording has its status: as at its end, or as usual where most of it was not judged."""
    finding = assessment.finding
    if (status is Status.NOT_JUDGED and usual is not None) or (status is Status.AT_REST and isinstance(usual, Stuck)):
        finding = Finding(status=status, reason=usual)
    if status is Status.AT_RISK and not isinstance(finding.reason, SpeedFalls):
        # Of a recording only its motion makes that, whatever its end is like.
        finding = Finding(status=status, reason=SpeedFalls(share=DIP_AGAIN, at_most=True))
    applies = status is finding.status and not (problems and isinstance(finding.reason, NoSamples))
    # How long the motion at the end lasted says nothing of the others.
    applies = applies and not (usual is None and isinstance(finding.reason, TooShort))
    texts = [reason_text(finding)] if applies else []
    if status is Status.NOT_JUDGED and not any(texts):
        texts = [OTHERWISE]
    # What is wrong with the data of a joint that was judged is a warning, no reason.
    return "; ".join(filter(None, [*texts, *(problems if status in NOT_JUDGED else ())]))


def _judged_velocity(segments: Sequence[Segment], status: Status, cycles: Sequence[Cycle] = ()) -> float:
    """The speed that the joint usually had in a status [rad/s], or if it has none then in others; NaN if it rested.

    Of stick-slip that of the cycles: a stretch of it may hold several speeds, and turns. It is the reference's where
    one is known: a joint that sticks before it is told to move, or falls behind, has a lower mean speed.
    """
    if status is Status.STICK_SLIP and cycles:
        return sticking_speed(cycles)
    for wanted in dict.fromkeys((status, *SEVERITY[:4])):
        chosen = [segment for segment in segments if segment.status is wanted and segment.velocity != 0.0]
        lengths = [segment.end - segment.start for segment in chosen]
        if sum(lengths) > 0.0:
            return _quantile([abs(segment.velocity) for segment in chosen], lengths, 0.5)
    return math.nan


def sticking_speed(cycles: Sequence[Cycle], share: float = 0.5) -> float:
    """The speed [rad/s] below which this share of the time of stick-slip was spent; of the reference, where known."""
    speeds = [
        cycle.reference_speed if math.isfinite(cycle.reference_speed) and not cycle.hunting else cycle.mean_speed
        for cycle in cycles
    ]
    return _quantile(speeds, [cycle.period for cycle in cycles], share)


def _quantile(values: Sequence[float], weights: Sequence[float], share: float) -> float:
    order = np.argsort(values)
    sums = np.cumsum(np.asarray(weights)[order])
    return float(np.asarray(values)[order][int(np.searchsorted(sums, share * sums[-1]))])


class _Outline:
    """A curve over time by its lowest and highest values in equal steps of time, which grow with its length."""

    def __init__(self) -> None:
        self._step = 0.01  # [s]
        self._begin = math.nan
        self._low = np.zeros(0)
        self._high = np.zeros(0)

    def add(self, time: FloatArray, value: FloatArray) -> None:
        """Continue the curve; stamps before its beginning and unknown values are left out."""
        if math.isnan(self._begin) and len(time):
            self._begin = float(time[0])
        known = np.isfinite(value) & (time >= self._begin)
        time, value = time[known], value[known]
        if not len(time):
            return
        while (time.max() - self._begin) / self._step >= 2 * _BUCKETS:
            self._coarsen()
        buckets = ((time - self._begin) / self._step).astype(int)
        missing = int(buckets.max()) + 1 - len(self._low)
        if missing > 0:
            self._low = np.append(self._low, np.full(missing, np.inf))
            self._high = np.append(self._high, np.full(missing, -np.inf))
        np.minimum.at(self._low, buckets, value)
        np.maximum.at(self._high, buckets, value)

    def _coarsen(self) -> None:
        self._step *= 2.0
        odd = len(self._low) % 2
        low = np.append(self._low, np.full(odd, np.inf))
        high = np.append(self._high, np.full(odd, -np.inf))
        self._low, self._high = low.reshape(-1, 2).min(axis=1), high.reshape(-1, 2).max(axis=1)

    def points(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Middle of each step [s], lowest and highest value there; NaN between steps where there was nothing."""
        time = self._begin + self._step * (0.5 + np.arange(len(self._low)))
        empty = ~np.isfinite(self._low)
        # Steps as short as the samples are apart leave gaps that mean nothing; long ones are silences.
        kept = ~empty | np.append(False, ~empty[:-1])
        low, high = np.where(empty, np.nan, self._low)[kept], np.where(empty, np.nan, self._high)[kept]
        time = time[kept]
        wide = np.diff(time, append=math.inf) > 2.0
        bridged = np.isnan(low) & ~wide
        return time[~bridged], low[~bridged], high[~bridged]


@dataclass(frozen=True)
class _CloseUp:
    """One cycle with the samples around it, as they were recorded."""

    cycle: Cycle
    samples: Batch


class _JointTraces:
    """Position, reference and their difference in outline, a few cycles in full, friction over speed."""

    def __init__(self) -> None:
        self.position = _Outline()
        self.reference = _Outline()
        self.error = _Outline()
        self._close_ups: deque[_CloseUp] = deque(maxlen=_CYCLES_KEPT)
        self._distances: list[float] = []
        self._points: list[FloatArray] = []
        self._waiting: list[Batch] = []

    def add(self, batch: Batch | None, cycles: Sequence[Cycle], monitor: JointMonitor) -> None:
        """Take usable samples, and the cycles that the monitor found in them."""
        if batch is not None:
            self.position.add(batch.time, batch.position)
            self.reference.add(batch.time, batch.reference_position)
            self.error.add(batch.time, batch.position - batch.reference_position)
            self._note_friction(batch, monitor.resolution)
        for cycle in cycles:
            self._distances.append(abs(cycle.slip_distance))
            samples = monitor.recent(monitor.last_time - cycle.arrest + _CYCLES_SHOWN * cycle.period)
            if samples is not None:
                # More than the cycle may have come at once.
                samples = samples.where(samples.time <= cycle.arrest + _AFTER * cycle.period)
            if samples is not None and len(samples) and samples.time[0] <= cycle.breakaway:
                every = max(1, math.ceil(len(samples) / _MOST_SAMPLES))
                self._close_ups.append(_CloseUp(cycle, samples.where(slice(None, None, every))))

    def _note_friction(self, batch: Batch, resolution: float) -> None:
        if not np.isfinite(batch.effort).any():
            return
        self._waiting.append(batch)
        if self._waiting[-1].time[-1] - self._waiting[0].time[0] >= _POINTS_FROM:
            joined, self._waiting = Batch.joined(self._waiting), []
            points = sliding_points(joined, resolution)
            if points is not None:
                self._points.append(points)
                while len(self._points) > 1 and sum(part.shape[1] for part in self._points) > _MOST_POINTS:
                    # Every other point of all, so that the whole recording has its share.
                    self._points = [part[:, ::2] for part in self._points]

    def friction_points(self, resolution: float, inertia: float) -> tuple[FloatArray, FloatArray]:
        """Velocities [rad/s] and efforts less what accelerates an inertia [N·m], in stretches of sliding."""
        points = list(self._points)
        if self._waiting:
            last = sliding_points(Batch.joined(self._waiting), resolution)
            points += [last] if last is not None else []
        if not points:
            return np.zeros(0), np.zeros(0)
        velocity, effort, acceleration = np.concatenate(points, axis=1)
        return velocity, effort - inertia * acceleration

    def close_up(self) -> _CloseUp | None:
        """Of the cycles kept, the one whose slip is the most usual."""
        if not self._close_ups:
            return None
        usual = float(np.median(self._distances))
        return min(self._close_ups, key=lambda one: abs(math.log(abs(one.cycle.slip_distance) / usual)))
