# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Random joints, and how often the exact verdict is right about them by brute force.

``python test/model/random_points.py`` prints the tables (minutes on one core).
"""

from __future__ import annotations

import itertools
import sys
import time
from dataclasses import dataclass

import brute_force
import numpy as np
from brute_force import FROM_REST, OUTCOMES, STEADY, STICKS, motion, outcomes

from stickslip_ros.model.dimensionless import DimensionlessGroups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.steady_sliding import sliding_damping_ratio

LAG_BANDS = (0.0, 1.0, 2.0, 3.1, 4.0, 5.0, 2 * np.pi)
STARTS = (FROM_REST, 2.0, 3.0, 10.0)
_LONGEST_LAG = 2 * np.pi
_LISTED = 25
_LEAST_RATIO = 0.01  # in the place of a critical damping ratio of zero


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
    """The kernel's form of rows of brute_force.POINT."""
    columns = dict(zip(brute_force.POINT, points.T, strict=True))
    return DimensionlessGroups(natural_frequency=1.0, **columns)


def sliding_ratios(points: np.ndarray) -> np.ndarray:
    """Damping ratio from which on steady sliding is stable, for each row."""
    return np.array([sliding_damping_ratio(groups_of(row)) for row in points])


def at(points: np.ndarray, damping_ratios) -> np.ndarray:
    """The rows at other damping ratios."""
    changed = points.copy()
    changed[:, 0] = damping_ratios
    return changed


def _by_band(lags: np.ndarray) -> list[tuple[str, np.ndarray]]:
    pairs = itertools.pairwise(LAG_BANDS)
    bands = [(f"{low:.1f}-{high:.1f}", (lags >= low) & (lags < high)) for low, high in pairs]
    return [*bands, ("all", np.ones(len(lags), dtype=bool))]


def _tally(found: np.ndarray) -> str:
    return "/".join(f"{np.count_nonzero(found == outcome)}" for outcome in range(len(OUTCOMES)))


def verdict_table(points: np.ndarray, exact: np.ndarray) -> None:
    """How often the exact verdict is wrong at 0.94 and 1.06 times its own boundary, by band of τ*."""
    print("verdict of the kernel against brute force from rest, at 0.94 and 1.06 rho_c; s/w/t/u are counts of")
    print("sticks/swings/steady/undecided. wrong smooth: smooth but sticks; wrong sticks: sticks but does not")
    print(
        f"{'tau*':>9} {'n':>5} {'smooth':>7} {'s/w/t/u':>18} {'wrong':>7}   {'sticks':>6} {'s/w/t/u':>18} {'wrong':>7}"
    )
    rows = np.concatenate([at(points, np.where(exact > 0, exact, _LEAST_RATIO) * share) for share in (0.94, 1.06)])
    persists = np.asarray(cycle_persists(groups_of(rows)))
    found = outcomes(rows)
    for name, band in _by_band(rows[:, 3]):
        smooth, sticks = band & (persists == 0.0), band & (persists == 1.0)
        wrong_smooth = np.mean(found[smooth] == STICKS) if smooth.any() else np.nan
        wrong_sticks = np.mean(found[sticks] != STICKS) if sticks.any() else np.nan
        print(
            f"{name:>9} {band.sum():5d} {smooth.sum():7d} {_tally(found[smooth]):>18} {wrong_smooth:7.2%}   "
            f"{sticks.sum():6d} {_tally(found[sticks]):>18} {wrong_sticks:7.2%}"
        )


def starts_table(points: np.ndarray, ratios: np.ndarray, title: str) -> None:
    """How often a joint is steady from one start and not from another."""
    print(f"\n{title}: what becomes of it, by start (0: from rest), and pairs of starts")
    for share in (0.94, 1.06, 1.2):
        rows = at(points, share * ratios)
        found = {factor: outcomes(rows, factor) for factor in STARTS}
        print(f"  at {share}: " + ", ".join(f"{factor:g}: {_tally(found[factor])}" for factor in STARTS))
        steady = {factor: found[factor] == STEADY for factor in STARTS}
        for factor in STARTS[1:]:
            better = np.count_nonzero(steady[FROM_REST] & ~steady[factor])
            worse = np.count_nonzero(~steady[FROM_REST] & steady[factor])
            print(f"    steady from rest, not from {factor:g}: {better}; the reverse: {worse}")
        rest_2_3 = steady[FROM_REST] & steady[2.0] & steady[3.0]
        only = np.count_nonzero(rest_2_3 & ~steady[10.0])
        print(f"    steady from rest, 2 and 3, not from 10: {only} of {len(rows)}")
        print(f"    steady from 10, not from rest, 2 or 3: {np.count_nonzero(~rest_2_3 & steady[10.0])}", flush=True)


