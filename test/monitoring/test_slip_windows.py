# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The simulation of slips in their windows, against the general one of a joint."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_ros.model import _joint_kernel as joint_kernel
from stickslip_ros.model import _plant_state as at
from stickslip_ros.model._friction_law import EXPONENTIAL, HESS_SOOM
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.detection.cycles import Cycle
from stickslip_ros.monitoring.friction import _window_kernel as kernel
from stickslip_ros.monitoring.friction.contact_knowledge import ContactKnowledge
from stickslip_ros.monitoring.friction.slip_problem import SlipProblem
from stickslip_ros.monitoring.friction.slip_windows import ForceSource, SlipWindow, slip_window, standing
from stickslip_ros.monitoring.samples import Batch, FloatArray

INERTIA, STIFFNESS, STRIBECK_VELOCITY = 2.0, 200.0, 0.01
NODES = 200


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(math.log(low), math.log(high)).map(math.exp)


def reference_simulation(
    parameters: FloatArray, law: int, damping: float, speed: float, times: FloatArray, begin: float
) -> FloatArray:
    """Positions at equal times [rad] from a breakaway at ``begin`` and rest, by the kernel of whole motions."""
    inertia, viscous, stribeck_velocity, lag, stribeck, rise_time = parameters
    state, plant = np.zeros(at.STATE_SIZE), np.zeros(at.PARAMETERS_SIZE)
    plant[at.INERTIA], plant[at.VISCOUS] = inertia, viscous
    plant[at.STRIBECK], plant[at.STRIBECK_VELOCITY] = stribeck, stribeck_velocity
    plant[at.LAG], plant[at.RISE_TIME], plant[at.LAW] = lag, rise_time, law
    plant[at.STIFFNESS], plant[at.DAMPING] = STIFFNESS, damping
    # So much friction, and a load that takes it back, that the joint cannot turn.
    force = STIFFNESS * speed * begin + damping * speed
    plant[at.COULOMB] = 100.0 * force
    plant[at.LOAD] = force - stribeck - plant[at.COULOMB]
    state[at.TIME] = state[at.EVENT_TIME] = begin
    state[at.DIRECTION], state[at.LEVEL] = 1.0, stribeck
    state[at.HISTORY_COUNT] = state[at.HISTORY_HEAD] = 1
    step = 2e-4
    history = np.zeros((2 * int(lag / step) + 8, 3))
    history[0, 0] = begin
    after = times[times > begin]
    positions = np.zeros(len(times))
    starts = np.append(begin, after[:-1])
    samples, events = np.empty((1, 3)), np.zeros((4, at.EVENT_COLUMNS))
    for number, (start, end) in enumerate(zip(starts, after, strict=True)):
        joint_kernel.advance(
            state, history, plant, np.zeros(4), False, False, step, end - start, np.array([speed * start]),
            np.array([speed]), np.zeros(1), np.zeros(at.COMPENSATION_SIZE), samples, events,
        )  # fmt: skip
        positions[len(times) - len(after) + number] = samples[0, 0]
    return positions


