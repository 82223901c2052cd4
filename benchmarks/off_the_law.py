# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How well friction is learnt from machines off the paper's law, and how right the verdicts are that rest on it.

As a command: python -m benchmarks.off_the_law NUMBER_OF_JOINTS [CONDITION ...] [--workers 1] [--first 0] [--prefixes]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import cycle_persists
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.friction.estimate import NAMES, FrictionEstimate, ParameterEstimate
from stickslip_ros.monitoring.joint_monitor import JointMonitor

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from machines import LUGRE, sticks
from random_machines import CONDITIONS, DURATION, MachineRecording, random_recording

_WORKERS = 2
_EVERY = 4  # draw counts: 32 of 128, in pairs about the estimate
_SURE = 0.05  # probability of being wrong
_NEAR = (0.9, 1.1)  # of the damping: what changes between them is too near the boundary to ask
_LONGEST_LAG = 8.0 * math.pi  # dimensionless
_INTERVAL = 1.96  # standard errors
_PREFIXES = 5
_WORSE = 1.2
_WORST = 2  # conditions that are shown parameter by parameter
_ALL_NAMES = (*NAMES, "load")


@dataclass(frozen=True, kw_only=True)
class Point:
    """A verdict at other gains or another speed: whether the machine sticks, and how probable the estimate has it."""

    name: str
    sticks: bool
    probability: float  # NaN without an estimate
    usable: bool

    @property
    def sure(self) -> bool:
        """Whether the estimate commits itself."""
        return self.usable and not _SURE < self.probability < 1.0 - _SURE

    @property
    def right(self) -> bool:
        """Whether the likelier verdict is the true one."""
        return not math.isnan(self.probability) and (self.probability > 0.5) == self.sticks


@dataclass(frozen=True, kw_only=True)
class Found:
    """One joint's outcome.

    Attributes
    ----------
    truth : of the parameters that have one. untrue : names that have none, and must not be called identified.
    estimate : None if there is none.
    """

    condition: str
    seed: int
    slips: int
    truth: dict[str, float]
    untrue: tuple[str, ...]
    estimate: FrictionEstimate | None
    points: tuple[Point, ...]
    seconds: float

    @property
    def usable(self) -> bool:
        """Whether there is an estimate to believe."""
        return self.estimate is not None and self.estimate.usable

    def identified(self, name: str) -> bool:
        """Whether a parameter is called identified."""
        return self.estimate is not None and _of(self.estimate, name).identified

    def error(self, name: str) -> float:
        """Relative error of a parameter with a truth and an estimate, signed."""
        assert self.estimate is not None
        return (_of(self.estimate, name).value - self.truth[name]) / abs(self.truth[name])

    def holds(self, name: str) -> bool:
        """Whether the 95 % interval of an identified parameter holds the truth."""
        assert self.estimate is not None
        if name in self.untrue:
            return False
        one = _of(self.estimate, name)
        return bool(abs(one.value - self.truth[name]) < _INTERVAL * one.std)


def _of(estimate: FrictionEstimate, name: str) -> ParameterEstimate:
    return estimate.load if name == "load" else estimate[name]


def run(condition: str, seed: int) -> Found:
    """Draw a recording, learn from it, and ask for verdicts."""
    recording = random_recording(seed, CONDITIONS[condition])
    begin = time.perf_counter()
    estimate = learnt(recording)
    seconds = time.perf_counter() - begin
    truth, untrue = truth_of(recording, DURATION)
    return Found(
        condition=condition,
        seed=seed,
        slips=len(recording.slips),
        truth=truth,
        untrue=untrue,
        estimate=estimate,
        points=points(recording, estimate),
        seconds=seconds,
    )


def learnt(recording: MachineRecording, share: float = 1.0) -> FrictionEstimate | None:
    """What a monitor learns from the first part of a recording, as the analysis of bags has it."""
    monitor = JointMonitor(None, recording.gains, studies_at_once=True, segments_kept=None, at_arrest=True)
    monitor.process(recording.batch.where(slice(0, round(share * len(recording.batch)))))
    monitor.finish()
    return monitor.assessment().estimate


def truth_of(recording: MachineRecording, end: float) -> tuple[dict[str, float], tuple[str, ...]]:
    """The parameters at the end of a recording [s], and the names of those that it cannot show."""
    machine = recording.machine.after(end)
    truth = {name: float(getattr(machine, name)) for name in NAMES}
    if machine.law == LUGRE:
        del truth["lag"], truth["rise_time"]
    untrue: tuple[str, ...] = ()
    if recording.one_way and machine.load != 0.0:
        del truth["coulomb"]
        untrue = ("coulomb",)
    load = machine.load + machine.asymmetry * machine.coulomb
    if not recording.one_way and load != 0.0:
        truth["load"] = load
    return truth, untrue


