# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Random joints, and how often the exact verdict is right about them by brute force.

``python test/model/random_points.py 1000`` prints the tables (minutes on one core); a second number is the seed.
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import dataclass

import brute_force
import numpy as np
from brute_force import FROM_REST, OUTCOMES, STEADY, STICKS, SWINGS, UNDECIDED, outcomes

from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.exact import exact_critical_damping_ratio
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.outcome import Outcome, steady_damping_ratio
from stickslip_ros.model.outcome import outcomes as verdict_outcomes

LAG_BANDS = (0.0, 1.0, 2.0, 3.1, 4.0, 5.0, 2 * np.pi)
SLIDING = (1.15, 2.0, 3.0)  # times the commanded speed
_LONGEST_LAG = 2 * np.pi
_LISTED = 25
_LEAST_RATIO = 0.01  # in the place of a boundary that is less
_MOST_PERIODS = 20000
_NUMBERS = {Outcome.STICKS: STICKS, Outcome.SWINGS: SWINGS, Outcome.STEADY: STEADY, None: UNDECIDED}
_FROM_WORST = (STICKS, UNDECIDED, SWINGS, STEADY)


@dataclass(frozen=True, kw_only=True)
class RandomJoints:
    """Joints in SI units, arrays of one length; the damping k_v is left to who asks.

    Attributes
    ----------
    inertia [kg·m²], stiffness [N·m/rad], velocity [rad/s], stribeck [N·m], stribeck_velocity [rad/s], lag [s],
    rise_time [s], coulomb [N·m].
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    velocity: np.ndarray
    stribeck: np.ndarray
    stribeck_velocity: np.ndarray
    lag: np.ndarray
    rise_time: np.ndarray
    coulomb: np.ndarray

    def points(self, damping_ratio) -> np.ndarray:
        """Rows of brute_force.POINT at these damping ratios."""
        frequency = np.sqrt(self.stiffness / self.inertia)
        return np.column_stack(
            [
                np.broadcast_to(damping_ratio, self.inertia.shape),
                self.stribeck / (self.inertia * frequency * self.stribeck_velocity),
                self.velocity / self.stribeck_velocity,
                frequency * self.lag,
                frequency * self.rise_time,
            ]
        )

    def joint(self, index: int, damping_ratio: float) -> tuple[Joint, Gains, float]:
        """One of them with its gains, and the commanded velocity [rad/s]; half of the damping is the controller's."""
        inertia, stiffness = float(self.inertia[index]), float(self.stiffness[index])
        half = damping_ratio * np.sqrt(inertia * stiffness)
        friction = Friction(
            stribeck=float(self.stribeck[index]), stribeck_velocity=float(self.stribeck_velocity[index]),
            lag=float(self.lag[index]), rise_time=float(self.rise_time[index]), viscous=half,
            coulomb=float(self.coulomb[index]),
        )  # fmt: skip
        return Joint(inertia=inertia, friction=friction), Gains(stiffness=stiffness, damping=half), self.velocity[index]


def random_joints(count: int, seed: int) -> RandomJoints:
    """Inertia 0.02-40, natural frequency 1-12 Hz, lag 5-100 ms or more, F*_s∞ 0.03-30, speed 0.05-20 times x˙_s.

    Half of the lags are log-uniform and at most a natural period, the others are such that τ* is uniform up to 2π.
    """
    generator = np.random.default_rng(seed)

    def logarithmic(low, high):
        return np.exp(generator.uniform(np.log(low), np.log(high), count))

    inertia, frequency = logarithmic(0.02, 40.0), 2 * np.pi * logarithmic(1.0, 12.0)
    lag = np.minimum(logarithmic(0.005, 0.1), 0.999 * _LONGEST_LAG / frequency)
    lag = np.where(np.arange(count) % 2 == 0, lag, generator.uniform(0.0, _LONGEST_LAG, count) / frequency)
    stribeck_velocity = logarithmic(1e-3, 0.1)
    stribeck = logarithmic(0.03, 30.0) * inertia * frequency * stribeck_velocity
    return RandomJoints(
        inertia=inertia,
        stiffness=inertia * frequency**2,
        velocity=logarithmic(0.05, 20.0) * stribeck_velocity,
        stribeck=stribeck,
        stribeck_velocity=stribeck_velocity,
        lag=lag,
        rise_time=logarithmic(0.05, 2.0),
        coulomb=logarithmic(0.3, 20.0) * stribeck,
    )


def groups_of(points: np.ndarray) -> DimensionlessGroups:
    """The kernel's form of rows of brute_force.POINT, or of one."""
    columns = dict(zip(brute_force.POINT, points.T if points.ndim > 1 else map(float, points), strict=True))
    return DimensionlessGroups(natural_frequency=1.0, **columns)


def at(points: np.ndarray, damping_ratios) -> np.ndarray:
    """The rows at other damping ratios."""
    changed = points.copy()
    changed[:, 0] = damping_ratios
    return changed


