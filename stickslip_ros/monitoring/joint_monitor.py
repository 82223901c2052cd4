# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint, from samples to findings; live and recorded data take this same path."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import numpy as np

from stickslip_ros.model.controlled import HUNTING
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import StabilityMargin, stability_margin
from stickslip_ros.monitoring.advice_limits import Circumstances, Condition
from stickslip_ros.monitoring.adviser import Advice, AdviceQuestion, Adviser, CachingAdviser
from stickslip_ros.monitoring.assessment import Assessment, MonitorOptions
from stickslip_ros.monitoring.belief import Belief, believed, much_the_same, uncertainty_of
from stickslip_ros.monitoring.detection import Cycle, CycleDetector
from stickslip_ros.monitoring.estimation import FrictionEstimate
from stickslip_ros.monitoring.friction_learner import FrictionLearner
from stickslip_ros.monitoring.motion import MotionRecord
from stickslip_ros.monitoring.samples import Batch, SampleBuffer, SampleFilter
from stickslip_ros.monitoring.slip_windows import slip_window
from stickslip_ros.monitoring.status import Finding, Segment, Status

_PERIODS_TO_TRUST = 2.0  # motion must last so many cycle or natural periods before it is called smooth
_PERIODS_AT_REST = 4.0  # a dwell may last so many periods before the joint is called at rest
_CYCLES_FOR_STICK_SLIP = 2
_LEAST_KNOTS = 20
_RECENT_CYCLES = 5
_DIP_AT_RISK = 0.2  # of the mean speed
_SILENCE = 2.0  # [s] without a sample, from which on the motion before is another story
_RECENT = 1.0  # [s] over which the largest errors are taken
_NOW = 0.1  # [s] over which the present velocity is taken
_SLICE = 0.05  # [s] how finely findings are dated within a batch