def points(recording: MachineRecording, estimate: FrictionEstimate | None) -> tuple[Point, ...]:
    """Verdicts around the present gains and the first speed, but for those next to the boundary."""
    machine = recording.machine.after(DURATION)
    gains, speed = recording.gains, recording.speeds[0]
    total = float(gains.damping) + machine.viscous

    def damped(share: float) -> Gains:
        return replace(gains, damping=share * total - machine.viscous)

    asked = {
        "speed / 2": (gains, 0.5 * speed),
        "speed * 2": (gains, 2.0 * speed),
        "damping / 2": (damped(0.5), speed),
        "damping * 1.5": (damped(1.5), speed),
        "stiffness * 2": (replace(gains, stiffness=2.0 * float(gains.stiffness)), speed),
    }
    found = []
    for name, (tried, velocity) in asked.items():
        its_total = float(tried.damping) + machine.viscous
        around = [replace(tried, damping=share * its_total - machine.viscous) for share in (1.0, *_NEAR)]
        verdicts = {sticks(machine, one, velocity) for one in around}
        if len(verdicts) > 1:
            continue
        probability = math.nan
        if estimate is not None:
            probability = stick_slip_probability(estimate, recording.gains, tried, velocity)
        usable = estimate is not None and estimate.usable
        found.append(Point(name=name, sticks=verdicts.pop(), probability=probability, usable=usable))
    return tuple(found)


def stick_slip_probability(estimate: FrictionEstimate, present: Gains, tried: Gains, velocity: float) -> float:
    """Share of the joints as likely as the errors allow that stick by the exact condition with gains tried.

    ``present`` are the gains under which the estimate was made; 0.5 where the condition has no answer.
    """
    joint, _ = estimate.with_stiffness(float(present.stiffness), float(present.damping)).draws()
    groups = dimensionless_groups(joint, tried, velocity)
    names = ("natural_frequency", "damping_ratio", "stribeck", "velocity", "lag", "rise_time")
    some = {name: np.asarray(getattr(groups, name))[::_EVERY] for name in names}
    # A draw of little viscous friction under negative gains.
    some["damping_ratio"] = np.maximum(some["damping_ratio"], 0.0)
    # Lags of hundreds of natural periods, as open estimates have them, crash the integration.
    answered = some["lag"] <= _LONGEST_LAG
    if not answered.any():
        return 0.5
    verdicts = np.asarray(cycle_persists(replace(groups, **{name: some[name][answered] for name in names})))
    known = np.isfinite(verdicts)
    return float(verdicts[known].mean()) if known.any() else 0.5


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One condition's row; shares from 0 to 1, NaN where there is nothing to take them of."""

    condition: str
    joints: int
    identified: float
    error: float
    coverage: float
    intervals: int
    usable: float
    points: int
    sure: float
    right_of_sure: float
    right: float

    @property
    def shortfall(self) -> float:
        """By which conditions are ordered: coverage below 95 %, plus verdicts wrong, of the sure and of all."""
        parts = (max(0.95 - self.coverage, 0.0), 1.0 - self.right_of_sure, 1.0 - self.right)
        return float(np.nansum(parts))


def _mean(values: list[bool]) -> float:
    return float(np.mean(values)) if values else math.nan


def summary(condition: str, found: list[Found]) -> Summary:
    """What the joints of a condition come to."""
    known = [(one, name) for one in found for name in one.truth]
    identified = [(one, name) for one, name in known if one.identified(name)]
    claimed = identified + [(one, name) for one in found for name in one.untrue if one.identified(name)]
    asked = [point for one in found for point in one.points]
    sure = [point for point in asked if point.sure]
    return Summary(
        condition=condition,
        joints=len(found),
        identified=len(identified) / len(known),
        error=float(np.median([abs(one.error(name)) for one, name in identified])) if identified else math.nan,
        coverage=_mean([one.holds(name) for one, name in claimed]),
        intervals=len(claimed),
        usable=_mean([one.usable for one in found]),
        points=len(asked),
        sure=_mean([point.sure for point in asked]),
        right_of_sure=_mean([point.right for point in sure]),
        right=_mean([point.right for point in asked]),
    )


def _print_summaries(rows: list[Summary]) -> None:
    print(f"{'condition':16s} joints identified  error   interval holds  usable   verdicts: sure  right of sure  right")
    for row in rows:
        print(
            f"{row.condition:16s} {row.joints:6d} {100 * row.identified:8.0f} % {100 * row.error:6.2f} % "
            f"{100 * row.coverage:6.1f} % of {row.intervals:4d} {100 * row.usable:5.0f} % "
            f"{row.points:5d}: {100 * row.sure:5.1f} % {100 * row.right_of_sure:9.1f} % {100 * row.right:9.1f} %"
        )


