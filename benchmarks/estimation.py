# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How well friction is learnt: errors, coverage and cost on joints drawn at random.

As a command: python -m benchmarks.estimation NUMBER_OF_JOINTS
"""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import LinAlgError

from stickslip_ros.model.dimensionless import dimensionless_groups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.joint_simulation import EventKind
from stickslip_ros.monitoring.friction.estimate import COULOMB_AND_LOAD, NAMES, FrictionEstimate
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.learner import FrictionLearner
from stickslip_ros.monitoring.friction.slip_data import SlipData
from stickslip_ros.monitoring.friction.slip_fit import Tolerances, fit_at_fixed_parameters
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from random_joints import RandomRecording, cut_slips, random_recording

_FEW = 8  # joints in `make bench`
_WORKERS = 2
_BOUNDARY = 0.2


@dataclass(frozen=True)
class _Result:
    """One joint's: relative errors and standard errors of what was identified, bounds, verdicts, time."""

    errors: dict[str, tuple[float, float]]
    bounds: dict[str, float]
    mismatch: bool
    seconds: float
    frequency_error: float
    verdicts: list[tuple[bool, bool]]


def run(joints: int = _FEW) -> None:
    """All of it."""
    with ProcessPoolExecutor(_WORKERS) as pool:
        for name, work in (("1 kHz", _clean), ("200 Hz, noisy", _noisy), ("forces withheld", _withheld)):
            _print(name, [result for result in pool.map(work, range(joints)) if result is not None], joints)
    _cost()


def _truth(recording: RandomRecording) -> dict[str, float]:
    joint = recording.joint
    return {"inertia": float(joint.inertia)} | {name: float(getattr(joint.friction, name)) for name in NAMES[1:]}


def _judge(recording: RandomRecording, estimate: FrictionEstimate, seconds: float, *, bound: bool) -> _Result:
    truth = _truth(recording)
    # Compared in units of torque, by the gains that were withheld.
    in_torque = estimate.with_stiffness(float(recording.gains.stiffness), float(recording.gains.damping))
    # These joints carry no load, so that what one direction shows is Coulomb friction.
    found = {name: in_torque[name if name != "coulomb" else COULOMB_AND_LOAD] for name in truth}
    errors = {
        name: (found[name].value / value - 1.0, found[name].std / value)
        for name, value in truth.items()
        if found[name].identified and math.isfinite(found[name].value)
    }
    frequency = math.sqrt(float(recording.gains.stiffness) / truth["inertia"])
    own = estimate.natural_frequency.value
    if math.isnan(own):
        own = math.sqrt(float(recording.gains.stiffness) / estimate["inertia"].value)
    return _Result(
        errors=errors,
        bounds=_bounds(recording) if bound else {},
        mismatch=bool(estimate.mismatch),
        seconds=seconds,
        frequency_error=own / frequency - 1.0,
        verdicts=_verdicts(recording, estimate),
    )


def _estimate(recording: RandomRecording, *, noisy: bool = False, withheld: bool = False) -> _Result | None:
    batch = recording.noisy(1) if noisy else recording.without_forces() if withheld else recording.batch
    windows, _ = cut_slips(batch, None if withheld else recording.gains)
    begin = time.perf_counter()
    estimate = estimate_friction(windows)
    seconds = time.perf_counter() - begin
    if estimate is None:
        return None
    return _judge(recording, estimate, seconds, bound=not noisy and not withheld)


def _clean(seed: int) -> _Result | None:
    return _estimate(random_recording(seed))


def _noisy(seed: int) -> _Result | None:
    return _estimate(random_recording(seed), noisy=True)


def _withheld(seed: int) -> _Result | None:
    return _estimate(random_recording(seed), withheld=True)


def _verdicts(recording: RandomRecording, estimate: FrictionEstimate) -> list[tuple[bool, bool]]:
    """True and estimated exact verdict at dampings around the boundary, but not within a fifth of it."""
    speed = recording.speeds[0]
    joint, gains = recording.joint, recording.gains
    boundary = float(exact_critical_damping_ratio(dimensionless_groups(joint, gains, speed)))
    learnt_gains = estimate.gains or gains
    learnt = dimensionless_groups(estimate.joint(), learnt_gains, speed)
    theirs = float(exact_critical_damping_ratio(learnt))
    now = float(dimensionless_groups(joint, gains, speed).damping_ratio)
    shift = float(learnt.damping_ratio) - now
    ratios = boundary * np.array([0.4, 0.6, 0.78, 1.22, 1.6, 2.5])
    return [(bool(ratio > boundary), bool(ratio + shift > theirs)) for ratio in ratios]


