# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Advice on random joints: `python -m benchmarks.advice 300` checks as many of both conditions by brute force.

`make bench` times the search against the brute force that it is checked by, on a grid of 5 % steps.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

from benchmarks.timing import once
from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.outcome import steady_damping_ratio
from stickslip_ros.monitoring.advice.limits import Criterion
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "model"))
from brute_force import FROM_REST, POINT, WINDOW, motion
from random_advice import AdviceCase, brute_force, clearly_less, random_case
from random_points import random_joints

_JOINTS = 30
_SEED = 5
_POINTS = 360
_LONGEST_LAG = 0.1  # [s]
_DAMPING_RATIO = 0.03
_PERIODS, _FAST, _STEADY = 200, 3.0, 0.1


def _advised(case: AdviceCase) -> Recommendation:
    return recommend(case.joint, case.gains, case.velocity, case.limits)


def run() -> None:
    """Time the search beside brute force."""
    for condition in Criterion:
        rng = np.random.default_rng(_SEED)
        cases = [random_case(rng, condition) for _ in range(_JOINTS)]
        _advised(cases[0])
        searches = np.array([once(lambda case=case: _advised(case)) for case in cases])
        grids = np.array([once(lambda case=case: brute_force(case, points=_POINTS)) for case in cases])
        print(
            f"advice, {condition.value}: {1e3 * np.median(searches):.0f} ms (three variants), "
            f"{np.median(grids / searches):.2g} × as fast as one grid of 5 % steps ({1e3 * np.median(grids):.0f} ms)"
        )


def verify(count: int, condition: Criterion) -> None:
    """Advise random joints and look for better gains by brute force."""
    rng = np.random.default_rng(_SEED)
    found = smooth = reached = better = missed = 0
    seconds = []
    for _ in range(count):
        case = random_case(rng, condition)
        answers: list[Recommendation] = []
        seconds.append(once(lambda case=case, answers=answers: answers.append(_advised(case))))
        best = answers[0][Kind.LEAST_CHANGE]
        if not best.found:
            missed += brute_force(case) < math.inf
            continue
        found += 1
        smooth += best.slides_steadily is True or (best.exactly_smooth is True and not case.limits.steady_sliding)
        reached += best.reserve >= case.limits.wanted_margin - 1e-4
        better += brute_force(case, within=clearly_less(best, case)) < math.inf
    times = np.percentile(seconds, [50, 95, 100])
    print(f"{condition.value}: gains within bounds for {found} of {count} joints; of these")
    words = "move steadily" if condition is Criterion.EXACT else "are smooth"
    print(f"  {smooth} {words} when integrated, {reached} have the wanted margin")
    print(
        f"  {better} have a point on the grid with clearly less change; none were found but the grid has some: {missed}"
    )
    print(f"  time {times[0]:.2f} s median, {times[1]:.2f} s at 95 %, {times[2]:.2f} s at most")


def referee(count: int) -> None:
    """Advise random joints without bounds, and simulate them for 200 natural periods by the tests' brute force."""
    joints = random_joints(count, _SEED)
    steady = advised = 0
    more, seconds = [], []
    for index in np.flatnonzero(joints.lag <= _LONGEST_LAG).tolist():
        joint, gains, velocity = joints.joint(index, _DAMPING_RATIO)
        answers: list[Recommendation] = []
        seconds.append(
            once(lambda joint=joint, gains=gains, velocity=velocity, answers=answers: answers.append(
                recommend(joint, gains, float(velocity))
            ))
        )  # fmt: skip
        for kind in (Kind.LEAST_CHANGE, Kind.DAMPING_ONLY):
            if not answers[0][kind].found:
                continue
            groups = dimensionless_groups(joint, answers[0][kind].gains, float(velocity))
            point = [float(getattr(groups, name)) for name in POINT]
            motions = [motion(point, factor, periods=_PERIODS) for factor in (FROM_REST, _FAST)]
            advised += 1
            steady += all(one.arrests_in_last(WINDOW) == 0 and one.last_swing() < _STEADY for one in motions)
            if kind is Kind.DAMPING_ONLY and not answers[0].keep:
                least = float(steady_damping_ratio(groups))
                more += [float(groups.damping_ratio) / least] if least > 0 else []
    times = np.percentile(seconds, [50, 95, 100])
    ratios = np.percentile(more, [5, 50, 95, 100])
    print(f"of {advised} advised gains of {len(seconds)} joints {steady} are steady after {_PERIODS} periods,")
    print(f"  begun stuck and at three times the speed; time {times[0]:.2f} s median, {times[2]:.2f} s at most")
    print(
        f"  damping over the least that is steady: {', '.join(f'{ratio:.2f}' for ratio in ratios)} (5, 50, 95, 100 %)"
    )


if __name__ == "__main__":
    referee(int(sys.argv[1]) if len(sys.argv) > 1 else _JOINTS)
    for each in Criterion:
        verify(int(sys.argv[1]) if len(sys.argv) > 1 else _JOINTS, each)
