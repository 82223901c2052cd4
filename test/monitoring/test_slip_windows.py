# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The simulation of slips in their windows, against the general one of a joint."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import nightly
from random_joints import cut_slips

from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction.estimation import estimate_friction
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, slip_window
from stickslip_ros.monitoring.samples import Batch

INERTIA, STIFFNESS, STRIBECK_VELOCITY = 2.0, 200.0, 0.01


@pytest.mark.parametrize(
    ("law", "damping", "lag", "force", "speed"),
    [
        ("hess_soom", 0.0, 0.05, 8.0, 1.2), ("hess_soom", 2.0, 0.3, 4.0, 0.7),
        nightly("exponential", 0.0, 1.0, 8.0, 1.2), nightly("exponential", 2.0, 1.0, 4.0, 0.7),
    ],
)  # fmt: skip
def test_a_slip_is_that_of_the_whole_motion(law: str, damping: float, lag: float, force: float, speed: float) -> None:
    """Positions are within 1e-4 of a slip's way of those of the general simulation, whatever the friction and its law:
    an encoder of such a resolution sees no difference. The lag is in units of 1/omega, the speed of the Stribeck
    velocity.
    """
    frequency, rate = math.sqrt(STIFFNESS / INERTIA), 1000.0
    unit = INERTIA * frequency * STRIBECK_VELOCITY
    friction = Friction(
        stribeck=force * unit, stribeck_velocity=STRIBECK_VELOCITY, lag=lag / frequency, rise_time=0.3,
        viscous=0.1 * INERTIA * frequency, coulomb=5.0, law=law,
    )  # fmt: skip
    gains = Gains(stiffness=STIFFNESS, damping=damping)
    velocities = speed * STRIBECK_VELOCITY * np.repeat([1.0, 2.0], round(8.0 * rate))
    begin = (friction.coulomb + 0.3 * friction.stribeck) / STIFFNESS
    references = begin + np.append(0.0, np.cumsum(velocities)[:-1]) / rate
    motion = simulate(Joint(inertia=INERTIA, friction=friction), gains, references, velocities)
    resolution = 3e-4 * force * STRIBECK_VELOCITY / frequency
    batch = Batch(
        time=motion.time, position=resolution * np.round(motion.position / resolution),
        reference_position=references + velocities / rate, reference_velocity=velocities,
    )  # fmt: skip
    windows, _ = cut_slips(batch, gains)
    assert resolution < 3e-4 * min(window.slip_distance for window in windows)
    estimate = estimate_friction(windows)
    assert estimate is not None
    assert estimate.law == law
    assert estimate.left_over == 0.0
    assert estimate.mean_square < 1.1
    for name in ("inertia", "viscous", "stribeck", "stribeck_velocity", "lag", "rise_time"):
        truth = INERTIA if name == "inertia" else float(getattr(friction, name))
        assert abs(estimate[name].value - truth) < 4.0 * estimate[name].std, name
    assert estimate["inertia"].value == pytest.approx(INERTIA, rel=2e-3)
    assert estimate["stribeck"].value == pytest.approx(friction.stribeck, rel=0.01)


def test_an_effort_that_bends_is_smoothed_to_what_it_is() -> None:
    """The mean of some samples of a cosine is less than the cosine: inertia learnt by the effort was 0.2 % off."""
    times = np.arange(600) / 1000.0
    inside = (times >= 0.2) & (times < 0.4)
    way = np.where(times < 0.2, 0.0, np.where(inside, 0.5 - 0.5 * np.cos(math.pi * (times - 0.2) / 0.2), 1.0))
    effort = 3.0 - 2.0 * way
    nothing = np.full(len(times), math.nan)
    samples = Batch(
        time=times, position=np.round(500.0 * way) / 500.0, effort=effort,
        reference_position=nothing, reference_velocity=nothing,
    )  # fmt: skip
    cycle = Cycle(breakaway=0.2, arrest=0.4, dwell=0.2, slip_distance=1.0, position=0.0, effort=3.0)
    window = slip_window(samples, cycle, None, resolution=1.0 / 500.0, noise=0.0)
    assert window is not None
    assert window.source is ForceSource.EFFORT
    middle = (window.times > 0.25) & (window.times < 0.35)
    # Rounding apart, a mean over a slip's 24th is off by 0.0014 at most.
    np.testing.assert_allclose(
        window.forces[middle], np.interp(window.times[middle], times, effort), rtol=0.0, atol=1e-4
    )


def test_a_joint_that_is_seen_to_stand_nowhere() -> None:
    """Two samples far apart lie on either side of their median: the mean of none was asked for."""
    times = np.concatenate([np.arange(0.0, 0.06, 0.001), [0.1, 0.15], np.arange(0.195, 0.6, 0.001)])
    way = 0.5 - 0.5 * np.cos(math.pi * np.clip((times - 0.2) / 0.2, 0.0, 1.0))
    way[times == 0.15] = 0.1
    nothing = np.full(len(times), math.nan)
    samples = Batch(
        time=times, position=np.round(500.0 * way) / 500.0, effort=3.0 - 2.0 * way,
        reference_position=nothing, reference_velocity=nothing,
    )  # fmt: skip
    cycle = Cycle(breakaway=0.2, arrest=0.4, dwell=0.2, slip_distance=1.0, position=0.0, effort=3.0)
    window = slip_window(samples, cycle, None, resolution=1.0 / 500.0, noise=0.0)
    assert window is not None
    assert window.before is None
    assert window.after is not None


@pytest.mark.parametrize(("change", "fitted"), [(0.313, True), (0.05, True), (0.2005, False)])
def test_a_step_of_the_references_speed_is_where_it_is(change: float, fitted: bool) -> None:
    """Smeared between the observations beside it, such a step put positions up to 0.4 % of a slip off. What a step that
    sets a slip off adds to its force is not known, for the breakaway is not known to a sample.
    """
    times = np.arange(700) / 1000.0
    way = 0.5 - 0.5 * np.cos(math.pi * np.clip((times - 0.2) / 0.2, 0.0, 1.0))
    reference = 0.3 * times + 0.5 * np.maximum(times - change, 0.0)
    samples = Batch(
        time=times, position=np.round(50.0 * way) / 50.0,
        reference_position=reference, reference_velocity=np.gradient(reference, times),
    )  # fmt: skip
    cycle = Cycle(breakaway=0.2, arrest=0.4, dwell=0.2, slip_distance=1.0, position=0.0, effort=math.nan)
    window = slip_window(samples, cycle, Gains(stiffness=10.0, damping=1.0), resolution=1.0 / 50.0, noise=0.0)
    assert (window is not None) == fitted
    if window is not None:
        within = (times >= window.times[0]) & (times <= window.times[-1])
        between = np.interp(times[within], window.times, window.references)
        np.testing.assert_allclose(between, reference[within], rtol=0.0, atol=1e-4 * 0.001)
