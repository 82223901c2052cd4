# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""One joint, from samples to findings; live and recorded data take this same path."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stickslip_ros.model.bounds import LARGEST
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.margin import stability_margin
from stickslip_ros.monitoring.advice.adviser import CachingAdviser
from stickslip_ros.monitoring.advice.limits import Criterion, ObservedLoop
from stickslip_ros.monitoring.assessment import Adviser, Assessment, MarginPrediction, MonitorOptions
from stickslip_ros.monitoring.detection import _judgement_kernel as judgement
from stickslip_ros.monitoring.detection import _motion_kernel as kernel
from stickslip_ros.monitoring.detection import status as reasons
from stickslip_ros.monitoring.detection.cycles import Cycle, CycleDetector
from stickslip_ros.monitoring.detection.motion import Swing
from stickslip_ros.monitoring.detection.rests import Rest, RestDetector
from stickslip_ros.monitoring.detection.reversals import ReversalMeter, ReversalRecord
from stickslip_ros.monitoring.detection.segments import STATUS_OF, Segments
from stickslip_ros.monitoring.detection.status import Finding, Reason, Segment, Status
from stickslip_ros.monitoring.friction.learner import FrictionLearner, LearnerMemory
from stickslip_ros.monitoring.friction.presliding import PreslidingMeter
from stickslip_ros.monitoring.friction.slip_windows import slip_window
from stickslip_ros.monitoring.ring import RingMeter
from stickslip_ros.monitoring.samples import Batch, FloatArray, SampleBuffer, SampleFilter

_RECENT_CYCLES = 5  # latest cycles that are kept, 1
_ANOTHER_SPEED = 4.0  # ratio of two speeds of the reference, 1: a larger one begins a new train
_STILL_STICKING = 2.0  # time since the last breakaway, mean periods
_RECENT = 1.0  # span of the largest errors, s
_NOW = 0.1  # span of the present velocity, s
_REMEMBERED = 50.0  # age of a slip that is still learnt from, s
_LONGEST_PART = 8.0  # span of samples followed at once, s: shorter than what the buffer holds beyond it
_SEGMENTS_KEPT = 10_000  # segments that are kept, 1
# Reasons that the two numbers of the kernel explain, by its code.
_REASONS: dict[int, Callable[[float, float], Reason]] = {
    judgement.TOO_FEW: lambda *_: reasons.TooFewSamples(),
    judgement.STUCK: lambda duration, travel: reasons.Stuck(duration=duration, travel=travel),
    judgement.STOPS_AND_GOES: lambda *_: reasons.StopsAndGoes(),
    judgement.NOT_FOLLOWING: lambda share, _: reasons.NotFollowing(share=share),
    judgement.TOO_SHORT: lambda moving, needed: reasons.TooShort(moving=moving, needed=needed),
    judgement.STEPS_OF_COUNTS: lambda counts, _: reasons.TooCoarse(counts=counts),
    judgement.FEW_COUNTS: lambda *_: reasons.TooFewCounts(),
    judgement.BURSTS: lambda *_: reasons.StampsInBursts(),
    judgement.FEW_READINGS: lambda rate, needed: reasons.SampledTooSlowly(rate=rate, needed=needed),
    judgement.DIPS: lambda share, _: reasons.SpeedFalls(share=share),
}


@dataclass(frozen=True, kw_only=True)
class JointMemory:
    """What to remember of a joint beyond the end of the process.

    Attributes
    ----------
    cycles : how many were counted; last_cycle : the latest one.
    """

    cycles: int
    last_cycle: Cycle | None
    friction: LearnerMemory