def _print_parameters(condition: str, found: list[Found]) -> None:
    print(f"{condition}, parameter by parameter:")
    for name in _ALL_NAMES:
        truths = [one for one in found if name in one.truth]
        claimed = [one for one in found if one.identified(name) and (name in one.truth or name in one.untrue)]
        if not truths and not claimed:
            continue
        errors = [abs(one.error(name)) for one in claimed if name in one.truth]
        error = 100 * float(np.median(errors)) if errors else math.nan
        held = 100 * _mean([one.holds(name) for one in claimed])
        print(
            f"  {name:18s} identified {len(claimed):3d} of {len(truths):3d}, median error {error:6.2f} %, "
            f"interval holds {held:5.1f} %"
        )


def _print_wrong(found: list[Found]) -> None:
    wrong = [one for one in found if any(point.sure and not point.right for point in one.points)]
    print(f"joints with a verdict that is sure and wrong: {len(wrong)} of {len(found)}")
    for one in wrong:
        assert one.estimate is not None
        names = ", ".join(
            f"{point.name} ({'sticks' if point.sticks else 'smooth'}, p {point.probability:.2f})"
            for point in one.points
            if point.sure and not point.right
        )
        worst = max(one.truth, key=lambda name: _size(one, name))
        print(
            f"  {one.condition} {one.seed}: {names}; {one.estimate.slips} slips fitted, {one.estimate.aside} aside; "
            f"farthest off {worst} {100 * one.error(worst):+.1f} % ({_size(one, worst):.1f} std, "
            f"{'identified' if one.identified(worst) else 'open'}); {one.estimate.mismatch or 'fits'}"
        )


def _size(one: Found, name: str) -> float:
    """Error of a parameter in its standard errors."""
    assert one.estimate is not None
    estimate = _of(one.estimate, name)
    return abs(estimate.value - one.truth[name]) / estimate.std if estimate.std > 0 else 0.0


def prefixes(condition: str, seed: int) -> list[str]:
    """Where an error after the whole of a recording is larger than after a part, by more than chance; a line each.

    Of parameters that are identified after both.
    """
    recording = random_recording(seed, CONDITIONS[condition])
    shares = [(number + 1) / _PREFIXES for number in range(_PREFIXES)]
    estimates = [learnt(recording, share) for share in shares]
    whole = estimates[-1]
    if whole is None:
        return [f"{condition} {seed}: no estimate after the whole"] if any(estimates) else []
    truth, _ = truth_of(recording, DURATION)
    lines = []
    for share, before in zip(shares[:-1], estimates[:-1], strict=True):
        truth_then, _ = truth_of(recording, share * DURATION)
        for name in truth:
            if before is None or name not in truth_then:
                continue
            then, now = _of(before, name), _of(whole, name)
            earlier, later = abs(then.value - truth_then[name]), abs(now.value - truth[name])
            if then.identified and now.identified and later > _WORSE * earlier + now.std:
                size = abs(truth[name])
                lines.append(
                    f"{condition} {seed}: {name} off by {100 * later / size:.2f} % ({100 * now.std / size:.2f} % std) "
                    f"after the whole, {100 * earlier / size:.2f} % after {100 * share:.0f} %"
                )
    return lines


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.off_the_law", description=__doc__)
    parser.add_argument("joints", type=int, help="of each condition")
    parser.add_argument("conditions", nargs="*", choices=[[], *CONDITIONS], help="all by default")
    parser.add_argument("--workers", type=int, default=_WORKERS)
    parser.add_argument("--first", type=int, default=0, help="seed of the first joint")
    parser.add_argument("--prefixes", action="store_true", help="whether more of a recording ever tells less")
    return parser.parse_args()


def main() -> None:
    """The command."""
    arguments = _arguments()
    conditions = arguments.conditions or list(CONDITIONS)
    seeds = range(arguments.first, arguments.first + arguments.joints)
    jobs = [(condition, seed) for condition in conditions for seed in seeds]
    with ProcessPoolExecutor(arguments.workers) as pool:
        if arguments.prefixes:
            for lines in pool.map(prefixes, *zip(*jobs, strict=True)):
                for line in lines:
                    print(line, flush=True)
            return
        found = list(pool.map(run, *zip(*jobs, strict=True)))
    by_condition = {name: [one for one in found if one.condition == name] for name in conditions}
    rows = sorted((summary(name, one) for name, one in by_condition.items()), key=lambda row: -row.shortfall)
    _print_summaries(rows)
    for row in rows[:_WORST]:
        _print_parameters(row.condition, by_condition[row.condition])
    _print_wrong([one for row in rows for one in by_condition[row.condition]])
    print(f"median {np.median([one.seconds for one in found]):.1f} s of learning a recording")


if __name__ == "__main__":
    main()
