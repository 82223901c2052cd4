# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The friction law has one place, and a joint may have another law than the paper's."""

from __future__ import annotations

import math
from dataclasses import replace

import dop853_reference
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from stickslip_ros.compilation import source_files
from stickslip_ros.errors import InvalidParameterError
from stickslip_ros.model import _friction_law as friction_law
from stickslip_ros.model._friction_law import LAWS, PAPERS_LAW
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.controlled import controlled_course
from stickslip_ros.model.dimensionless import DimensionlessGroups, damping_for_ratio, dimensionless_groups
from stickslip_ros.model.exact import cycle_persists, exact_critical_damping_ratio
from stickslip_ros.model.extinction import critical_damping_ratio, energy_margin
from stickslip_ros.model.extinction_map import extinction_map
from stickslip_ros.model.friction import Friction, Gains, Joint, steady_friction, stribeck_shape
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.model.margin import lowest_smooth_velocity, stability_margin
from stickslip_ros.model.outcome import Outcome
from stickslip_ros.model.simulation import simulate_cycles
from stickslip_ros.model.steady_sliding import sliding_damping_ratio
from stickslip_ros.model.verdict import verdict

LAW = st.sampled_from(sorted(LAWS.values()))
OTHERS = sorted(set(LAWS) - {PAPERS_LAW})
LEVEL, SPEED = st.floats(1e-3, 1e3), st.floats(-8.0, 8.0)
TIME = st.floats(1e-3, 1e3)
STEP = 1e-5


def of_law(puma: Joint, law: str) -> Joint:
    """The paper's joint as if of another law."""
    return replace(puma, friction=replace(puma.friction, law=law))


def exponential(speed: float) -> float:
    """Ψ of the exponential law, written here once more."""
    return math.exp(-(speed**2))


compiled_friction = njit(error_model="numpy")(friction_law.stribeck_friction)
compiled_level = njit(error_model="numpy")(friction_law.risen_level)


@settings(deadline=None)  # the first example compiles
@given(LAW, LEVEL, SPEED)
def test_compiled_and_through_numpy_the_law_is_the_same(law: int, level: float, speed: float) -> None:
    """One formula: of floats, of arrays, and in compiled code."""
    expected = pytest.approx(friction_law.stribeck_friction(law, level, speed), rel=1e-14, abs=1e-300)
    assert compiled_friction(law, level, speed) == expected
    assert compiled_friction(float(law), level, speed) == expected
    assert friction_law.stribeck_friction(law, level, np.array([speed]))[0] == expected


@settings(deadline=None)
@given(LEVEL, LEVEL, st.one_of(st.just(0.0), TIME), st.one_of(st.just(0.0), st.just(math.inf), TIME))
def test_compiled_and_through_numpy_static_friction_rises_the_same(
    level: float, stribeck: float, dwell: float, rise_time: float
) -> None:
    """Eq. (6) with its limits: no dwell, no rise time, none of both, no end of it."""
    expected = pytest.approx(friction_law.risen_level(level, stribeck, dwell, rise_time), rel=1e-14)
    assert compiled_level(level, stribeck, dwell, rise_time) == expected
    assert friction_law.risen_level(level, stribeck, np.array([dwell]), np.array([rise_time]))[0] == expected
    if rise_time == 0.0:
        assert stribeck == expected
    elif dwell == 0.0 or math.isinf(rise_time):
        assert level == expected


@given(st.sampled_from(sorted(LAWS)), SPEED)
def test_every_law_falls_from_one_on_both_sides(law: str, speed: float) -> None:
    """What makes a shape a Stribeck curve: 1 at rest, even, falling, never below 0."""
    assert stribeck_shape(0.0, 0.1, law) == 1.0
    shape = float(stribeck_shape(speed, 1.0, law))
    assert shape == stribeck_shape(-speed, 1.0, law)
    assert 0.0 <= stribeck_shape(1.01 * speed, 1.0, law) <= shape <= 1.0


@given(LAW, LEVEL, SPEED)
def test_slope_is_that_of_the_friction(law: int, level: float, speed: float) -> None:
    """Central differences."""
    ahead, behind = (friction_law.stribeck_friction(law, level, speed + step) for step in (STEP, -STEP))
    expected = (ahead - behind) / (2.0 * STEP)
    assert friction_law.stribeck_slope(law, level, speed) == pytest.approx(expected, rel=1e-5, abs=1e-8 * level)


