# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whatever comes in, a joint's monitor answers and does not fail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.settings.known_joints import load_joint

PUMA = load_joint("puma560_joint1").joint
NUMBER = st.floats(allow_nan=True, allow_infinity=True) | st.sampled_from([0.0, 1e-300, 1e300, -1e18, 1e-9])


@given(st.lists(st.lists(st.tuples(*[NUMBER] * 6), max_size=80), max_size=4), st.floats(), st.floats(), st.floats())
def test_arbitrary_samples_and_gains(
    batches: list[list[tuple[float, ...]]], stiffness: float, damping: float, integral: float
) -> None:
    """Issue 2, bad input: any numbers in any order leave the monitor able to answer."""
    monitor = JointMonitor(None, Gains(stiffness=stiffness, damping=damping, integral=integral))
    for rows in batches:
        columns = np.array(rows, dtype=float).reshape(-1, 6).T
        names = ("time", "position", "velocity", "effort", "reference_position", "reference_velocity")
        monitor.process(Batch(**dict(zip(names, columns, strict=True))))
        monitor.assessment()
    monitor.finish()


@pytest.mark.slow
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1e-12, 1e-6, 1.0, 1e6, 1e12]),
    st.sampled_from([1e-6, 1e-3, 0.08, 1e3]),
    st.sampled_from([1.0, 30.0, 1e9, 1.8e9]),
    st.floats(),
)
@example(0, 1e-12, 1e-3, 1.0, math.inf)  # an error
def test_wild_motion_on_any_scale(seed: int, scale: float, interval: float, start: float, stiffness: float) -> None:
    """Issue 2, bad input: steps, spikes, stops and turns, on any scale of place and time, with any stiffness."""
    generator = np.random.default_rng(seed)
    kinds = generator.integers(0, 4, 600)
    steps = np.select(
        [kinds == 0, kinds == 1, kinds == 2], [0.0, generator.standard_normal(600), generator.integers(-3, 4, 600)], 1e3
    )
    time = start + interval * np.cumsum(generator.integers(0, 3, 600))
    monitor = JointMonitor(PUMA, Gains(stiffness=stiffness))
    cycles = monitor.process(Batch(time=time, position=scale * np.cumsum(steps * (generator.random(600) < 0.5))))
    for cycle in cycles + monitor.finish():
        assert cycle.arrest > cycle.breakaway
        assert cycle.dwell > 0
    monitor.assessment()