def slip_problem(times: FloatArray, speed: float, damping: float, law: int, distance: float) -> SlipProblem:
    duration = 0.8 * float(times[-1])
    observed = np.arange(NODES // 4, NODES - 1)
    window = SlipWindow(
        direction=1, rest_begin=float(times[0]), breakaway=0.1 * duration, arrest=duration, rest_position=0.0,
        rest_error=1e-6, source=ForceSource.GAINS, gains=Gains(stiffness=STIFFNESS, damping=damping), times=times,
        references=speed * times, forces=0.0 * times, reference_speed=speed, observed=observed,
        values=np.linspace(0.0, distance, len(observed)), gaps=np.full(len(observed), times[1]), resolution=1e-5,
        noise=0.0, sample_interval=float(times[1]),
    )  # fmt: skip
    return SlipProblem([window], law=law)


@settings(max_examples=60, deadline=None)
@given(
    force=between(0.5, 10.0), speed=between(0.1, 5.0), lag=between(0.02, 3.0), viscous=between(0.01, 0.5),
    damping=st.sampled_from([0.0, 2.0]), law=st.sampled_from([HESS_SOOM, EXPONENTIAL]),
)  # fmt: skip
def test_a_slip_is_that_of_the_whole_motion(
    force: float, speed: float, lag: float, viscous: float, damping: float, law: int
) -> None:
    """Positions are within 1e-4 of a slip's way of those in fine steps, whatever the friction and its law."""
    frequency = math.sqrt(STIFFNESS / INERTIA)
    level = force * INERTIA * frequency * STRIBECK_VELOCITY
    parameters = np.array([INERTIA, viscous * INERTIA * frequency, STRIBECK_VELOCITY, lag / frequency, level, 0.3])
    pace = speed * STRIBECK_VELOCITY
    times = np.linspace(0.0, (2.0 * math.pi + lag) / frequency, NODES)
    begin = 0.1 * float(times[-1])
    expected = reference_simulation(parameters, law, damping, pace, times, begin)
    distance = float(expected[-1])
    problem = slip_problem(times, pace, damping, law, distance)
    unknowns = np.array([[0.0, begin, math.log(level)]])
    positions, _, found = problem.simulate(np.log(parameters), unknowns)
    assert np.abs(positions - expected).max() < 1e-4 * distance
    assert found[0, kernel.HOLDING_FORCE] == pytest.approx((STIFFNESS * begin + damping) * pace)


def test_slopes_of_a_slip_do_not_depend_on_the_step_of_the_difference() -> None:
    """What is simulated is smooth in the parameters, and in when and at what level the slip begins."""
    frequency = math.sqrt(STIFFNESS / INERTIA)
    times = np.linspace(0.0, 7.0 / frequency, NODES)
    level = 4.0 * INERTIA * frequency * STRIBECK_VELOCITY
    problem = slip_problem(times, STRIBECK_VELOCITY, 0.0, HESS_SOOM, 8.0 * STRIBECK_VELOCITY / frequency)
    unknowns = np.array([[0.0, 0.1 * float(times[-1]), math.log(level)]])
    for lag in np.geomspace(0.05, 1.0, 12) / frequency:
        parameters = np.log([INERTIA, 0.1 * INERTIA * frequency, STRIBECK_VELOCITY, lag, level, 0.3])
        for moved in range(4):
            slopes = []
            for step in (1e-4, 1e-3):
                away = step * np.eye(6)[moved]
                ends = [problem.simulate(parameters + sign * away, unknowns)[0] for sign in (1.0, -1.0)]
                slopes.append((ends[0] - ends[1]) / (2.0 * step))
            assert np.abs(slopes[0] - slopes[1]).max() < 0.01 * np.abs(slopes[1]).max(), (lag, moved)


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
    rest = Batch(
        time=np.array([0.0, 0.1]), position=np.array([0.0, 1.0]), effort=np.ones(2),
        reference_position=np.zeros(2), reference_velocity=np.zeros(2),
    )  # fmt: skip
    assert standing(rest, 0.1, ForceSource.EFFORT, Gains(stiffness=0.0), 0.0, np.zeros(2)) is None


def test_the_simulation_is_compiled_once() -> None:
    """Arrays that lay the other way round in memory had it compiled a second time, where a delay is fitted."""
    times = np.linspace(0.0, 0.6, NODES)
    problem = slip_problem(times, 0.01, 2.0, HESS_SOOM, 0.02).with_delay()
    problem = problem.with_contact(ContactKnowledge(mean=0.01, std=0.003, unit=1.0 / STIFFNESS))
    parameters = np.log([INERTIA, 0.5, STRIBECK_VELOCITY, 0.02, 1.0, 0.3])
    several = np.tile([*parameters, 1.0, 0.01, 0.5], (3, 1))
    positions, _, _ = problem.simulate_variants(several, np.repeat(problem.detected(1.0)[None], 3, axis=0))
    assert np.isfinite(positions).all()
    assert len(kernel.simulate_windows.signatures) == 1