@given(LAW, SPEED)
def test_what_has_fallen_is_the_rest(law: int, speed: float) -> None:
    """1 − Ψ; near rest, where that loses digits, v²."""
    whole = friction_law.stribeck_friction(law, 1.0, speed)
    assert friction_law.fallen_share(law, speed) == pytest.approx(1.0 - whole, abs=1e-15)
    assert friction_law.fallen_share(law, 1e-9) == pytest.approx(1e-18, rel=1e-12)


@given(TIME, TIME)
def test_rising_rate_is_the_slope_of_the_rise(dwell: float, rise_time: float) -> None:
    """Central differences, by the dwell and by the logarithm of the rise time."""
    rate = friction_law.rising_rate(dwell, rise_time)

    def share(by_dwell: float, by_rise: float) -> float:
        return friction_law.risen_level(0.0, 1.0, dwell * (1.0 + by_dwell), rise_time * (1.0 + by_rise))

    by_dwell = (share(STEP, 0.0) - share(-STEP, 0.0)) / (2.0 * STEP * dwell)
    by_rise = (share(0.0, STEP) - share(0.0, -STEP)) / (2.0 * STEP)
    assert rate == pytest.approx(by_dwell, rel=1e-4, abs=1e-9 / dwell)
    assert -dwell * rate == pytest.approx(by_rise, rel=1e-4, abs=1e-9)


@given(LEVEL, st.floats(0.0, 1.0), TIME, TIME, st.one_of(st.just(math.inf), TIME))
def test_after_the_dwell_force_and_level_meet(
    stribeck: float, remains: float, deficit: float, rate: float, rise_time: float
) -> None:
    """The quadratic equation is that of Eq. (6)."""
    level = remains * stribeck
    dwell = friction_law.dwell_until_met(-deficit, stribeck - level, rate, rise_time)
    assert dwell >= 0.0
    risen = friction_law.risen_level(level, stribeck, dwell, rise_time)
    assert level - deficit + rate * dwell == pytest.approx(risen, rel=1e-9, abs=1e-9 * (deficit + stribeck))


def test_an_unknown_law_is_refused() -> None:
    """The message has the laws that are known."""
    with pytest.raises(InvalidParameterError, match="'law' must be one of hess_soom, exponential: gaussian"):
        Friction(stribeck=1.0, stribeck_velocity=0.1, law="gaussian")


def test_what_is_compiled_depends_on_the_law() -> None:
    """The law's file is no kernel itself; a change of it compiles the kernels anew all the same."""
    assert "_friction_law.py" in {path.name for path in source_files()}


@pytest.mark.parametrize("law", OTHERS)
def test_the_law_reaches_whatever_depends_on_it(puma: Joint, law: str) -> None:
    """No part goes on by the paper's law: every answer is another one."""
    joints = puma, of_law(puma, law)
    gains, velocity = Gains(stiffness=2016.0, damping=5.0), 0.00493
    groups = [dimensionless_groups(joint, gains, velocity) for joint in joints]
    for lag in (0.0, 0.01, float(groups[0].lag)):
        cycles = [simulate_cycles(replace(one, lag=lag), 2).slip_duration for one in groups]
        assert not np.allclose(*cycles, rtol=1e-3)
    for answers in (
        [steady_friction(joint.friction, 0.01) for joint in joints],
        [exact_critical_damping_ratio(one) for one in groups],
        [sliding_damping_ratio(one) for one in groups],
        [verdict(joint, gains, velocity).lowest_smooth_velocity for joint in joints],
        [verdict(joint, gains, velocity).least_smooth_stiffness for joint in joints],
    ):
        assert answers[0] != pytest.approx(answers[1], rel=1e-3)
    references = velocity * 1e-3 * np.arange(3000)
    motions = [simulate(joint, gains, references, np.full(3000, velocity)).position for joint in joints]
    assert np.abs(motions[0] - motions[1]).max() > 1e-5