class JointMonitor:
    """Watches one joint, and learns its friction from slips, unless it is configured with another law.

    Learning from a slip takes milliseconds; a study of many, from which learning begins, seconds. Studies are
    made as soon as they are due if ``studies_at_once``, else by :meth:`learn`, or elsewhere with the means of
    ``learner``; what is learnt is the same.

    Parameters
    ----------
    joint : inertia and friction, or None if unknown: the motion is judged all the same.
    gains : the controller's, or None if unknown.
    options : defaults to MonitorOptions().
    adviser : answers questions for advice, or returns None as long as it is at work; by default it answers at once.
    segments_kept : the latest ones; None for all, 0 where nobody asks for the past.
    at_arrest : whether cycles are told as soon as they end, where that is certain: arrest and slip distance are then
        known less precisely than once the joint has left again. Which cycles there are is the same.
    """

    def __init__(
        self,
        joint: Joint | None = None,
        gains: Gains | None = None,
        options: MonitorOptions | None = None,
        adviser: Adviser | None = None,
        *,
        studies_at_once: bool = False,
        segments_kept: int | None = _SEGMENTS_KEPT,
        at_arrest: bool = False,
    ) -> None:
        self.options = options or MonitorOptions()
        self._joint = joint
        self._gains = gains
        self._studies_at_once, self._at_arrest = studies_at_once, at_arrest
        self.learner = FrictionLearner(joint, self.options.memory)
        self._gains_since = -math.inf
        self._prediction = MarginPrediction(adviser or CachingAdviser())
        self._filter = SampleFilter()
        self.cycle_count = 0
        self._last_cycle: Cycle | None = None
        self._segments = Segments(segments_kept)
        self._keeps_the_past = segments_kept != 0
        self._slices = np.zeros(len(STATUS_OF), dtype=int)  # of each code, ever
        self._latest_status = Status.UNKNOWN
        self._reversals = ReversalMeter()
        self._presliding = PreslidingMeter()
        self._ring = RingMeter()
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
        self._rests = RestDetector(self.options.least_motion)
        self._motion = self._rests.motion
        self._cycles = CycleDetector()
        self._samples = SampleBuffer()
        self._reversals.break_off()
        self._presliding.break_off()
        self._latest_status = Status.UNKNOWN
        self._noted_until = -math.inf  # breakaway of the last cycle counted
        self._recent: deque[Cycle] = deque(maxlen=_RECENT_CYCLES)

    def restart(self) -> None:
        """Follow the motion anew, as if it began with the next sample; what was learnt is kept."""
        self._begin()
        self._filter = SampleFilter()

    def reset(self) -> None:
        """Forget everything that was learnt from the motion."""
        self.restart()
        self.cycle_count = 0
        self._last_cycle = None
        self._segments.all.clear()
        self._slices[:] = 0
        self._reversals.forget()
        self._presliding.forget()
        self._ring = RingMeter()
        self.learner.reset()

    def memory(self) -> JointMemory:
        """What to remember beyond the end of the process."""
        return JointMemory(cycles=self.cycle_count, last_cycle=self._last_cycle, friction=self.learner.memory_of())

    def restore(self, memory: JointMemory) -> bool:
        """Go on from what was known once; returns whether the friction is of use, the joint configured being the same.

        The motion seen then is another story, so that it has no say in what is found now.
        """
        self.cycle_count, self._last_cycle = memory.cycles, memory.last_cycle
        return self.learner.restore(memory.friction)

    @property
    def latest_status(self) -> Status:
        """What the last slice of time showed; unlike :meth:`finding` it costs nothing, and is up to 0.1 s older."""
        return self._latest_status

    @property
    def change_token(self) -> tuple[object, ...]:
        """Objects, one of which is another whenever there is something new to tell but for numbers that run on."""
        return (
            self._latest_status, self.cycle_count, self._joint, self._gains, self.options, self.learner.estimate,
            self.learner.change,
        )  # fmt: skip

    @property
    def segments(self) -> Sequence[Segment]:
        """The past as stretches of one status each, oldest first."""
        return self._segments.all

    def why_not_judged(self) -> Reason | None:
        """For most of the time that was not judged, why; None where too little was seen to say it."""
        codes = (
            judgement.STOPS_AND_GOES, judgement.STEPS_OF_COUNTS, judgement.REVERSING, judgement.FEW_COUNTS,
            judgement.FEW_READINGS, judgement.TOO_SHORT, judgement.BURSTS,
        )  # fmt: skip
        code = max(codes, key=self._slices.__getitem__)
        if self._slices[code] == 0:
            return None
        if code == judgement.TOO_SHORT:
            needed = self._needed_motion()
            stretches = (one.end - one.start for one in self._segments.all if one.status is STATUS_OF[code])
            # Longer ones hold stops that are too short to be stretches of their own.
            longest = max((length for length in stretches if length < needed), default=None)
            return None if longest is None else self._found(code, longest, needed).reason
        if code == judgement.FEW_READINGS:
            return self._found(code, self._sample_rate(), judgement.LEAST_READINGS / self.options.least_motion).reason
        return self._found(code, math.nan, math.nan).reason

    @property
    def last_time(self) -> float:
        """Stamp of the last sample used [s]; -inf before any."""
        return self._filter.last_time

    @property
    def band(self) -> float:
        """The smallest motion told from rest [rad]."""
        return self._motion.band

    @property
    def resolution(self) -> float:
        """Of the position [rad]."""
        return self._motion.resolution

    def recent(self, duration: float) -> Batch | None:
        """The samples of the last seconds, at most a minute; None if there are none."""
        return self._samples.between(self._motion.last_time - duration, self._motion.last_time)

    def process(self, batch: Batch) -> list[Cycle]:
        """Take samples and return the cycles that they complete, oldest first; how they are batched is no matter."""
        cycles: list[Cycle] = []
        batch = self._filter.blank(batch)
        if self._motion.goes_on(batch, largest=LARGEST):
            self._filter.pass_on(batch)
            for short in _short_parts(batch):
                cycles += self._follow(short)
            return cycles
        for restart, piece in self._filter.split(batch):
            if restart and math.isfinite(self._motion.last_time):
                cycles += self.finish()
                self._begin()
            for short in _short_parts(piece):
                cycles += self._follow(short)
        return cycles

    def finish(self) -> list[Cycle]:
        """Return the cycle that ended in the present rest: call when no more samples come."""
        cycles = self._settle(self._cycles.finish(self._rests.unfinished_rest()))
        self._motion.close_slice()
        self._take_slices()
        self._reversals.finish(self._motion.last_time, self._samples)
        self.learner.finish()
        if self._studies_at_once:
            self.learner.study_now()
        return cycles

    def _follow(self, batch: Batch) -> list[Cycle]:
        cycles: list[Cycle] = []
        self._samples.add(batch)
        self._note_needed_motion()
        for event in self._motion.follow(batch):
            if isinstance(event, Swing):
                cycles += self._settle(self._cycles.add_swing(event))
                continue
            for rest in self._rests.rests_at(event):
                cycles += self._add_rest(rest)
        self._take_slices()
        for turned in self._motion.turns():
            self._reversals.turn(turned, self._samples)
        if self._motion.last_time >= self._reversals.due:
            self._reversals.poll(self._motion.last_time, self._samples)
        if self._motion.silent is not None:
            # What lies in a silence was not seen: what follows is followed anew.
            unseen = batch.where(slice(self._motion.silent, None))
            cycles += self.finish()
            self._begin()
            cycles += self._follow(unseen)
        return cycles

    def _add_rest(self, rest: Rest) -> list[Cycle]:
        """Take a rest, complete or begun, and return the cycles that are to be told now."""
        if not rest.complete:
            early = self._cycles.detect_at_arrest(rest)
            if early is None:
                return []
            self._take_slices()
            self._note([early])
            return [early] if self._at_arrest else []
        if not rest.coarse:
            self._reversals.add_rest(rest, self._samples)
            self._ring.add_rest(rest, self._samples)
            self._learn_presliding(rest)
        cycles = self._cycles.add_rest(rest)
        if rest.coarse and self._cycles.last_rest is not None and self._cycles.last_rest.breakaway == rest.breakaway:
            # What was taken for slips while it crept says nothing of the time after it.
            slips = [cycle for cycle in self._recent if not rest.arrest < cycle.breakaway < rest.breakaway]
            self._recent = deque(slips, maxlen=_RECENT_CYCLES)
        return self._settle(cycles)

    def _settle(self, cycles: list[Cycle]) -> list[Cycle]:
        """Learn from the cycles of a rest that is known in full; returns those that are to be told now."""
        new = [cycle for cycle in cycles if cycle.breakaway > self._noted_until]
        if cycles:
            # What was closed before was judged by what was known before.
            self._take_slices()
        for cycle in cycles:
            self._learn_from(cycle)
        self._note(new)
        return new if self._at_arrest else cycles

    def _note(self, cycles: list[Cycle]) -> None:
        """Let the judgement know the cycles found, and what follows from them."""
        self._noted_until = max([self._noted_until, *(cycle.breakaway for cycle in cycles)])
        for cycle in cycles:
            if self._recent and not _follows(cycle, self._recent[-1]):
                self._recent.clear()
            if self._recent and self._keeps_the_past:
                # One slip may be chance. From the second one on, what lay between two slips was stick-slip.
                first = len(self._recent) == 1
                self._segments.relabel(
                    cycle.breakaway if first else self._recent[-1].arrest, cycle.arrest, cycle.breakaway - cycle.dwell
                )
            self._recent.append(cycle)
        self.cycle_count += len(cycles)
        self._last_cycle = cycles[-1] if cycles else self._last_cycle
        self._motion.note(self._cycles.record(self._recent))
        self._motion.await_rest(awaited=self._cycles.may_detect_at_arrest)
        self._note_needed_motion()

    def _learn_presliding(self, rest: Rest) -> None:
        """Let a rest say how the contact gives way, if the gains were what they are throughout."""
        if self.options.learn and self._gains_since <= rest.arrest:
            self._presliding.add_rest(rest, self._samples, self._gains, self._motion.resolution)

    def _learn_from(self, cycle: Cycle) -> None:
        """Let the learner see one slip, if gains and reference were what they are throughout."""
        rest_begin = cycle.breakaway - cycle.dwell
        if self._joint is not None and not self._joint.friction.of_the_paper:
            return
        if not self.options.learn or cycle.hunting or self._gains_since > rest_begin or not self.learner.wants(cycle):
            return
        now = self._motion.last_time
        begin = cycle.breakaway - min(cycle.dwell, max(2.0 * cycle.slip_duration, 1.0))
        samples = self._samples.between(max(begin, now - _REMEMBERED), min(cycle.arrest + cycle.dwell, now))
        if samples is not None and math.isnan(cycle.reference_speed):
            samples = Batch(
                time=samples.time, position=samples.position, velocity=samples.velocity, effort=samples.effort
            )
        if samples is not None:
            window = slip_window(
                samples, cycle, self._gains, resolution=self._motion.resolution, noise=self._motion.noise
            )
            if window is not None:
                self.learner.memory = self.options.memory
                self.learner.add_slip(window)
                if self._studies_at_once:
                    self.learner.study_now()

    def _take_slices(self) -> None:
        """Turn the slices of time closed since the last call into segments of one status each."""
        rows = self._motion.closed()
        if not len(rows):
            return
        if not self._keeps_the_past:
            rows = rows[-1:]
        codes = rows[:, kernel.CODE].astype(int)
        moves = np.flatnonzero(codes == judgement.MOVES)
        if len(moves):
            reserves, _ = self._damping_reserves(rows[moves, kernel.VELOCITY])
            codes[moves[reserves < self.options.warn_margin]] = judgement.DIPS
        self._latest_status = STATUS_OF[int(codes[-1])]
        if self._keeps_the_past:
            self._slices += np.bincount(codes, minlength=len(self._slices))
            self._segments.extend(rows, codes)

    def finding(self) -> Finding:
        """What the motion shows at the last sample."""
        if not math.isfinite(self._motion.last_time):
            return Finding(status=Status.UNKNOWN, reason=reasons.NoSamples(left_out=tuple(self._filter.dropped)))
        self._note_needed_motion()
        code, first, second = self._motion.judge()
        return self._found(code, first, second)

    def _found(self, code: int, first: float, second: float) -> Finding:
        """What a code of the kernel's means, with the two numbers that explain it."""
        status = STATUS_OF[code]
        reason = _REASONS[code](first, second) if code in _REASONS else None
        if code == judgement.STICKS and any(cycle.hunting for cycle in self._recent):
            reason = reasons.Hunting()
        elif code == judgement.REVERSING:
            reason = reasons.Reversing(record=self._reversal_record)
        elif code == judgement.MOVES:
            velocity, _ = self.velocity()
            reserves, condition = self._damping_reserves(np.array([velocity]))
            reserve = float(reserves[0])
            if reserve < self.options.warn_margin:
                status = Status.AT_RISK
                reason = reasons.ThinReserve(reserve=reserve, exactly=condition is Criterion.EXACT)
        return Finding(status=status, reason=reason)

    @property
    def _reversal_record(self) -> ReversalRecord | None:
        """What reversals do to the joint; None where that was not measured, or by a reference that only repeats it."""
        return None if self._motion.reference_follows else self._reversals.record

    def _needed_motion(self) -> float:
        """How long motion without a rest must last before it is called smooth [s]."""
        needed = self.options.least_motion
        if self._recent:
            needed = max(needed, judgement.PERIODS_TO_TRUST * self._motion.period)
        elif self.joint is not None and self.gains is not None and self.gains.stiffness > 0:
            natural_period = 2.0 * math.pi * math.sqrt(float(self.joint.inertia) / float(self.gains.stiffness))
            needed = max(needed, judgement.PERIODS_TO_TRUST * natural_period)
        return needed

    def _note_needed_motion(self) -> None:
        """Let the judgement know how long motion must last, and over which window a speed is measured."""
        self._motion.require(motion=self._needed_motion(), window=self.options.least_motion)

    def damping_reserve(self, velocity: float) -> float:
        """Relative damping reserve ρ/ρ_c − 1 at a velocity [rad/s] by integration, to two per cent of ρ.

        NaN if unknown, and with integral action or sampled control, which take longer than there is time in passing.
        """
        self._select_model()
        selected = self._prediction.selected
        conditions = self.options.conditions
        if selected is None or self._prediction.exact_reserves(selected, conditions).beyond_the_paper:
            return math.nan
        reserves, _ = self._prediction.damping_reserves(np.array([velocity]), Criterion.EXACT, conditions)
        return float(reserves[0])

    def _damping_reserves(self, velocities: FloatArray) -> tuple[FloatArray, Criterion]:
        self._select_model()
        return self._prediction.damping_reserves(velocities, self.options.limits.condition, self.options.conditions)

    def velocity(self) -> tuple[float, str]:
        """Commanded velocity and where it comes from: "reference", "mean motion" or "" (then NaN) [rad/s]."""
        window = self.options.least_motion
        reference = self._motion.reference_velocity(window)
        uncommanded = reference == 0.0 and len(self._recent) > 0 and math.isnan(self._recent[-1].reference_speed)
        if math.isfinite(reference) and not uncommanded:
            return reference, "reference"
        way = sum(cycle.slip_distance for cycle in self._recent)
        duration = sum(cycle.period for cycle in self._recent)
        # In a dwell the joint rests for longer than the window; that is not to be told to stand still.
        since = self._motion.last_time - self._noted_until
        if self._motion.judge()[0] == judgement.STICKS or since * len(self._recent) < _STILL_STICKING * duration:
            return way / duration, "mean motion"
        mean = self._motion.mean_velocity(window)
        return mean, "mean motion" if math.isfinite(mean) else ""

    def _select_model(self) -> None:
        self._prediction.follow(
            self.learner.estimate, self._joint, self._gains, velocity_loop=self._filter.velocity_alone
        )

    def _sample_rate(self) -> float:
        return 1.0 / self._motion.sample_interval if self._motion.sample_interval > 0 else math.nan

    def assessment(self, velocity: float | None = None) -> Assessment:
        """Everything known of the joint now; margin and advice at the present velocity or at one given [rad/s]."""
        velocity, source = self.velocity() if velocity is None else (velocity, "given")
        advice, trial_margin = None, None
        tracking_error, velocity_error = self._motion.errors(_RECENT)
        self._select_model()
        selected = self._prediction.selected
        margin, reason = self._prediction.margin(velocity)
        if selected is None and self.learner.estimate is None and self.learner.studied_in_vain:
            reason += f": {self.learner.studied_in_vain} slips were studied in vain"
        std = probability = math.nan
        if margin is not None and selected is not None:
            position_noise, velocity_noise = self._motion.measurement_noise()
            loop = ObservedLoop(
                conditions=self.options.conditions,
                sample_rate=self._sample_rate(),
                crossover=selected.crossover,
                tracking_error=tracking_error,
                velocity_error=velocity_error,
                position_noise=position_noise,
                velocity_noise=velocity_noise,
                ring=math.nan if self._ring.estimate is None else self._ring.estimate.frequency,
            )
            advice = self._prediction.advise(selected, velocity, self.options.limits, loop)
            std, probability = self._prediction.uncertainty(velocity)
            if self.options.trial is not None and selected.gains_known:
                trial_margin = stability_margin(selected.joint, self.options.trial, velocity)
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
            rests_on=selected.rests_on if selected else "",
            uncertainty=selected.uncertainty if selected else None,
            joint=selected.joint if selected else None,
            margin_gains=selected.gains if selected else None,
            per_inertia=selected is not None and selected.per_inertia,
            position=self._motion.position,
            mean_velocity=self._motion.mean_velocity(_NOW),
            estimate=self.learner.estimate,
            change=self.learner.change,
            advice=advice,
            variant=self.options.variant,
            trial=self.options.trial,
            trial_margin=trial_margin,
            tracking_error=tracking_error,
            velocity_error=velocity_error,
            cycles=self.cycle_count,
            last_cycle=self._last_cycle,
            resolution=self._motion.resolution,
            noise=self._motion.noise,
            sample_rate=self._sample_rate(),
            dropped=dict(self._filter.dropped),
            blanked=dict(self._filter.blanked),
            constant_effort=self._filter.constant_effort,
            reference_follows=self._motion.reference_follows,
            restarts=self._filter.restarts,
            reversals=self._reversal_record,
            presliding=self._presliding.estimate,
            ring=self._ring.estimate,
        )


def _follows(cycle: Cycle, last: Cycle) -> bool:
    """Whether a cycle belongs to the same train as the last one: at about its speed, and at most one between unseen."""
    # Of a stand that the reference did not draw on, it is not known either what it was.
    unseen = cycle.breakaway - (cycle.dwell if cycle.driven else 0.0) - last.arrest
    speeds = [abs(one.reference_speed) for one in (cycle, last)]
    if not all(speed > 0.0 for speed in speeds):  # NaN included
        speeds = [one.mean_speed for one in (cycle, last)]
    similar = max(speeds) < _ANOTHER_SPEED * min(speeds)
    return unseen <= min(cycle.period, last.period) and similar


def _short_parts(batch: Batch) -> Iterator[Batch]:
    """The samples in parts of bounded duration, as long as the buffer of samples needs them."""
    if batch.time[-1] - batch.time[0] <= _LONGEST_PART:
        yield batch
        return
    parts = np.floor((batch.time - batch.time[0]) / _LONGEST_PART)
    for begin, end in pairwise([0, *(np.flatnonzero(np.diff(parts)) + 1).tolist(), len(batch)]):
        yield batch.where(slice(begin, end))
