# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a recording shows of its joints: the node's own pipeline, fed from a bag."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stickslip_ros.bags.bag import Bag
from stickslip_ros.bags.reading import BagReader, FloatArray, Piece
from stickslip_ros.bags.topics import TopicChoice, Topics, find_topics
from stickslip_ros.bags.traces import JointTraces
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.joint_settings import JointSettings
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict, exact_verdict
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection import Cycle
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.monitoring.status import Segment, Status
from stickslip_ros.parameter_file import Parameters
from stickslip_ros.recordings import RecordingError

_MOST_JOINTS = 256  # names come from the file; their number is bounded
_AT_ONCE = 8000  # samples of a joint that are followed at once
_TRACED_AT_ONCE = 8.0  # [s]
_BEYOND = 5.0  # [s] after the end asked for, from which on nothing more is read
# What a recording as a whole is called, the first of these that it has for a time.
_WORST_FIRST = (
    Status.STICK_SLIP,
    Status.AT_RISK,
    Status.SMOOTH,
    Status.NOT_JUDGED,
    Status.AT_REST,
    Status.UNKNOWN,
)
_LEAST_TIME = 0.5  # [s] without a break, from which on a status says something of a recording


@dataclass(frozen=True, kw_only=True)
class AnalysisOptions:
    """What to analyse, and how.

    Attributes
    ----------
    topics : named by the user. joints : names; () for every joint.
    start, end : in seconds after the first sample.
    parameters : as the node has them. with_traces : whether to keep what the report draws.
    longest_piece : of a recording, after which a watcher sees the joints [s] of samples.

    Raises
    ------
    InvalidParameterError
        If the end is not after the start.
    """

    topics: TopicChoice = field(default_factory=TopicChoice)
    joints: tuple[str, ...] = ()
    start: float = 0.0
    end: float = math.inf
    parameters: Parameters = field(default_factory=Parameters)
    with_traces: bool = False
    longest_piece: float = math.inf

    def __post_init__(self) -> None:
        if not self.end > max(self.start, 0.0):
            raise InvalidParameterError("end", f"after the start at {self.start:g} s", self.end)