def _by_band(lags: np.ndarray) -> list[tuple[str, np.ndarray]]:
    pairs = itertools.pairwise(LAG_BANDS)
    bands = [(f"{low:.1f}-{high:.1f}", (lags >= low) & (lags < high)) for low, high in pairs]
    return [*bands, ("all", np.ones(len(lags), dtype=bool))]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What was said of joints, and what is true, both by start: from rest, and the worst of those that slide.

    Attributes
    ----------
    points : rows of brute_force.POINT.
    said, true : outcomes (joints, 2), numbers of brute_force.
    doubtful : where steps half as long lead brute force to another outcome, (joints, 2).
    late : where a swing takes more than 600 periods to become steady, (joints, 2).
    """

    points: np.ndarray
    said: np.ndarray
    true: np.ndarray
    doubtful: np.ndarray
    late: np.ndarray

    def errors(self) -> dict[str, np.ndarray]:
        """Which answers are wrong, by kind; where brute force knows no answer either, none is."""
        said, true = self.said, np.where(self.doubtful, UNDECIDED, self.true)
        known = true != UNDECIDED
        return {
            "steady, is not": (said == STEADY) & known & (true != STEADY),
            "smooth, sticks": (said != STICKS) & (said != UNDECIDED) & (true == STICKS),
            "sticks, does not": (said == STICKS) & known & (true != STICKS),
            "swings, is steady": (said == SWINGS) & (true == STEADY) & ~self.late,
            "steady later": (said == SWINGS) & (true == STEADY) & self.late,
            "no answer": said == UNDECIDED,
            "referee unsure": ~known,
        }


def judge(points: np.ndarray) -> Judged:
    """Ask the verdict and brute force; what they disagree on is simulated for 20000 periods, at two steps."""
    said = np.array([_said(point) for point in points])
    true = _truth(points, periods=brute_force.PERIODS, most=brute_force.MOST_PERIODS, sticking=brute_force.MOST_PERIODS)
    doubtful, late = np.zeros((2, *true.shape), dtype=bool)
    odd = np.flatnonzero(np.any(said != true, axis=1))
    long = {"periods": _MOST_PERIODS, "most": _MOST_PERIODS, "sticking": _MOST_PERIODS}
    if odd.size:
        true[odd] = _truth(points[odd], **long)
        doubtful[odd] = _truth(points[odd], **long, refinement=2.0) != true[odd]
        late[odd] = _truth(points[odd], most=brute_force.PERIODS, sticking=brute_force.PERIODS) != STEADY
    return Judged(points=points, said=said, true=true, doubtful=doubtful, late=late)


def _said(point: np.ndarray) -> tuple[int, int]:
    found = verdict_outcomes(groups_of(point))
    return _NUMBERS[found.stuck], _NUMBERS[found.sliding]


def _truth(points: np.ndarray, **how) -> np.ndarray:
    """By brute force: from rest, and the worst of those that slide."""
    order = np.array([_FROM_WORST.index(outcome) for outcome in range(len(OUTCOMES))])
    sliding = np.array([order[outcomes(points, factor, **how)] for factor in SLIDING]).min(axis=0)
    return np.column_stack([outcomes(points, FROM_REST, **how), np.array(_FROM_WORST)[sliding]])


def judge_table(judged: Judged, title: str) -> None:
    """How many answers are wrong, by band of τ*."""
    errors = judged.errors()
    print(f"\n{title}")
    print(f"{'tau*':>9} {'answers':>8} " + " ".join(f"{name:>17}" for name in errors))
    for name, band in _by_band(judged.points[:, 3]):
        counts = " ".join(f"{np.count_nonzero(wrong[band]):17d}" for wrong in errors.values())
        print(f"{name:>9} {judged.said[band].size:8d} {counts}")
    called = [np.count_nonzero(judged.said == outcome) for outcome in range(len(OUTCOMES))]
    print("said: " + ", ".join(f"{name} {count}" for name, count in zip(OUTCOMES, called, strict=True)), flush=True)


def list_errors(judged: Judged) -> None:
    """Every joint of which something is wrong, to be looked at."""
    for name, wrong in judged.errors().items():
        for index, start in np.argwhere(wrong)[:_LISTED]:
            numbers = ", ".join(f"{number:.6g}" for number in judged.points[index])
            said, true = OUTCOMES[judged.said[index, start]], OUTCOMES[judged.true[index, start]]
            print(f"    {name}: from {('rest', 'sliding')[start]}, said {said}, true {true}: [{numbers}]")


def both(parts: list[Judged]) -> Judged:
    """All of them in one."""
    fields = ("points", "said", "true", "doubtful", "late")
    return Judged(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in fields})


def main() -> None:
    """Print the tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 20261122
    began = time.monotonic()
    points = random_joints(count, seed=seed).points(0.0)
    boundaries = {
        "rho_c": np.asarray(exact_critical_damping_ratio(groups_of(points))),
        "rho_steady": np.asarray(steady_damping_ratio(groups_of(points))),
    }
    print(f"{count} joints, seed {seed}; a boundary under {_LEAST_RATIO} is taken to be there, one unknown left out")
    parts = []
    for name, ratios in boundaries.items():
        print(f"{name}: under {_LEAST_RATIO}: {np.sum(ratios < _LEAST_RATIO)}, unknown: {np.sum(np.isnan(ratios))}")
        known = np.isfinite(ratios)
        for share in (0.94, 1.06):
            parts.append(judge(at(points, np.maximum(ratios, _LEAST_RATIO) * share)[known]))
            judge_table(parts[-1], f"at {share} {name}")
            list_errors(parts[-1])
            print(f"{time.monotonic() - began:.0f} s", flush=True)
    judge_table(both(parts), "all")


if __name__ == "__main__":
    main()
