# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The dimensionless cycles: against an independent solution, and against limits with known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import nightly
from dop853_reference import POINT, TABLE, cycles
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model.dimensionless import DimensionlessGroups, dimensionless_groups
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.simulation import Cycles, simulate_cycles, simulate_trajectory


def groups(**values: object) -> DimensionlessGroups:
    """Groups with a lag and a rise of static friction, unless said otherwise."""
    defaults = {"damping_ratio": 0.05, "stribeck": 2.0, "velocity": 1.0, "lag": 0.9, "rise_time": 5.0}
    return DimensionlessGroups(natural_frequency=1.0, **{**defaults, **values})  # type: ignore[arg-type]


def table() -> tuple[DimensionlessGroups, np.ndarray]:
    """Points, and slip duration, dwell, level of their cycles, (points, cycles, 3)."""
    rows = np.loadtxt(TABLE, delimiter=",", skiprows=1)
    points, expected = rows[:, : len(POINT)], rows[:, len(POINT) :].reshape(len(rows), -1, 3)
    return groups(**dict(zip(POINT, points.T, strict=True))), expected


def columns(found: Cycles) -> np.ndarray:
    """In the table's order."""
    return np.stack([found.slip_duration, found.dwell, found.breakaway_level], axis=-1)


def test_agrees_with_an_independent_solution() -> None:
    """Issue 3: slip duration, dwell and breakaway level to 1e-6 at 240 random points, by DOP853, rtol 1e-10."""
    points, expected = table()
    found = columns(simulate_cycles(points, expected.shape[1]))
    assert len(found) >= 200
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    assert np.isfinite(expected).mean() > 0.5
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("first", "every"), [(30, 120), nightly(0, 30)])
def test_the_table_is_what_the_independent_solution_gives(first: int, every: int) -> None:
    """Issue 3: reference_cycles.csv is not stale: two of its points solved again, at night eight."""
    rows = np.loadtxt(TABLE, delimiter=",", skiprows=1)[first::every]
    for row in rows:
        expected = row[len(POINT) :].reshape(-1, 3)
        np.testing.assert_allclose(cycles(row[: len(POINT)], len(expected)), expected, rtol=1e-9)


@pytest.mark.parametrize("velocity", [0.5, 1.0])
def test_order_of_convergence(velocity: float) -> None:
    """Issue 3: halving fixed steps twice divides the error by more than 2^14: the order is seven or more."""
    point = groups(lag=1.6, velocity=velocity, damping_ratio=0.02)

    def cycle(refinement: float) -> np.ndarray:
        return columns(simulate_cycles(point, 2, tolerance=math.inf, step_refinement=refinement))[1]

    exact = cycle(8.0)
    # Steps of 1.6, 0.8 and 0.4.
    errors = [np.abs(cycle(refinement) / exact - 1).max() for refinement in (0.25, 0.5, 1.0)]
    assert errors[0] < 1e-3
    assert errors[0] > errors[1] > errors[2] > 0
    assert errors[0] / errors[2] > 2**14


def test_accuracy_follows_the_tolerance_without_lag() -> None:
    """Issue 3: where steps adapt (τ* = 0, friction rising sharply at arrest), the error is below 100 tolerances."""
    point = groups(lag=0.0, stribeck=[2.0, 10.0, 30.0], velocity=[0.5, 3.0, 1.0])
    exact = columns(simulate_cycles(point, 3, tolerance=1e-13))
    for tolerance in (1e-5, 1e-7, 1e-9):
        assert np.abs(columns(simulate_cycles(point, 3, tolerance=tolerance)) / exact - 1).max() < 100 * tolerance


@pytest.mark.parametrize("lag", [0.0, 1.0, 6.0])
@pytest.mark.parametrize("velocity", [0.01, 1.0, 50.0])
def test_without_friction_or_damping_a_circle(lag: float, velocity: float) -> None:
    """Issue 3: no Stribeck friction, no damping: slips of one natural period and 2π x˙_d/ω."""
    found = simulate_cycles(groups(damping_ratio=0.0, stribeck=0.0, velocity=velocity, lag=lag), 1)
    assert found.slip_duration[0] == pytest.approx(2 * math.pi, rel=1e-9)
    assert found.slip_distance[0] == pytest.approx(2 * math.pi * velocity, rel=1e-9)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.02, 0.05])
