# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How well friction is learnt from machines off the paper's law, and how right the verdicts are that rest on it.

As a command: python -m benchmarks.off_the_law NUMBER_OF_JOINTS [CONDITION ...] [--workers 1] [--first 0] [--prefixes]
"""

from __future__ import annotations

import argparse
import math
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.machine_outcomes import (
    ALL_NAMES,
    CONDITIONS,
    DURATION,
    Found,
    assessed,
    parameter_of,
    random_recording,
    run,
    truth_of,
)

_WORKERS = 2
_PREFIXES = 5
_WORSE = 1.2
_WORST = 2  # conditions that are shown parameter by parameter


@dataclass(frozen=True, kw_only=True)
class Summary:
    """One condition's row; shares from 0 to 1, NaN where there is nothing to take them of.

    Attributes
    ----------
    deviation : median of the errors of all parameters, in standard errors: 0.67 where these are right.
    score : mean logarithm of the density of the true values, but for friction and load of motion in one direction.
    advised : joints that got gains as advice. cured : share of these machines that no longer stick with the gains.
    """

    condition: str
    joints: int
    identified: float
    error: float
    coverage: float
    intervals: int
    deviation: float
    score: float
    usable: float
    points: int
    sure: float
    right_of_sure: float
    right: float
    advised: int
    cured: float

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
    estimated = [(one, name) for one, name in known if one.estimate is not None and one.truth[name] > 0.0]
    deviations = [one.deviation(name) for one, name in estimated]
    scores = [one.log_score(name) for one, name in estimated if name not in ("coulomb", "load")]
    asked = [point for one in found for point in one.points]
    sure = [point for point in asked if point.sure]
    advised = [one.cured for one in found if one.cured is not None]
    return Summary(
        condition=condition,
        joints=len(found),
        identified=len(identified) / len(known),
        error=float(np.median([abs(one.error(name)) for one, name in identified])) if identified else math.nan,
        coverage=_mean([one.holds(name) for one, name in claimed]),
        intervals=len(claimed),
        deviation=float(np.median(deviations)) if deviations else math.nan,
        score=float(np.mean(scores)) if scores else math.nan,
        usable=_mean([one.usable for one in found]),
        points=len(asked),
        sure=_mean([point.sure for point in asked]),
        right_of_sure=_mean([point.right for point in sure]),
        right=_mean([point.right for point in asked]),
        advised=len(advised),
        cured=_mean(advised),
    )


def _print_summaries(rows: list[Summary]) -> None:
    estimates = f"{'condition':16s} joints identified  error   interval holds  errors/std  score  usable"
    print(f"{estimates}   verdicts: sure  right of sure  right    advised: cured")
    for row in rows:
        print(
            f"{row.condition:16s} {row.joints:6d} {100 * row.identified:8.0f} % {100 * row.error:6.2f} % "
            f"{100 * row.coverage:6.1f} % of {row.intervals:4d} {row.deviation:10.2f} {row.score:6.2f} "
            f"{100 * row.usable:5.0f} % "
            f"{row.points:5d}: {100 * row.sure:5.1f} % {100 * row.right_of_sure:9.1f} % {100 * row.right:9.1f} %"
            f"{row.advised:5d}: {100 * row.cured:5.1f} %"
        )


def _print_parameters(condition: str, found: list[Found]) -> None:
    print(f"{condition}, parameter by parameter:")
    for name in ALL_NAMES:
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
        worst = max(one.truth, key=one.deviation)
        print(
            f"  {one.condition} {one.seed}: {names}; {one.estimate.slips} slips fitted, {one.estimate.aside} aside; "
            f"farthest off {worst} {100 * one.error(worst):+.1f} % ({one.deviation(worst):.1f} std, "
            f"{'identified' if one.identified(worst) else 'open'}); {one.estimate.mismatch or 'fits'}"
        )


def prefixes(condition: str, seed: int) -> list[str]:
    """Where an error after the whole of a recording is larger than after a part, by more than chance; a line each.

    Of parameters that are identified after both.
    """
    recording = random_recording(seed, CONDITIONS[condition])
    shares = [(number + 1) / _PREFIXES for number in range(_PREFIXES)]
    estimates = [assessed(recording, share).estimate for share in shares]
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
            then, now = parameter_of(before, name), parameter_of(whole, name)
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
        found = []
        for one in pool.map(run, *zip(*jobs, strict=True)):
            found.append(one)
            print(f"{one.condition} {one.seed}: {one.slips} slips, {one.seconds:.1f} s", file=sys.stderr, flush=True)
    by_condition = {name: [one for one in found if one.condition == name] for name in conditions}
    rows = sorted((summary(name, one) for name, one in by_condition.items()), key=lambda row: -row.shortfall)
    _print_summaries(rows)
    for row in rows[:_WORST]:
        _print_parameters(row.condition, by_condition[row.condition])
    _print_wrong([one for row in rows for one in by_condition[row.condition]])
    print(f"median {np.median([one.seconds for one in found]):.1f} s of learning a recording")


if __name__ == "__main__":
    main()