@dataclass(frozen=True, kw_only=True)
class JointAnalysis:
    """What a recording shows of one joint.

    Attributes
    ----------
    samples : how many were used. start, end : stamps of the first and the last one [s].
    status : the worst one that lasted; reason : why, "" where the status says it all.
    segments : stretches of one status; cycles : all that were found.
    velocity : at which margin and advice are worked out [rad/s], NaN if the joint did not move.
    assessment : what is known at the end. exact : verdict by integration.
    settings : what was given of the joint. traces : for drawing, None unless asked for.
    """

    name: str
    samples: int
    start: float
    end: float
    status: Status
    reason: str
    segments: tuple[Segment, ...]
    cycles: tuple[Cycle, ...]
    velocity: float
    assessment: Assessment
    exact: ExactVerdict
    settings: JointSettings
    traces: JointTraces | None

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return self.end - self.start

    @property
    def usual_slip(self) -> float:
        """Median slip distance [rad]; NaN without cycles."""
        slips = sorted(abs(cycle.slip_distance) for cycle in self.cycles)
        return slips[len(slips) // 2] if slips else math.nan

    @property
    def reserve(self) -> float:
        """Relative damping reserve ρ/ρ_c − 1 by Eq. (43); NaN where there is none."""
        margin = self.assessment.margin
        if margin is None or not margin.applicable or not float(margin.critical_damping_ratio) > 0:
            return math.nan
        return float(margin.damping_ratio) / float(margin.critical_damping_ratio) - 1.0

    def time_in(self, status: Status) -> float:
        """How long the joint was in a status [s]."""
        return sum(segment.end - segment.start for segment in self.segments if segment.status is status)


@dataclass(frozen=True, kw_only=True)
class BagAnalysis:
    """What a recording shows.

    Attributes
    ----------
    path : as given. topics : what was read. joints : by name. warnings : what is missing or was left out.
    recorded : when, by the recorder's clock [s]; NaN if it has no samples.
    """

    path: str
    topics: Topics
    joints: dict[str, JointAnalysis]
    warnings: tuple[str, ...]
    recorded: float = math.nan


Progress = Callable[[int, int], None]
# Called after every piece with the monitors by joint, the cycles found in it, and log time less stamp.
Watcher = Callable[["dict[str, FollowedJoint]", "dict[str, list[Cycle]]", float], None]


class FollowedJoint:
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
        self._samples = 0
        self._start = math.nan
        self._traces = JointTraces() if with_traces else None

    def take(self, samples: FloatArray | None, references: FloatArray | None) -> list[Cycle]:
        """Take samples and references; returns the cycles found meanwhile."""
        if references is not None:
            self._pairing.add_references(references)
        if samples is not None:
            rows = samples.copy()
            rows[:, 3] *= self.settings.effort_scale
            self._pairing.add_samples(rows)
        # Many samples at once cost less; what is found does not depend on it.
        return self._follow(self._pairing.take()) if self._pairing.waiting >= self._at_once else []

    def change_gains(self, gains: Gains) -> list[Cycle]:
        """From now on these gains are in force, in the controller's units; returns the cycles found meanwhile."""
        found = self._follow(self._pairing.take())
        self.monitor.gains = self.settings.to_si(gains)
        return found

    def end(self) -> list[Cycle]:
        """No more samples come; returns the cycles that they complete."""
        found = self._follow(self._pairing.take(all_of_them=True))
        closing = self.monitor.finish()
        if self._traces is not None and closing:
            self._traces.add(None, closing, self.monitor)
        self.cycles += closing
        return found + closing

    def _follow(self, batch: Batch | None) -> list[Cycle]:
        if batch is None:
            return []
        finite = np.isfinite(batch.time)
        if math.isnan(self._start) and finite.any():
            self._start = float(batch.time[finite][0])
        self._samples += len(batch)
        found = self.monitor.process(batch)
        if self._traces is not None:
            self._traces.add(batch, found, self.monitor)
        self.cycles += found
        return found

    def analysis(self) -> JointAnalysis:
        """What has been found, after the last samples."""
        segments = tuple(self.monitor.segments)
        status = overall_status(segments)
        velocity = judged_velocity(segments, status, self.cycles)
        assessment = self.monitor.assessment(velocity)
        exact = ExactVerdict(smooth=None, reason=assessment.margin_reason)
        if assessment.joint is not None and assessment.margin_gains is not None and math.isfinite(velocity):
            conditions = self.settings.options.conditions
            exact = exact_verdict(assessment.joint, assessment.margin_gains, velocity, conditions)
        dropped = "; ".join(f"{reason} ({count})" for reason, count in assessment.dropped.items())
        return JointAnalysis(
            name=self.name,
            samples=self._samples - sum(assessment.dropped.values()),
            start=self._start,
            end=assessment.time,
            status=status,
            reason=_reason(status, assessment, dropped),
            segments=segments,
            cycles=tuple(self.cycles),
            velocity=velocity,
            assessment=assessment,
            exact=exact,
            settings=self.settings,
            traces=self._traces,
        )


def _reason(status: Status, assessment: Assessment, dropped: str) -> str:
    if status is assessment.finding.status:
        return assessment.finding.reason
    return dropped if status is Status.UNKNOWN else ""


def overall_status(segments: Sequence[Segment]) -> Status:
    """The worst status that lasted for a time without a break; if none did, the worst that occurred."""
    for least in (_LEAST_TIME, 0.0):
        for status in _WORST_FIRST:
            if any(one.end - one.start > least for one in segments if one.status is status):
                return status
    return segments[-1].status if segments else Status.UNKNOWN


def judged_velocity(segments: Sequence[Segment], status: Status, cycles: Sequence[Cycle] = ()) -> float:
    """The speed that the joint usually had in a status [rad/s], or if it has none then in others; NaN if it rested.

    Of stick slip that of the cycles: a stretch of it may hold several speeds, and turns.
    """
    if status is Status.STICK_SLIP and cycles:
        return _usual([cycle.mean_speed for cycle in cycles], [cycle.period for cycle in cycles])
    for wanted in dict.fromkeys((status, *_WORST_FIRST[:4])):
        chosen = [segment for segment in segments if segment.status is wanted and segment.velocity != 0.0]
        lengths = [segment.end - segment.start for segment in chosen]
        if sum(lengths) > 0.0:
            return _usual([abs(segment.velocity) for segment in chosen], lengths)
    return math.nan


def _usual(values: Sequence[float], weights: Sequence[float]) -> float:
    """Weighted median."""
    order = np.argsort(values)
    sums = np.cumsum(np.asarray(weights)[order])
    return float(np.asarray(values)[order][int(np.searchsorted(sums, 0.5 * sums[-1]))])


def analyze(
    path: Path,
    options: AnalysisOptions | None = None,
    progress: Progress = lambda _, __: None,
    watcher: Watcher = lambda _, __, ___: None,
) -> BagAnalysis:
    """Analyse a bag; its joints are judged as the node would judge them.

    Parameters
    ----------
    progress : told how many bytes of how many have been read.
    watcher : sees every joint after every piece of the recording.

    Raises
    ------
    RecordingError
        If it cannot be read, or has no samples of the joints asked for.
    StickSlipError
        If the parameters make no joint.
    """
    options = options or AnalysisOptions()
    with Bag(path) as bag:
        try:
            topics = find_topics(bag.channels(), options.topics)
        except RecordingError as error:
            raise RecordingError("; ".join([f"bag {path}: {error}", *bag.warnings])) from error
        reader = BagReader(bag, topics, options.topics.controller)
        size, done = bag.size, 0

        def read(count: int) -> None:
            nonlocal done
            done = min(done + count, size)
            progress(done, size)

        joints, there, recorded = _follow(reader, options, read, watcher)
        progress(size, size)
        warnings = [*bag.warnings, *topics.notes]
        warnings += [f"{count} messages left out: {reason}" for reason, count in reader.refused.items()]
        _check_joints(path, options.joints, joints, there, warnings)
        # Assessed only now, that the warnings of the last block are there.
        found = {name: joint.analysis() for name, joint in joints.items()}
    for name, joint in found.items():
        warnings += [f"{name}: {count} samples left out: {why}" for why, count in joint.assessment.dropped.items()]
        warnings += [f"{name}: {joint.assessment.notice}"] if joint.assessment.notice else []
    return BagAnalysis(path=str(path), topics=topics, joints=found, warnings=tuple(warnings), recorded=recorded)


def _follow(
    reader: BagReader, options: AnalysisOptions, read: Callable[[int], None], watcher: Watcher
) -> tuple[dict[str, FollowedJoint], set[str], float]:
    joints: dict[str, FollowedJoint] = {}
    there: set[str] = set()
    first = math.nan
    clock = recorded = math.nan
    gains_of: dict[str, Gains] = {}
    # The traces look back at samples that the monitor keeps for a minute only.
    longest = min(options.longest_piece, _TRACED_AT_ONCE) if options.with_traces else options.longest_piece
    for piece in _short_pieces(reader.pieces(read), longest):
        there |= set(piece.samples)
        found: dict[str, list[Cycle]] = {}
        for name, gains in piece.gains.items():
            gains_of[name] = gains
            if name in joints:
                found[name] = joints[name].change_gains(gains)
        clock = piece.clock if math.isfinite(piece.clock) else clock
        samples, first, beyond = _within(piece.samples, first, options)
        recorded = first + clock if math.isnan(recorded) else recorded
        for name in dict.fromkeys([*samples, *piece.references]):
            joint = joints.get(name)
            if joint is None:
                if name not in samples or (options.joints and name not in options.joints):
                    continue
                if len(joints) >= _MOST_JOINTS:
                    continue
                joint = joints[name] = FollowedJoint(
                    name,
                    options.parameters,
                    with_traces=options.with_traces,
                    at_once=_AT_ONCE if math.isinf(longest) else 1,
                )
                if name in gains_of:
                    joint.change_gains(gains_of[name])
            found[name] = found.get(name, []) + joint.take(samples.get(name), piece.references.get(name))
        watcher(joints, found, clock)
        if beyond:
            break
    watcher(joints, {name: joint.end() for name, joint in joints.items()}, clock)
    return joints, there, recorded


def _short_pieces(pieces: Iterable[Piece], longest: float) -> Iterator[Piece]:
    """Pieces cut where their samples last longer; what comes with a piece comes with its first part."""
    for piece in pieces:
        if math.isinf(longest):
            yield piece
            continue
        # The running maximum keeps samples in their order where stamps go back.
        latest = {name: np.fmax.accumulate(rows[:, 0]) for name, rows in piece.samples.items() if len(rows)}
        begin = min((float(times[0]) for times in latest.values()), default=0.0)
        numbers = {name: np.floor((times - begin) / longest) for name, times in latest.items()}
        parts = sorted({float(number) for some in numbers.values() for number in np.unique(some)}) or [0.0]
        for order, part in enumerate(parts):
            yield Piece(
                gains=piece.gains if order == 0 else {},
                samples={name: piece.samples[name][some == part] for name, some in numbers.items()},
                references=piece.references if order == 0 else {},
                clock=piece.clock,
            )


def _within(
    samples: dict[str, FloatArray], first: float, options: AnalysisOptions
) -> tuple[dict[str, FloatArray], float, bool]:
    """The samples between start and end, the first stamp, and whether the end is past."""
    if math.isnan(first):
        stamps = [float(rows[0, 0]) for rows in samples.values() if len(rows)]
        first = min(stamps, default=math.nan)
    if options.start <= 0.0 and math.isinf(options.end):
        return samples, first, False
    chosen, beyond = {}, bool(samples)
    for name, rows in samples.items():
        after = rows[:, 0] - first
        kept = rows[(after >= options.start) & (after <= options.end)]
        if len(kept):
            chosen[name] = kept
        beyond = beyond and bool(np.all(after > options.end + _BEYOND))
    return chosen, first, beyond


def _check_joints(
    path: Path, wanted: tuple[str, ...], joints: dict[str, FollowedJoint], there: set[str], warnings: list[str]
) -> None:
    listed = ", ".join(sorted(there)) or "none"
    missing = [name for name in wanted if name not in joints]
    if wanted and len(missing) == len(wanted):
        raise RecordingError(f"bag {path}: no samples of joint {', '.join(missing)}; joints there: {listed}")
    if not joints:
        problem = "; ".join(["no samples of any joint between start and end" if there else "no joint in it", *warnings])
        raise RecordingError(f"bag {path}: {problem}")
    warnings += [f"no samples of joint {name}; joints there: {listed}" for name in missing]
    if len(there) > _MOST_JOINTS:
        warnings.append(f"more than {_MOST_JOINTS} joints; the others are left out")