@pytest.mark.parametrize("ratio", [1.5, 2.0, 4.0])
def test_friction_that_drops_at_once(ratio: float, damping_ratio: float) -> None:
    """Issue 3: for ξ˙_d → ∞ without lag friction is Coulomb's alone, and the slip is Derjaguin's damped sine."""
    velocity = np.array([20.0, 600.0])
    found = simulate_cycles(
        groups(damping_ratio=damping_ratio, stribeck=ratio * velocity, velocity=velocity, lag=0.0), 1
    )
    error = np.abs(found.slip_duration[:, 0] / _derjaguin_duration(ratio, damping_ratio) - 1)
    assert error[1] < min(0.005, error[0])


def _derjaguin_duration(ratio: float, damping_ratio: float) -> float:
    """First return to rest of a joint released at a force ``ratio`` (times M ω x˙_d) above kinetic friction."""
    frequency = math.sqrt(1 - damping_ratio**2)
    if damping_ratio == 0:
        return 2 * (math.pi - math.atan(ratio))
    times = np.linspace(0.5, 2 * math.pi / frequency, 200_001)
    sine, cosine = np.sin(frequency * times), np.cos(frequency * times)
    velocity = 1 - np.exp(-damping_ratio * times) * (cosine + (damping_ratio - ratio) / frequency * sine)
    assert velocity.min() < 0 < velocity[0]
    return float(times[np.argmax(velocity <= 0)])


def test_short_lags_tend_to_none() -> None:
    """Issue 3: τ* → 0, through the two ways of stepping, is τ* = 0."""
    lags = np.array([0.0, 1e-6, 1e-4, 1e-3, 1e-2])
    found = columns(simulate_cycles(groups(lag=lags), 3))
    change = np.abs(found[1:] / found[0] - 1).max(axis=(1, 2))
    assert (change < 20 * lags[1:]).all()


def test_lags_on_either_side_of_the_step_agree() -> None:
    """Issue 3: where the lag passes from inside a step to a whole number of steps nothing jumps."""
    lags = np.linspace(0.05, 0.09, 81)
    found = columns(simulate_cycles(groups(lag=lags), 3))
    smooth = np.polynomial.Polynomial.fit(lags, found.reshape(81, -1)[:, 3], 6)(lags)
    assert np.abs(found.reshape(81, -1)[:, 3] / smooth - 1).max() < 1e-7


def test_static_friction_that_rises_at_once_or_never() -> None:
    """Issue 3: γ* → 0 gives full static friction every time, γ* → ∞ leaves the level of the arrest."""
    at_once = simulate_cycles(groups(rise_time=[0.0, 1e-9]), 4)
    np.testing.assert_allclose(at_once.breakaway_level, 2.0, rtol=1e-8)
    never = simulate_cycles(groups(rise_time=[math.inf, 1e12]), 2)
    np.testing.assert_allclose(never.breakaway_level[:, 1], never.arrest_level[:, 0], rtol=1e-9)
    np.testing.assert_allclose(never.breakaway_level[0], never.breakaway_level[1], rtol=1e-9)


