# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether verdict and advice hold at the worst place: joints whose friction grows with load, or varies over position.

Random joints, learnt from in motion to and fro; the truth is the machine (`test/monitoring/machines.py`) held at its
worst place and at its best one. As a command: python -m benchmarks.worst_place NUMBER_OF_JOINTS [KIND ...]
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

from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import Detail, verdict
from stickslip_ros.monitoring.advice.limits import AdviceLimits
from stickslip_ros.monitoring.advice.recommend import recommend
from stickslip_ros.monitoring.advice.recommendation import Kind
from stickslip_ros.monitoring.friction.estimate import FrictionEstimate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from machines import Machine, sticks
from varying_machines import KINDS, learnt_monitor, random_varying

_WORKERS = 2


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One joint's.

    Attributes
    ----------
    share : by which Stribeck friction is less at the best place than at the worst, as it is; found : as learnt, with
        its standard error; zeros where none was claimed.
    verdict : share of the verdicts at the worst place, at dampings around the true boundary, that are right.
    cured : whether gains advised end stick-slip at the worst place and at the best one; None without advice.
    damping : advised, over the damping advised for the true joint at the worst place, of controller and joint together.
    """

    kind: str
    seed: int
    slips: int
    share: float
    found: float
    std: float
    verdict: float
    cured: bool | None
    damping: float
    seconds: float


def _boundary(machine: Machine, gains: Gains, velocity: float) -> float:
    """Total damping at which the machine just does not stick [N·m·s/rad]; by bisection of the logarithm."""
    scale = math.sqrt(float(gains.stiffness) * machine.inertia)
    low, high = 0.01 * scale, 4.0 * scale
    for _ in range(7):
        middle = math.sqrt(low * high)
        if sticks(machine, replace(gains, damping=middle - machine.viscous), velocity, periods=100.0):
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


def _verdicts(estimate: FrictionEstimate, worst: Machine, gains: Gains, velocity: float) -> float:
    """Share that is right at 0.6, 0.8, 1.25 and 1.6 of the boundary's damping."""
    boundary = _boundary(worst, gains, velocity)
    right = []
    for factor in (0.6, 0.8, 1.25, 1.6):
        tried = replace(gains, damping=factor * boundary - worst.viscous)
        right.append(verdict(estimate.joint(), tried, velocity, detail=Detail.SMOOTH).smooth is (factor > 1.0))
    return float(np.mean(right))


def run(kind: str, seed: int) -> Outcome:
    """Draw, learn, ask, and simulate."""
    begin = time.perf_counter()
    recording = random_varying(seed, kind)
    machine, gains, velocity = recording.machine, recording.gains, recording.speed
    monitor = learnt_monitor(recording, as_it_goes=True)
    estimate = monitor.assessment().estimate
    places = [machine.at(position) for position in recording.slips[:, 1]]
    worst, best = (chosen(places, key=lambda one: one.stribeck) for chosen in (max, min))
    verdict, cured, damping, friction_factor = math.nan, None, math.nan, None
    if estimate is not None and estimate.usable:
        friction_factor = estimate.friction_factor
        verdict = _verdicts(estimate, worst, gains, velocity)
        limits = AdviceLimits()
        joint = estimate.joint()
        advised = recommend(joint, gains, velocity, limits)[Kind.DAMPING_ONLY]
        true_joint = replace(joint, inertia=worst.inertia, friction=joint.friction.changed({
            "stribeck": worst.stribeck, "stribeck_velocity": worst.stribeck_velocity, "lag": worst.lag,
            "rise_time": worst.rise_time, "viscous": worst.viscous, "coulomb": worst.coulomb,
        }))  # fmt: skip
        needed = recommend(true_joint, gains, velocity, limits)[Kind.DAMPING_ONLY]
        if advised.found:
            tried = replace(gains, stiffness=advised.stiffness, damping=advised.damping)
            cured = not any(sticks(one, tried, velocity) for one in (worst, best))
            damping = (advised.damping + worst.viscous) / (needed.damping + worst.viscous)
    return Outcome(
        kind=kind,
        seed=seed,
        slips=len(recording.slips),
        share=1.0 - best.stribeck / worst.stribeck,
        found=friction_factor.share if friction_factor is not None else 0.0,
        std=friction_factor.std if friction_factor is not None else 0.0,
        verdict=verdict,
        cured=cured,
        damping=damping,
        seconds=time.perf_counter() - begin,
    )


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.worst_place", description=__doc__)
    parser.add_argument("joints", type=int, help="of each kind")
    parser.add_argument("kinds", nargs="*", choices=[[], *KINDS], help="all by default")
    parser.add_argument("--workers", type=int, default=_WORKERS)
    arguments = parser.parse_args()
    kinds = arguments.kinds or list(KINDS)
    jobs = [(kind, seed) for kind in kinds for seed in range(arguments.joints)]
    with ProcessPoolExecutor(arguments.workers) as pool:
        found = []
        for one in pool.map(run, *zip(*jobs, strict=True)):
            found.append(one)
            print(one, file=sys.stderr, flush=True)
    print("kind      joints  growth found  error of share  verdicts right at the worst place  cured  damping, median")
    for kind in kinds:
        rows = [one for one in found if one.kind == kind]
        usable = [one for one in rows if not math.isnan(one.verdict)]
        claimed = [one for one in rows if one.found > 0.0]
        advised = [one for one in rows if one.cured is not None]
        error = float(np.median([abs(one.found - one.share) for one in claimed])) if claimed else math.nan
        right = float(np.mean([one.verdict for one in usable])) if usable else math.nan
        print(
            f"{kind:10s} {len(rows):4d} {len(claimed):10d} {100 * error:14.1f} % {100 * right:20.1f} % of "
            f"{len(usable)} usable {sum(bool(one.cured) for one in advised):6d} of {len(advised)} "
            f"{np.median([one.damping for one in advised]) if advised else math.nan:8.2f}"
        )


if __name__ == "__main__":
    main()