class JointMonitor:
    """Watches one joint, and learns its friction from slips.

    Learning from a slip takes milliseconds; a study of many, from which learning begins, seconds. Studies are
    made by :meth:`learn`, or elsewhere with the means of ``learner``.

    Parameters
    ----------
    joint : inertia and friction, or None if unknown: the motion is judged all the same.
    gains : the controller's, or None if unknown.
    options : defaults to MonitorOptions().
    adviser : answers questions for advice, or returns None as long as it is at work; by default it answers at once.
    """

    def __init__(
        self,
        joint: Joint | None = None,
        gains: Gains | None = None,
        options: MonitorOptions | None = None,
        adviser: Adviser | None = None,
    ) -> None:
        self.options = options or MonitorOptions()
        self._joint = joint
        self._gains = gains
        self.learner = FrictionLearner(joint, self.options.memory)
        self._gains_since = -math.inf
        self._belief: Belief | None = None
        self._disbelief = ""
        self._basis: tuple[FrictionEstimate | None, Joint | None, Gains | None] | None = None
        self._filter = SampleFilter()
        self._adviser = adviser or CachingAdviser()
        self._advice: Advice | None = None
        self.cycle_count = 0
        self.segments: deque[Segment] = deque(maxlen=10_000)
        self._begin()

    @property
    def joint(self) -> Joint | None:
        """Inertia and friction as configured."""
        return self._joint

    @joint.setter
    def joint(self, joint: Joint | None) -> None:
        if joint != self._joint:
            self._joint = self.learner.configured = joint

    @property
    def gains(self) -> Gains | None:
        """The controller's gains; a change takes effect with the next sample."""
        return self._gains

    @gains.setter
    def gains(self, gains: Gains | None) -> None:
        if gains != self._gains:
            self._gains = gains
            self._gains_since = self._filter.last_time

    def learn(self) -> None:
        """Study the slips seen, if that is due: up to seconds."""
        self.learner.study_now()

    def _begin(self) -> None:
        """Forget the motion seen so far, not what is known of the joint."""
        self._detector = CycleDetector()
        self._samples = SampleBuffer()
        self._motion = MotionRecord()
        self._recent: deque[Cycle] = deque(maxlen=_RECENT_CYCLES)
        self._open_rest: float | None = None
        self._rested_at = -math.inf

    def reset(self) -> None:
        """Forget everything that was learnt from the motion."""
        self._begin()
        self._filter = SampleFilter()
        self.cycle_count = 0
        self.segments.clear()
        self.learner.reset()

    @property
    def last_time(self) -> float:
        """Stamp of the last sample used [s]; -inf before any."""
        return self._filter.last_time

    @property
    def resolution(self) -> float:
        """Of the position [rad]."""
        return self._detector.detector.resolution

    def recent(self, duration: float) -> Batch | None:
        """The samples of the last seconds, at most a minute; None if there are none."""
        return self._samples.between(self._motion.last_time - duration, self._motion.last_time)

    def process(self, batch: Batch) -> list[Cycle]:
        """Take samples and return the cycles that they complete, oldest first."""
        cycles: list[Cycle] = []
        for restart, piece in self._filter.split(batch):
            for number, part in enumerate(_without_silences(piece)):
                begins = number > 0 or restart or part.time[0] - self._motion.last_time > _SILENCE
                if begins and math.isfinite(self._motion.last_time):
                    cycles += self.finish()
                    self._begin()
                cycles += self._follow(part)
        return cycles

    def finish(self) -> list[Cycle]:
        """Return the cycle that ended in the present rest: call when no more samples come."""
        cycles = self._detector.finish()
        self._recent.extend(cycles)
        self.cycle_count += len(cycles)
        return cycles

    def _follow(self, batch: Batch) -> list[Cycle]:
        """Feed the detector in slices that do not depend on how the samples were batched."""
        cycles: list[Cycle] = []
        slices = np.floor(batch.time / _SLICE)
        for indices in np.split(np.arange(len(batch)), np.flatnonzero(np.diff(slices)) + 1):
            part = batch.where(slice(int(indices[0]), int(indices[-1]) + 1))
            travels = self._motion.take(part)
            self._samples.add(part)
            found = self._detector.feed(part.time, part.position, part.velocity, travels, part.effort)
            for cycle in found:
                self._learn_from(cycle)
            self._recent.extend(found)
            self.cycle_count += len(found)
            cycles += found
            self._motion.follow_direction(self._detector.detector)
            self._open_rest = self._detector.detector.open_rest()
            if self._open_rest is not None:
                self._rested_at = self._motion.last_time
            self._extend_segments(part)
        return cycles

    def _learn_from(self, cycle: Cycle) -> None:
        """Let the learner see one slip, if gains and reference were what they are throughout."""
        rest_begin = cycle.breakaway - cycle.dwell
        if not self.options.learn or cycle.hunting or self._gains_since > rest_begin:
            return
        samples = self._samples.between(
            cycle.breakaway - min(cycle.dwell, max(2.0 * cycle.slip_duration, 1.0)), cycle.arrest + cycle.dwell
        )
        detector = self._detector.detector
        if samples is not None:
            window = slip_window(samples, cycle, self._gains, resolution=detector.resolution, noise=detector.noise)
            if window is not None:
                self.learner.memory = self.options.memory
                self.learner.take(window)

    def _extend_segments(self, batch: Batch) -> None:
        status = self.finding().status
        start, end = float(batch.time[0]), float(batch.time[-1])
        if self.segments and self.segments[-1].status is status and start - self.segments[-1].end < _SILENCE:
            last = self.segments.pop()
            way = last.velocity * (last.end - last.start) + self._motion.last_way
            start = last.start
        else:
            way = self._motion.last_way
        velocity = way / (end - start) if end > start else 0.0
        self.segments.append(Segment(start=start, end=end, status=status, velocity=velocity))

    def finding(self) -> Finding:
        """What the motion shows at the last sample."""
        detector, now = self._detector.detector, self._motion.last_time
        if not math.isfinite(now):
            missing = "; ".join(self._filter.dropped) or "no samples yet"
            return Finding(status=Status.UNKNOWN, reason=missing)
        if not detector.ready:
            return Finding(status=Status.NOT_JUDGED, reason="too few samples")
        if self._sticks(now):
            return Finding(status=Status.STICK_SLIP, reason=HUNTING if self._recent[-1].hunting else "")
        rest_since = self._open_rest
        if rest_since is not None or detector.knots <= 1:
            return self._at_rest(rest_since if rest_since is not None else self._motion.first_time, now)
        moving_for = now - max(self._motion.turned, self._motion_began())
        needed = self._needed_motion()
        if moving_for < needed or detector.knots < _LEAST_KNOTS:
            if self._motion.turned > self._motion_began():
                return Finding(status=Status.NOT_JUDGED, reason="reversing")
            return Finding(status=Status.NOT_JUDGED, reason=f"too short a motion: {moving_for:.2f} s of {needed:.2f} s")
        return self._smooth(needed)

    def _sticks(self, now: float) -> bool:
        """Whether stick-slip cycles go on."""
        if len(self._recent) < _CYCLES_FOR_STICK_SLIP:
            return False
        # The median, because a long smooth stretch between two rests makes a long cycle too.
        period = float(np.median([cycle.period for cycle in self._recent]))
        # A cycle becomes known only when the next one begins; until then the last breakaway speaks.
        since = max(self._recent[-1].arrest, self._last_breakaway())
        patience = _PERIODS_TO_TRUST if self._open_rest is None else _PERIODS_AT_REST
        return now - since <= patience * period

    def _at_rest(self, since: float, now: float) -> Finding:
        travel = self._motion.reference_travel_since(since)
        if travel > 10.0 * self._detector.detector.band:
            return Finding(
                status=Status.AT_REST,
                reason=f"stuck for {now - since:.1f} s while the reference moved by {travel:.3g} rad",
            )
        return Finding(status=Status.AT_REST)

    def _last_breakaway(self) -> float:
        last_rest = self._detector.last_rest
        return last_rest.breakaway if last_rest else self._motion.first_time

    def _motion_began(self) -> float:
        # A rest is known in full only some time after its end.
        return max(self._last_breakaway(), self._rested_at)

    def _needed_motion(self) -> float:
        """How long motion without a rest must last before it is called smooth [s]."""
        needed = self.options.least_motion
        if self._recent:
            needed = max(needed, _PERIODS_TO_TRUST * float(np.median([cycle.period for cycle in self._recent])))
        elif self.joint is not None and self.gains is not None and self.gains.stiffness > 0:
            natural_period = 2.0 * math.pi * math.sqrt(float(self.joint.inertia) / float(self.gains.stiffness))
            needed = max(needed, _PERIODS_TO_TRUST * natural_period)
        return needed

    def _smooth(self, window: float) -> Finding:
        # The start from rest is no dip.
        since = max(self._motion.last_time - window, self._motion_began() + 0.25 * window)
        dip = self._detector.detector.slowest_share(since)
        if dip < _DIP_AT_RISK:
            return Finding(status=Status.AT_RISK, reason=f"the speed falls to {100 * dip:.0f} % of its mean")
        reserve, source = self._damping_reserve()
        if reserve < self.options.warn_margin:
            return Finding(status=Status.AT_RISK, reason=f"damping reserve {100 * reserve:.0f} % {source}")
        return Finding(status=Status.SMOOTH)

    def _damping_reserve(self) -> tuple[float, str]:
        """Relative damping reserve ρ/ρ_c − 1 by the condition chosen, and which it is; infinite if it is not known."""
        if self.options.limits.condition is Condition.EXACT:
            # Worked out with the advice, if at all: an integration is too long for every batch of samples.
            known = self._advice is not None and math.isfinite(self._advice.recommendation.reserve)
            return (self._advice.recommendation.reserve if known and self._advice else math.inf), "exactly"
        margin, _, _ = self._margin()
        if margin is None or not margin.applicable:
            return math.inf, ""
        critical = float(margin.critical_damping_ratio)
        return (float(margin.damping_ratio) / critical - 1.0 if critical > 0 else math.inf), "by Eq. (43)"

    def velocity(self) -> tuple[float, str]:
        """Commanded velocity and where it comes from: "reference", "mean motion" or "" (then NaN) [rad/s]."""
        window = self.options.least_motion
        reference = self._motion.reference_velocity(window)
        if math.isfinite(reference):
            return reference, "reference"
        if self._sticks(self._motion.last_time):
            cycles = list(self._recent)
            way = sum(cycle.slip_distance for cycle in cycles)
            return way / sum(cycle.period for cycle in cycles), "mean motion"
        mean = self._motion.mean_velocity(window)
        return mean, "mean motion" if math.isfinite(mean) else ""

    def _believe(self) -> tuple[Belief | None, str]:
        """What to compute with: the same as before until something has changed that matters."""
        basis = (self.learner.estimate, self._joint, self._gains)
        if self._basis is not None and all(one is other for one, other in zip(self._basis, basis, strict=True)):
            return self._belief, self._disbelief
        belief, self._disbelief = believed(*basis)
        if belief is None or self._belief is None or not much_the_same(belief, self._belief):
            self._belief = belief
        self._basis = basis
        return self._belief, self._disbelief

    def _margin(self) -> tuple[StabilityMargin | None, str, Belief | None]:
        belief, reason = self._believe()
        if belief is None:
            return None, reason, None
        velocity, source = self.velocity()
        if not source:
            return None, "the commanded velocity is not known", belief
        margin = stability_margin(belief.joint, belief.gains, velocity)
        return margin, str(margin.reason or ""), belief

    def _advise(self, belief: Belief, velocity: float, tracking_error: float, velocity_error: float) -> Advice | None:
        """Advice on the joint as it is believed to be."""
        question = AdviceQuestion(
            joint=belief.joint,
            gains=belief.gains,
            velocity=abs(velocity),
            limits=self.options.limits,
            uncertainty=belief.uncertainty,
            circumstances=Circumstances(
                conditions=self.options.conditions,
                sample_rate=self._sample_rate(),
                tracking_error=tracking_error,
                velocity_error=velocity_error,
            ),
            gains_known=belief.gains_known,
        )
        self._advice = self._adviser(question)
        return self._advice

    def _sample_rate(self) -> float:
        return 1.0 / self._motion.sample_interval if self._motion.sample_interval > 0 else math.nan

    def assessment(self) -> Assessment:
        """Everything known of the joint now."""
        velocity, source = self.velocity()
        advice, trial_margin = None, None
        tracking_error, velocity_error = self._motion.errors(_RECENT)
        margin, reason, belief = self._margin()
        std = probability = math.nan
        if margin is not None and belief is not None:
            advice = self._advise(belief, velocity, tracking_error, velocity_error)
            std, probability = uncertainty_of(margin, belief, velocity)
            if self.options.trial is not None and belief.gains_known:
                trial_margin = stability_margin(belief.joint, self.options.trial, velocity)
        detector = self._detector.detector
        return Assessment(
            finding=self.finding(),
            time=self._motion.last_time if math.isfinite(self._motion.last_time) else math.nan,
            velocity=velocity,
            velocity_source=source,
            gains=self.gains,
            margin=margin,
            margin_reason=reason,
            margin_std=std,
            stick_slip_probability=probability,
            rests_on=belief.rests_on if belief else "",
            joint=belief.joint if belief else None,
            margin_gains=belief.gains if belief else None,
            per_inertia=belief is not None and not belief.gains_known,
            position=self._motion.position,
            mean_velocity=self._motion.mean_velocity(_NOW),
            estimate=self.learner.estimate,
            notice=self.learner.notice,
            advice=advice,
            variant=self.options.variant,
            trial=self.options.trial,
            trial_margin=trial_margin,
            tracking_error=tracking_error,
            velocity_error=velocity_error,
            cycles=self.cycle_count,
            last_cycle=self._recent[-1] if self._recent else None,
            resolution=detector.resolution,
            noise=detector.noise,
            sample_rate=self._sample_rate(),
            dropped=dict(self._filter.dropped),
        )


def _without_silences(batch: Batch) -> list[Batch]:
    """The samples cut at long silences, after each of which the motion is followed anew."""
    cuts = np.flatnonzero(np.diff(batch.time) > _SILENCE) + 1
    edges = [0, *cuts.tolist(), len(batch)]
    return [batch.where(slice(begin, end)) for begin, end in pairwise(edges)]