def boundary_table(points: np.ndarray, ratios: np.ndarray) -> None:
    """How many joints are not steady above the boundary, by band of τ* and start."""
    print("\nnot steady above the larger of rho_c and the sliding ratio, by start (of them sticking)")
    print(f"{'tau*':>9} {'n':>5} " + " ".join(f"{f'{share} from {f:g}':>12}" for share in (1.06, 1.2) for f in STARTS))
    found = [outcomes(at(points, share * ratios), factor) for share in (1.06, 1.2) for factor in STARTS]
    for name, band in _by_band(points[:, 3]):
        counts = [f"{np.sum(one[band] != STEADY)} ({np.sum(one[band] == STICKS)})" for one in found]
        print(f"{name:>9} {band.sum():5d} " + " ".join(f"{count:>12}" for count in counts))


def scan_table(points: np.ndarray, ratios: np.ndarray, factor: float) -> None:
    """How often more damping is worse again: 40 damping ratios from 0.02 to three times the boundary."""
    patterns, last = [], np.zeros(len(points))
    for index, (point, ratio) in enumerate(zip(points, ratios, strict=True)):
        scan = np.geomspace(0.02, max(3.0 * ratio, 0.06), 40)
        found = outcomes(
            at(np.repeat(point[np.newaxis], len(scan), axis=0), scan), factor, sticking=brute_force.PERIODS
        )
        patterns.append("".join("swt?"[outcome] for outcome in found))
        last[index] = np.max(scan[found != STEADY], initial=0.0) / ratio
    worse = np.array(["t" in pattern and pattern.rstrip("t").find("t") >= 0 for pattern in patterns])
    sticks_again = np.array(["s" in pattern.lstrip("s") for pattern in patterns])
    print(
        f"\nscan of rho, 40 values from 0.02 to 3 rho_b (the larger of rho_c and the sliding ratio), start {factor:g}"
    )
    print("worse: steady, and not at more damping; again: sticks, does not, sticks at more damping; last: largest rho")
    print("that is not steady, as a share of rho_b (steps of up to 1.2): median, 95 %, most, share above 1.06")
    print(f"{'tau*':>9} {'n':>5} {'worse':>6} {'again':>6} {'median':>7} {'95 %':>6} {'most':>6} {'> 1.06':>7}")
    for name, band in _by_band(points[:, 3]):
        if band.any():
            of_band = last[band]
            print(
                f"{name:>9} {band.sum():5d} {worse[band].sum():6d} {sticks_again[band].sum():6d} "
                f"{np.median(of_band):7.2f} {np.quantile(of_band, 0.95):6.2f} {of_band.max():6.2f} "
                f"{np.mean(of_band > 1.06):7.1%}"
            )
    odd = np.flatnonzero(worse | sticks_again)
    for index in odd[:_LISTED]:
        numbers = " ".join(f"{number:.3g}" for number in points[index, 1:])
        print(f"    {patterns[index]}  F*, velocity, lag, rise time: {numbers}; rho_b {ratios[index]:.3g}")


def settled_table(points: np.ndarray, ratios: np.ndarray, share: float) -> None:
    """After how many periods the outcome is that of 4800."""
    counts = [40, 80, 160, 300, 600, 1200, 2400]
    agree = {factor: np.zeros(len(counts)) for factor in (FROM_REST, 3.0)}
    last = {factor: [] for factor in agree}
    for factor in agree:
        for row in at(points, share * ratios):
            found = motion(row, factor, periods=4800)
            final = found.outcome()
            agree[factor] += [found.outcome(count) == final for count in counts]
            if final != STICKS:
                last[factor].append(0.0 if np.isnan(found.last_arrest) else found.last_arrest)
    print(f"\nat {share}: share of joints whose class after so many periods is that after 4800")
    for factor, numbers in agree.items():
        print(
            f"  start {factor:g}: "
            + ", ".join(f"{n}: {x / len(points):.1%}" for n, x in zip(counts, numbers, strict=True))
        )
        if last[factor]:
            print(
                f"    last arrest of those that do not stick, 50/95/99/100 %: "
                f"{np.quantile(last[factor], [0.5, 0.95, 0.99, 1.0]).round(1)} periods"
            )


def main() -> None:
    """Print the tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    began = time.monotonic()
    points = random_joints(count, seed=20261122).points(0.0)
    exact = np.asarray(exact_critical_damping_ratio(groups_of(points)))
    sliding = sliding_ratios(points)
    print(
        f"{count} joints; rho_c zero: {np.sum(exact == 0)}, refused: {np.sum(np.isnan(exact))}; "
        f"sliding ratio above rho_c: {np.sum(sliding > exact)}"
    )
    known = np.isfinite(exact)
    points, exact, sliding = points[known], exact[known], sliding[known]
    verdict_table(points, exact)
    print(f"{time.monotonic() - began:.0f} s", flush=True)
    both = np.maximum(np.maximum(exact, sliding), _LEAST_RATIO)
    starts_table(points, both, "rho at the larger of rho_c and the sliding ratio")
    boundary_table(points, both)
    print(f"{time.monotonic() - began:.0f} s", flush=True)
    if "--short" in sys.argv:
        return
    settled_table(points[:300], both[:300], 1.06)
    print(f"{time.monotonic() - began:.0f} s", flush=True)
    for factor in (FROM_REST, 3.0):
        scan_table(points[:200], both[:200], factor)
        print(f"{time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
