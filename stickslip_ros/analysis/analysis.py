# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What a recording shows of its joints: the node's own pipeline, fed from a bag."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stickslip_ros.analysis.joint_analysis import JointAnalysis, JointAnalyzer
from stickslip_ros.bags.reading import BagReader, Piece
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.storage.unpacking import UnpackLimit
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import TopicChoice, Topics, find_robots
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model._validation import require_not_negative
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.samples import FloatArray
from stickslip_ros.output.wording import friction_change_text, in_metres_text
from stickslip_ros.settings.parameter_file import Parameters

_MOST_JOINTS = 256  # names come from the file; their number is bounded
_AT_ONCE = 8000  # samples of a joint that are followed at once
_TRACED_AT_ONCE = 8.0  # [s]
_BEYOND = 5.0  # [s] after the end asked for, from which on nothing more is read


@dataclass(frozen=True, kw_only=True)
class AnalysisOptions:
    """What to analyse, and how.

    Attributes
    ----------
    topics : named by the user. joints : names, of one robot ("left/joint1") or of every one; () for every joint.
    start, end : in seconds after the first sample.
    parameters : as the node has them. with_traces : whether to keep what the report draws.
    longest_piece : of a recording, after which a watcher sees the joints [s] of samples.
    unpacking : how much compressed data may become.

    Raises
    ------
    InvalidParameterError
        If the start is negative or not finite, or the end not after it.
    """

    topics: TopicChoice = field(default_factory=TopicChoice)
    joints: tuple[str, ...] = ()
    start: float = 0.0
    end: float = math.inf
    parameters: Parameters = field(default_factory=Parameters)
    with_traces: bool = False
    longest_piece: float = math.inf
    unpacking: UnpackLimit = field(default_factory=UnpackLimit)

    def __post_init__(self) -> None:
        require_not_negative("start", self.start)
        if not self.end > self.start:
            raise InvalidParameterError("end", f"after the start at {self.start:g} s", self.end)


@dataclass(frozen=True, kw_only=True)
class BagAnalysis:
    """What a recording shows.

    Attributes
    ----------
    path : as given. robots : what was read of each; the name "" is of a bag's only one.
    joints : by name, which begins with that of the robot where there are several. warnings : what is missing or was
        left out.
    recorded : when, by the recorder's clock [s]; NaN if it has no samples.
    owners : robot of each joint, and the joint's name there.
    """

    path: str
    robots: dict[str, Topics]
    joints: dict[str, JointAnalysis]
    warnings: tuple[str, ...]
    recorded: float = math.nan
    owners: dict[str, tuple[str, str]] = field(default_factory=dict)


Progress = Callable[[int, int], None]
# Called after every piece with the monitors by joint, the cycles found in it, and log time less stamp.
Watcher = Callable[["dict[str, JointAnalyzer]", "dict[str, list[Cycle]]", float], None]


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
    # Joints know nothing of each other, and what takes long in a joint is compiled and lets other threads run.
    with Bag(path, options.unpacking) as bag, ThreadPoolExecutor(os.cpu_count()) as threads:
        try:
            robots = find_robots(bag.channels(), options.topics)
        except RecordingError as error:
            raise RecordingError("; ".join([f"bag {path}: {error}", *bag.warnings])) from error
        reader = BagReader(bag, robots, options.topics.controller)
        size, done = bag.size, 0

        def read(count: int) -> None:
            nonlocal done
            done = min(done + count, size)
            progress(done, size)

        joints, recorded = _process_pieces(reader, options, threads, read, watcher)
        progress(size, size)
        controller = options.topics.controller
        if controller is not None and controller not in reader.controllers:
            there = ", ".join(sorted(reader.controllers)) or "none"
            raise RecordingError(f"bag {path}: --controller {controller}: no gains of this node; nodes there: {there}")
        warnings = [*bag.warnings, *(note for topics in robots.values() for note in topics.notes)]
        named = {*reader.joints, *(joint for _, joint in reader.joints.values())}
        warnings += [*options.parameters.notes, *options.parameters.unused_gains(named)]
        warnings += [*options.parameters.misnamed_joints(named), *_without_leaders(robots, reader)]
        warnings += [f"{count} messages left out: {reason}" for reason, count in reader.refused.items()]
        warnings += [f"{what} ({count} messages)" for what, count in reader.replaced.items()]
        warnings += reader.wrapped
        warnings += [in_metres_text(reader.prismatic)] if reader.prismatic else []
        warnings += [f"joint {name!r} has no name" for name, (_, own) in reader.joints.items() if not own]
        _check_joints(path, options.joints, joints, reader.joints, warnings)
        if not reader.with_positions:
            # One line says it all: nothing else can be said of such joints.
            raise RecordingError(f"bag {path}: its joint states have no positions, without which nothing can be judged")
        # Assessed only now, that the warnings of the last block are there.
        found = dict(zip(joints, threads.map(JointAnalyzer.analysis, joints.values()), strict=True))
    for name, joint in found.items():
        warnings += [f"{name}: {problem}" for problem in joint.problems]
        change = joint.assessment.change
        warnings += [f"{name}: {friction_change_text(change)}"] if change is not None else []
    return BagAnalysis(
        path=str(path),
        robots=robots,
        joints=found,
        warnings=tuple(warnings),
        recorded=recorded,
        owners={name: reader.joints[name] for name in found},
    )