@given(
    st.floats(0.001, 1.0), st.floats(0.05, 20.0), st.floats(0.03, 10.0),
    st.sampled_from([0.0, 0.01, 0.3, 1.0, 3.0]), st.floats(0.05, 30.0),
)  # fmt: skip
def test_what_holds_of_every_cycle(
    damping_ratio: float, stribeck: float, velocity: float, lag: float, rise_time: float
) -> None:
    """Issue 3: levels stay between 0 and F*_s∞, Eq. (6) and the force balance at breakaway hold, the way adds up."""
    point = groups(damping_ratio=damping_ratio, stribeck=stribeck, velocity=velocity, lag=lag, rise_time=rise_time)
    found = simulate_cycles(point, 4)
    for n in range(4):
        if math.isnan(found.slip_duration[n]):
            break
        assert 0 <= found.arrest_level[n] <= found.breakaway_level[n] <= stribeck * (1 + 1e-12)
        assert found.dwell[n] >= 0
        if n == 3:
            break
        level = found.arrest_level[n] + (stribeck - found.arrest_level[n]) * found.dwell[n] / (
            found.dwell[n] + rise_time
        )
        if math.isfinite(found.breakaway_level[n + 1]):
            assert found.breakaway_level[n + 1] == pytest.approx(level, rel=1e-9)
            # Both breakaways lie on ξ = 2ρξ˙_d − F*_s,b.
            way = found.slip_distance[n] - velocity * (found.slip_duration[n] + found.dwell[n])
            assert way == pytest.approx(found.breakaway_level[n] - found.breakaway_level[n + 1], abs=1e-6 * stribeck)


def test_many_points_are_as_one_by_one(puma: Joint) -> None:
    """Issue 3: thousands of points in a call give what each gives alone."""
    generator = np.random.default_rng(3)
    stiffness = 6.3 * generator.uniform(20.0, 1000.0, (50, 40))
    velocity = 0.0058 * generator.uniform(0.05, 3.0, (50, 40))
    point = dimensionless_groups(puma, Gains(stiffness=stiffness), velocity)
    together = simulate_cycles(point, 5)
    assert together.dwell.shape == (50, 40, 5)
    one = simulate_cycles(dimensionless_groups(puma, Gains(stiffness=stiffness[7, 9]), velocity[7, 9]), 5)
    np.testing.assert_array_equal(together.dwell[7, 9], one.dwell)


def test_both_simulations_agree(puma: Joint) -> None:
    """Issue 3: the cycles in SI units, from another integrator, are these."""
    gains, velocity = Gains(stiffness=2016.0, damping=10.0), 0.00493
    point = dimensionless_groups(puma, gains, velocity)
    cycles_found = simulate_cycles(point, 6)
    references = velocity * 1e-3 * np.arange(12_000)
    events = simulate(puma, gains, references, np.full(12_000, velocity)).events
    durations = [arrest.time - leave.time for leave, arrest in zip(events[::2], events[1::2], strict=False)][:6]
    levels = [event.stribeck_level for event in events[::2]][:6]
    np.testing.assert_allclose(durations, cycles_found.slip_duration / point.natural_frequency, rtol=1e-5)
    unit = 6.3 * float(point.natural_frequency) * 0.0058
    np.testing.assert_allclose(levels, cycles_found.breakaway_level * unit, rtol=1e-5)


def test_trajectory_is_the_motion_of_the_cycles() -> None:
    """Issue 3: the trajectory starts and ends each slip at rest where the summaries say, and never goes back."""
    motion = simulate_trajectory(groups(), 4)
    summaries = simulate_cycles(groups(), 4)
    np.testing.assert_allclose(motion.cycles.slip_duration, summaries.slip_duration, rtol=1e-8)
    assert motion.time[-1] == pytest.approx(summaries.slip_duration.sum() + summaries.dwell[:-1].sum(), rel=1e-8)
    assert (motion.velocity >= -1e-9).all()
    # Moving with the velocity, the position relative to steady motion changes by the excess.
    excess = np.diff(motion.position) - 0.5 * np.diff(motion.time) * (motion.velocity[1:] + motion.velocity[:-1] - 2.0)
    assert np.abs(excess).max() < 1e-3
    assert ((motion.shape >= 0) & (motion.shape <= 1 + 1e-9)).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [("velocity", 0.0), ("damping_ratio", -0.1), ("lag", math.nan), ("stribeck", math.inf), ("rise_time", math.nan)],
)
def test_bad_points_are_refused_by_name(field: str, value: float) -> None:
    """Issue 3: what makes no joint is refused with its name."""
    with pytest.raises(InvalidParameterError, match=f"'{field}'"):
        simulate_cycles(groups(**{field: value}), 1)
    with pytest.raises(InvalidParameterError, match="'level'"):
        simulate_cycles(groups(), 1, level=-1.0)