@pytest.mark.parametrize("law", OTHERS)
def test_eq_43_is_not_of_another_law(puma: Joint, law: str) -> None:
    """No number, and a reason in words; scalars and arrays."""
    joint, gains = of_law(puma, law), Gains(stiffness=2016.0)
    margin = stability_margin(joint, gains, 0.00493)
    assert not margin.applicable
    assert margin.reason == (
        f"not applicable, because it is of the paper's friction law (hess_soom), and this joint's is {law}"
    )
    assert math.isnan(margin.energy_margin)
    several = stability_margin(joint, gains, np.array([0.001, 0.1]))
    assert not np.any(several.applicable)
    assert np.isnan(several.critical_damping_ratio).all()
    assert math.isnan(lowest_smooth_velocity(joint, gains))
    groups = dimensionless_groups(joint, gains, 0.00493)
    assert math.isnan(critical_damping_ratio(groups))
    assert math.isnan(energy_margin(groups))
    found = extinction_map(joint, np.array([0.002, 0.02]), np.array([1000.0, 3000.0]))
    assert np.isnan(found.paper_damping).all()
    assert np.isfinite(found.exact_damping).all()


@pytest.mark.parametrize("row", [(0.02, 4.0, 0.8, 0.9, 5.0), (0.1, 1.5, 0.3, 0.0, 2.0), (0.3, 8.0, 2.0, 0.05, 1.0)])
def test_cycles_of_the_exponential_law_are_those_of_another_integrator(row: tuple[float, ...]) -> None:
    """DOP853 by the method of steps: long lag, none, and one shorter than a step."""
    point = np.array(row)
    expected = dop853_reference.cycles(point, 2, falls=exponential)
    groups = DimensionlessGroups(
        natural_frequency=1.0, law="exponential", **dict(zip(dop853_reference.POINT, row, strict=True))
    )
    found = simulate_cycles(groups, 2)
    columns = np.stack([found.slip_duration, found.dwell, found.breakaway_level], axis=-1)
    assert np.isfinite(expected).all()
    assert columns == pytest.approx(expected, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [0.4, 1.0, 2.0])
def test_the_exponential_boundary_is_that_of_another_integrator(velocity: float) -> None:
    """A tenth more damping than the critical one ends the cycle, a tenth less does not; by DOP853."""
    point = {"stribeck": 4.0, "velocity": velocity, "lag": 0.9, "rise_time": 5.0}
    groups = DimensionlessGroups(natural_frequency=1.0, damping_ratio=0.0, law="exponential", **point)
    critical = float(exact_critical_damping_ratio(groups))
    assert critical > 0.01
    for factor, persists in ((0.9, True), (1.1, False)):
        row = np.array([factor * critical, *point.values()])
        levels = dop853_reference.cycles(row, 30, 1e-8, exponential)[:, 2]
        assert bool(np.isfinite(levels[-1])) is persists


def test_two_integrations_agree_on_the_boundary_of_every_law() -> None:
    """The dimensionless slip, exact in its steps, and the joint in SI units, by Runge and Kutta's."""
    generator = np.random.default_rng(12)
    for number in range(24):
        friction = Friction(
            stribeck=10 ** generator.uniform(-0.3, 0.8),
            stribeck_velocity=10 ** generator.uniform(-2.5, -1.5),
            lag=generator.uniform(0.002, 0.02),
            rise_time=10 ** generator.uniform(-1.0, 0.5),
            law=sorted(LAWS)[number % len(LAWS)],
        )
        joint = Joint(inertia=1.0, friction=friction)
        stiffness = 10 ** generator.uniform(2.0, 3.5)
        velocity = float(friction.stribeck_velocity) * 10 ** generator.uniform(-0.5, 0.5)
        critical = float(
            exact_critical_damping_ratio(dimensionless_groups(joint, Gains(stiffness=stiffness), velocity))
        )
        if not critical > 0.02:
            continue
        for factor, persists in ((0.85, 1.0), (1.15, 0.0)):
            damping = float(damping_for_ratio(joint, stiffness, factor * critical))
            gains = Gains(stiffness=stiffness, damping=damping)
            assert cycle_persists(dimensionless_groups(joint, gains, velocity)) == persists
            course = controlled_course(joint, gains, velocity, OperatingConditions(), to_the_end=False)
            assert (course is Outcome.STICKS) == bool(persists)
