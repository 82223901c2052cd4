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
from stickslip_ros.monitoring.advice.limits import Criterion
from stickslip_ros.monitoring.advice.recommendation import Kind, Recommendation, recommend

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from random_advice import AdviceCase, brute_force, random_case

_JOINTS = 30
_SEED = 5
_POINTS = 360


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
        better += brute_force(case, within=0.95 * best.change) < math.inf
    times = np.percentile(seconds, [50, 95, 100])
    print(f"{condition.value}: gains within bounds for {found} of {count} joints; of these")
    words = "move steadily" if condition is Criterion.EXACT else "are smooth"
    print(f"  {smooth} {words} when integrated, {reached} have the wanted margin")
    print(f"  {better} have a point on the grid with 5 % less change; none were found but the grid has some: {missed}")
    print(f"  time {times[0]:.2f} s median, {times[1]:.2f} s at 95 %, {times[2]:.2f} s at most")


if __name__ == "__main__":
    for each in Criterion:
        verify(int(sys.argv[1]) if len(sys.argv) > 1 else _JOINTS, each)
