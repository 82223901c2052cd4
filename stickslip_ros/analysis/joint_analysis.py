# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint of a recording: followed sample by sample as the node does, and judged as a whole at the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip_ros.analysis import judgement
from stickslip_ros.analysis.judgement import NOT_JUDGED, SEVERITY, Transient
from stickslip_ros.analysis.sample_checks import SampleChecks, data_problems
from stickslip_ros.analysis.traces import JointTraces
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import Assessment, ExactQuestion, as_seen
from stickslip_ros.monitoring.detection._judgement_kernel import DIP_AGAIN
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.detection.status import Finding, NoSamples, Reason, Segment, SpeedFalls, Status, Stuck
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, FloatArray, ReferencePairing
from stickslip_ros.output.wording import reason_text
from stickslip_ros.settings.parameter_file import Parameters
from stickslip_ros.settings.parameters import JointSettings

OTHERWISE = "it moves too little, or reverses too often"


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
    traces: JointTraces | None
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
        self._traces = JointTraces() if with_traces else None

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
        status, worst = judgement.overall_status(segments), judgement.worst_status(segments)
        stuck, why = judgement.stuck(segments), self.monitor.why_not_judged()
        if stuck is not None and stuck.duration > judgement.time_in(segments, Status.NOT_JUDGED):
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