def _without_leaders(robots: Mapping[str, Topics], reader: BagReader) -> list[str]:
    """What is to be said of joints that follow a leader which has no joint of their name."""
    there: dict[str, list[str]] = {name: [] for name in robots}
    for robot, joint in reader.joints.values():
        there[robot].append(joint)
    leaders = {topics.states: robot for robot, topics in robots.items()}
    texts = []
    for robot, topics in robots.items():
        if topics.leader is None:
            continue
        leads = there[leaders[topics.leader]]
        alone = [joint for joint in there[robot] if joint not in leads]
        if alone and leads:
            texts.append(
                f"{robot}: no joint of its leader {topics.leader.topic} is named {' or '.join(alone)} (there are "
                f"{', '.join(leads)}): judged without a reference"
            )
    return texts


def _process_pieces(
    reader: BagReader, options: AnalysisOptions, threads: Executor, read: Callable[[int], None], watcher: Watcher
) -> tuple[dict[str, JointAnalyzer], float]:
    joints: dict[str, JointAnalyzer] = {}
    first = math.nan
    clock = recorded = math.nan
    gains_of: dict[str, Gains] = {}
    # The traces look back at samples that the monitor keeps for a minute only.
    longest = min(options.longest_piece, _TRACED_AT_ONCE) if options.with_traces else options.longest_piece
    for piece in _short_pieces(reader.pieces(read), longest):
        found: dict[str, list[Cycle]] = {}
        for name, gains in piece.gains.items():
            gains_of[name] = gains
            if name in joints:
                found[name] = joints[name].change_gains(gains)
        clock = piece.clock if math.isfinite(piece.clock) else clock
        samples, first, beyond = _within(piece.samples, first, options)
        recorded = first + clock if math.isnan(recorded) else recorded
        fed: dict[str, Future[list[Cycle]]] = {}
        for name in dict.fromkeys([*samples, *piece.references]):
            joint = joints.get(name)
            if joint is None:
                if name not in samples:
                    continue
                own = reader.joints[name][1]
                if options.joints and not {name, own} & set(options.joints):
                    continue
                if len(joints) >= _MOST_JOINTS:
                    continue
                joint = joints[name] = JointAnalyzer(
                    name,
                    options.parameters.also_of(own, name),
                    with_traces=options.with_traces,
                    at_once=_AT_ONCE if math.isinf(longest) else 1,
                )
                if name in gains_of:
                    joint.change_gains(gains_of[name])
            fed[name] = threads.submit(joint.process, samples.get(name), piece.references.get(name))
        for name, cycles in fed.items():
            found[name] = found.get(name, []) + cycles.result()
        watcher(joints, found, clock)
        if beyond:
            break
    watcher(joints, dict(zip(joints, threads.map(JointAnalyzer.finish, joints.values()), strict=True)), clock)
    return joints, recorded


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
    path: Path,
    wanted: tuple[str, ...],
    joints: dict[str, JointAnalyzer],
    names: Mapping[str, tuple[str, str]],
    warnings: list[str],
) -> None:
    there = set(names)
    listed = ", ".join(sorted(there)) or "none"
    own = {names[name][1] for name in joints}
    missing = [name for name in wanted if name not in joints and name not in own]
    if wanted and len(missing) == len(wanted):
        raise RecordingError(f"bag {path}: no samples of joint {', '.join(missing)}; joints there: {listed}")
    if not joints:
        problem = "; ".join(["no samples of any joint between start and end" if there else "no joint in it", *warnings])
        raise RecordingError(f"bag {path}: {problem}")
    warnings += [f"no samples of joint {name}; joints there: {listed}" for name in missing]
    if len(there) > _MOST_JOINTS:
        warnings.append(f"more than {_MOST_JOINTS} joints; the others are left out")
