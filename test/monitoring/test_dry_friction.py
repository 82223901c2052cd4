# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the dry friction depends on: what is there is found, what is not is not claimed."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import nightly
from hypothesis import example, given
from hypothesis import strategies as st
from machines import Machine, drawn, simulate
from scipy.special import stdtr

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.friction.dry_friction import LEAST_SLIPS, DryFriction, dry_friction
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

pytestmark = pytest.mark.slow

COULOMB, SPACING, SCATTER = 8.0, 0.02, 0.1
SEEDS = st.integers(0, 2**32 - 1)


def slips(
    rng: np.random.Generator, count: int, *, both: bool = False, evenly: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direction, position and time of slips one after the other, once there and back or one way."""
    direction = np.where(both & (np.arange(count) >= count // 2), -1.0, 1.0)
    steps = SPACING * (1.0 if evenly else 1.0 + 0.15 * rng.standard_normal(count))
    return direction, np.cumsum(direction * steps), 100.0 + np.cumsum(rng.uniform(0.8, 1.2, count))


def to_and_fro(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slips of three ways there and three back."""
    direction = np.where(np.arange(count) * 6 // count % 2 == 0, 1.0, -1.0)
    steps = SPACING * (1.0 + 0.15 * rng.standard_normal(count))
    return direction, np.cumsum(direction * steps), 100.0 + np.cumsum(rng.uniform(0.8, 1.2, count))


def found(kinetic: np.ndarray, *where: np.ndarray) -> DryFriction:
    """What is learnt of kinetic friction at direction, position and time."""
    dry = dry_friction(kinetic, *where)
    assert dry is not None
    return dry


@pytest.mark.parametrize(
    ("count", "evenly", "both", "draws"),
    [
        (13, False, True, 100), (13, True, False, 100),
        nightly(40, False, False, 100), nightly(40, True, True, 100),
        *(nightly(*case, 400) for case in itertools.product((13, 40), (False, True), (False, True))),
    ],
)  # fmt: skip
def test_noise_is_no_dependence(count: int, evenly: bool, both: bool, draws: int) -> None:
    """Each term is claimed of pure noise in 2 % of draws at most, even or uneven, also if its size changes."""
    claims = {"drift": 0, "ripple": 0, "load": 0, "load_dependence": 0}
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        where = slips(rng, count, both=both, evenly=evenly)
        growing = np.linspace(0.3, 2.0, count) if seed % 2 else 1.0
        dry = found(COULOMB + SCATTER * growing * rng.standard_normal(count), *where)
        for name in ("drift", "ripple", "load_dependence"):
            claims[name] += getattr(dry, name) is not None
        claims["load"] += dry.load is not None and dry.load.significance < 0.01
    assert max(claims.values()) <= 0.02 * draws, claims


@given(seed=SEEDS, amplitude=st.floats(0.3, 1.0), spacings=st.floats(3.0, 12.0), both=st.booleans())
def test_a_ripple_is_found(seed: int, amplitude: float, spacings: float, both: bool) -> None:
    rng = np.random.default_rng(seed)
    direction, position, time = slips(rng, 45, both=both)
    phase = rng.uniform(-math.pi, math.pi)
    wave = amplitude * np.sin(2.0 * math.pi * position / (spacings * SPACING) + phase)
    dry = found(COULOMB + 0.5 * direction + wave + SCATTER * rng.standard_normal(45), direction, position, time)
    assert dry.ripple is not None
    # Three errors hold 99.7 % of draws; hypothesis looks for the others.
    assert abs(dry.ripple.amplitude - amplitude) < 5.0 * dry.ripple.amplitude_std
    assert abs(dry.ripple.period - spacings * SPACING) < 6.0 * dry.ripple.period_std
    np.testing.assert_allclose(dry.ripple.at(position), wave, atol=6.0 * SCATTER)


def test_a_ripple_is_within_three_errors() -> None:
    """Of 200 draws as many as errors promise: 99.7 %, but for few."""
    inside = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        direction, position, time = slips(rng, 40)
        wave = 0.4 * np.sin(2.0 * math.pi * position / 0.11)
        ripple = found(COULOMB + wave + SCATTER * rng.standard_normal(40), direction, position, time).ripple
        assert ripple is not None
        inside += abs(ripple.amplitude - 0.4) < 3.0 * ripple.amplitude_std
    assert inside >= 195


@given(seed=SEEDS, rate=st.floats(0.02, 0.2), sign=st.sampled_from([-1.0, 1.0]), both=st.booleans())
def test_a_drift_is_found(seed: int, rate: float, sign: float, both: bool) -> None:
    """And said to be perhaps a slope over position where the motion goes one way only."""
    rng = np.random.default_rng(seed)
    direction, position, time = to_and_fro(rng, 40) if both else slips(rng, 40)
    kinetic = COULOMB + sign * rate * (time - time[0]) + SCATTER * rng.standard_normal(40)
    dry = found(kinetic, direction, position, time)
    assert dry.drift is not None
    assert abs(dry.drift.value - sign * rate) < 6.0 * dry.drift.std
    assert dry.distinguished == both


def test_drift_and_ripple_together() -> None:
    rng = np.random.default_rng(1)
    direction, position, time = to_and_fro(rng, 46)
    kinetic = COULOMB + 0.02 * (time - time.mean()) + 0.4 * np.sin(2.0 * math.pi * position / 0.1)
    dry = found(kinetic + 0.05 * rng.standard_normal(46), direction, position, time)
    assert dry.drift is not None
    assert dry.ripple is not None
    assert dry.drift.value == pytest.approx(0.02, abs=4.0 * dry.drift.std)
    assert dry.ripple.amplitude == pytest.approx(0.4, abs=4.0 * dry.ripple.amplitude_std)
    assert dry.scatter == pytest.approx(0.05, rel=0.4)
    assert dry.distinguished


def test_a_load_is_told_in_both_directions() -> None:
    rng = np.random.default_rng(2)
    direction, position, time = slips(rng, 30, both=True)
    dry = found(COULOMB + 1.5 * direction + SCATTER * rng.standard_normal(30), direction, position, time)
    assert dry.load is not None
    assert dry.load.value == pytest.approx(1.5, abs=4.0 * dry.load.std)
    assert dry.load.significance < 1e-6
    assert dry.coulomb.value == pytest.approx(COULOMB, abs=4.0 * dry.coulomb.std)
    assert found(np.full(30, COULOMB), np.ones(30), position, time).load is None


@given(seed=SEEDS, slope=st.sampled_from([0.0, 0.1, 0.3]))
def test_friction_that_grows_with_the_load(seed: int, slope: float) -> None:
    """An arm's weight changes with position; where friction follows it, the slope is found."""
    rng = np.random.default_rng(seed)
    direction, position, time = to_and_fro(rng, 48)
    load = 6.0 * np.cos(6.0 * position)
    kinetic = COULOMB + direction * load + slope * np.abs(load) + 0.02 * rng.standard_normal(48)
    dry = found(kinetic, direction, position, time)
    assert dry.drift is None
    dependence = dry.load_dependence
    if slope:
        assert dependence is not None
        assert abs(dependence.value - slope) < max(6.0 * dependence.std, 0.15 * slope)
    else:
        assert dependence is None or abs(dependence.value) < 0.05


def test_once_there_and_back_a_drift_may_be_a_load_that_varies() -> None:
    rng = np.random.default_rng(6)
    direction, position, time = slips(rng, 40, both=True)
    drifting = found(COULOMB + 0.05 * time + 0.01 * rng.standard_normal(40), direction, position, time)
    assert not drifting.distinguished
    loaded = found(COULOMB + 3.0 * direction * position + 0.01 * rng.standard_normal(40), direction, position, time)
    assert not loaded.distinguished
    assert loaded.drift is None


def test_even_slips_name_the_periods_that_they_cannot_tell_apart() -> None:
    """At distances h, a ripple of 1/P is one of 2/h − 1/P as well."""
    rng = np.random.default_rng(3)
    direction, position, time = slips(rng, 40, evenly=True)
    kinetic = COULOMB + 0.5 * np.sin(2.0 * math.pi * position / 0.013) + 0.05 * rng.standard_normal(40)
    ripple = found(kinetic, direction, position, time).ripple
    assert ripple is not None
    assert any(period == pytest.approx(0.013, rel=0.01) for period in ripple.aliases)
    assert 1.0 / ripple.period == pytest.approx(2.0 / SPACING - 1.0 / 0.013, rel=0.01)
    uneven = slips(rng, 40)
    kinetic = COULOMB + 0.5 * np.sin(2.0 * math.pi * uneven[1] / 0.1) + 0.05 * rng.standard_normal(40)
    ripple = found(kinetic, *uneven).ripple
    assert ripple is not None
    assert ripple.aliases == ()


@given(seed=SEEDS, count=st.integers(0, LEAST_SLIPS - 1), both=st.booleans())
def test_few_slips_claim_nothing_but_the_direction(seed: int, count: int, both: bool) -> None:
    rng = np.random.default_rng(seed)
    direction, position, time = slips(rng, count, both=both)
    kinetic = COULOMB + 0.5 * time + np.sin(2.0 * math.pi * position / 0.1)
    dry = dry_friction(kinetic, direction, position, time)
    assert (dry is None) == (count < 3)
    if dry is not None:
        assert dry.drift is dry.ripple is dry.load_dependence is None


def test_what_is_below_the_error_of_a_slip_is_not_claimed() -> None:
    rng = np.random.default_rng(4)
    direction, position, time = slips(rng, 40)
    kinetic = COULOMB + 1e-3 * np.sin(2.0 * math.pi * position / 0.1)
    assert found(kinetic, direction, position, time).ripple is not None
    dry = dry_friction(kinetic, direction, position, time, standard_error=0.01)
    assert dry is not None
    assert dry.ripple is None
    assert dry.scatter == 0.01


@given(seed=SEEDS, count=st.integers(3, 48), both=st.booleans())
def test_places_hold_every_slip_once(seed: int, count: int, both: bool) -> None:
    rng = np.random.default_rng(seed)
    direction, position, time = slips(rng, count, both=both)
    kinetic = COULOMB + rng.standard_normal(count)
    places = found(kinetic, direction, position, time).places
    assert sum(place.slips for place in places) == count
    assert min(place.slips for place in places) > 0
    assert sum(place.slips * place.mean for place in places) == pytest.approx(kinetic.sum())
    assert all(math.isnan(place.std) == (place.slips == 1) for place in places)


def test_slips_at_one_place_and_at_one_time() -> None:
    """Nothing to scan, nothing to divide by."""
    count = 20
    kinetic = COULOMB + SCATTER * np.random.default_rng(5).standard_normal(count)
    dry = found(kinetic, np.ones(count), np.zeros(count), np.arange(count) * 1.0)
    assert dry.ripple is None
    assert len(dry.places) == 1
    assert found(np.full(count, COULOMB), np.ones(count), np.zeros(count), np.zeros(count)).drift is None


@pytest.mark.parametrize(("count", "both"), [(3, False), (4, False), (6, True), (7, True), (10, True), (11, True)])
def test_significance_is_that_of_students_t(count: int, both: bool) -> None:
    """Of terms that are small beside their errors; two to nine degrees of freedom."""
    rng = np.random.default_rng(count)
    direction, position, time = slips(rng, count, both=both)
    dry = found(0.5 + 0.5 * direction + rng.standard_normal(count), direction, position, time)
    terms = [term for term in (dry.coulomb, dry.load) if term is not None]
    assert len(terms) == 1 + both
    for term in terms:
        expected = 2.0 * stdtr(count - len(terms), -abs(term.value) / term.std)
        assert 0.001 < expected < 0.999
        assert term.significance == pytest.approx(expected, rel=1e-9)


MACHINE = Machine(
    inertia=6.3, coulomb=8.43, viscous=4.94, stribeck=1.6, stribeck_velocity=0.0058, lag=0.05, rise_time=0.264
)


@pytest.mark.parametrize(
    "machine",
    [MACHINE, nightly(replace(MACHINE, drift=0.1 / 60.0)), nightly(replace(MACHINE, ripple=0.08, ripples=20.0))],
    ids=["as it should be", "drift", "ripple"],
)
def test_a_simulated_machine(machine: Machine) -> None:
    """From samples of an encoder to what is claimed: what the machine has, and nothing else."""
    machine, gains, rate = replace(machine, load=1.0), Gains(stiffness=630.0, damping=2.0), 250.0
    time = np.arange(round(100.0 * rate)) / rate
    velocities = np.where((time // 25.0) % 2 == 0, 0.006, -0.006)
    references = drawn(machine, gains) + np.concatenate([[0.0], np.cumsum(velocities)[:-1]]) / rate
    motion = simulate(machine, gains, references, velocities, 1.0 / rate)
    monitor = JointMonitor(None, gains, at_arrest=True)
    monitor.process(
        Batch(
            time=time,
            position=2.5e-5 * np.round(motion.position / 2.5e-5),
            effort=motion.effort,
            reference_position=references,
            reference_velocity=velocities,
        )
    )
    monitor.finish()
    monitor.learn()
    estimate = monitor.assessment().estimate
    assert estimate is not None
    dry = estimate.dry
    assert dry is not None
    assert dry.load is not None
    assert dry.load.value == pytest.approx(1.0, abs=max(4.0 * dry.load.std, 0.02))
    assert (dry.ripple is not None) == (machine.ripple > 0)
    assert (dry.drift is not None) == (machine.drift > 0)
    if dry.ripple is not None:
        assert dry.ripple.amplitude == pytest.approx(0.08 * 8.43, abs=4.0 * dry.ripple.amplitude_std)
        assert 1.0 / dry.ripple.period == pytest.approx(20.0, rel=0.05)
    if dry.drift is not None:
        assert dry.drift.value == pytest.approx(8.43 * machine.drift, rel=0.25)


def test_a_drift_is_told_as_at_the_last_slip() -> None:
    """Issue 18: at the end even the few slips that came since the last study are studied, where friction drifts."""
    machine, gains, rate = replace(MACHINE, drift=0.1 / 60.0), Gains(stiffness=630.0, damping=2.0), 250.0
    time = np.arange(round(70.0 * rate)) / rate
    velocities, references = np.full(time.shape, 0.006), drawn(machine, gains) + 0.006 * time
    motion = simulate(machine, gains, references, velocities, 1.0 / rate)
    position = 2.5e-5 * np.round(motion.position / 2.5e-5)
    batch = Batch(time=time, position=position, reference_position=references, reference_velocity=velocities)
    monitor = JointMonitor(None, gains, studies_at_once=True, at_arrest=True)
    for begin, end in ((0.0, 60.0), (60.0, 65.0), (65.0, 70.0)):
        monitor.process(batch.where((time >= begin) & (time < end)))
        monitor.finish()
        estimate = monitor.assessment().estimate
        assert estimate is not None
        assert estimate.dry is not None
        # A fifth more slips than at the last study would not have come in five seconds.
        assert estimate.dry.time.max() > end - 4.0


@given(seed=SEEDS, value=st.floats(-1e3, 1e3), both=st.booleans(), evenly=st.booleans())
@example(seed=0, value=47.375, both=False, evenly=False)  # had a drift of 1e-15
def test_values_that_are_all_the_same_have_no_ripple(seed: int, value: float, both: bool, evenly: bool) -> None:
    """What rounding leaves of them is no noise to find one in, on whatever machine."""
    direction, position, time = slips(np.random.default_rng(seed), 30, both=both, evenly=evenly)
    dry = found(np.full(30, value), direction, position, time)
    assert dry.ripple is None
    assert dry.drift is None
    assert dry.load is None or abs(dry.load.value) <= 1e-9 * abs(value) + 1e-300