def _bounds(recording: RandomRecording) -> dict[str, float]:
    """Cramér-Rao bounds of the relative errors, from the slope of all observed slips at the truth."""
    windows, _ = cut_slips(recording.batch, recording.gains)
    problem = SlipProblem(SlipData(windows))
    truth = _truth(recording)
    order = ("inertia", "viscous", "stribeck_velocity", "lag", "stribeck", "rise_time")
    parameters = np.log([truth[name] for name in order])
    begins = [event for event in recording.events if event.kind is EventKind.BREAKAWAY]
    detected = problem.data.breakaways + problem.data.origin
    nearest = [min(begins, key=lambda event: abs(event.time - time)) for time in detected]
    unknowns = np.array([(event.position, event.time, math.log(event.stribeck_level)) for event in nearest])
    unknowns[:, 1] -= problem.data.origin
    problem = problem.weighed(problem.simulate(parameters, unknowns)[1])
    try:
        known = fit_at_fixed_parameters(
            problem, Tolerances(balance=1e-4 * truth["stribeck"], level=1e-4), parameters=parameters,
            kinetic=np.array([truth["coulomb"]]), unknowns=unknowns, iterations=0, scored=True,
        )  # fmt: skip
    except LinAlgError:
        return {}
    scale = 1.0 / np.sqrt(np.diag(known.information))
    covariance = np.linalg.pinv(known.information * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    errors = np.sqrt(np.abs(np.diag(covariance)))
    return dict(zip((*order, "coulomb"), [*errors[:6], errors[6] / truth["coulomb"]], strict=True))


def _print(name: str, results: list[_Result], joints: int) -> None:
    print(f"friction of {joints} random joints, {name}:")
    inside = []
    for parameter in NAMES:
        found = np.array([result.errors[parameter] for result in results if parameter in result.errors])
        if not len(found):
            continue
        covered = np.abs(found[:, 0]) < 1.96 * found[:, 1]
        inside.append(covered)
        ratios = [
            abs(result.errors[parameter][0]) / result.bounds[parameter]
            for result in results
            if parameter in result.errors and result.bounds.get(parameter, 0.0) > 0
        ]
        # The median of a normal variable's size is 0.67 standard deviations.
        bound = f", {np.median(ratios) / 0.6745:4.1f} x Cramer-Rao bound" if ratios else ""
        middle, high = 100.0 * np.quantile(np.abs(found[:, 0]), [0.5, 0.95])
        print(
            f"  {parameter:18s} identified {len(found):3d}, error median {middle:5.2f} %, 95 % below {high:5.2f} %, "
            f"95 % interval holds {100 * covered.mean():5.1f} %{bound}"
        )
    together = np.concatenate(inside)
    verdicts = [pair for result in results for pair in result.verdicts]
    frequency = np.abs([result.frequency_error for result in results])
    print(
        f"  intervals hold {100 * together.mean():.1f} % of {len(together)}; exact verdict right at "
        f"{100 * np.mean([true == learnt for true, learnt in verdicts]):.1f} % of {len(verdicts)} points beyond 20 %; "
        f"omega within 2 % for {100 * np.mean(frequency < 0.02):.1f} %; does not fit: "
        f"{sum(result.mismatch for result in results)}; no estimate: {joints - len(results)}; "
        f"{np.median([result.seconds for result in results]):.1f} s each"
    )


def _cost() -> None:
    """Comparison of a slip with what is known, once learnt."""
    windows, _ = cut_slips(*_first())
    learner = FrictionLearner()
    updates = []
    for window in windows:
        begin = time.perf_counter()
        learner.add_slip(window)
        taken = time.perf_counter() - begin
        if learner.estimate is not None:
            updates.append(taken)
        learner.study_now()
    print(f"comparison of a slip with friction {1e3 * np.median(updates):8.2f} ms median of {len(updates)}")


def _first() -> tuple[object, Gains]:
    recording = random_recording(1)
    return recording.batch, recording.gains


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else _FEW)
