# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages to arrays and back, and the refusal of those that mean nothing."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from stickslip_ros.diagnosis import Level, joint_diagnostic
from stickslip_ros.message_content import MessageError, gains_from_message, joint_rows, reference_rows, seconds
from stickslip_ros.model.friction import Gains, Joint
from stickslip_ros.model.joint_simulation import simulate
from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.reference_pairing import ReferencePairing
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.nodes.conversion import stamp, table
from stickslip_ros.nodes.exact_worker import UNKNOWN

NAMES = st.lists(st.text("abcdefgh_123", min_size=1, max_size=8), min_size=1, max_size=6, unique=True)


@settings(deadline=None)
@given(NAMES, st.booleans(), st.booleans())
def test_any_order_of_names_and_empty_arrays(names: list[str], velocity: bool, effort: bool) -> None:
    """Issue 2: names in any order, empty arrays for what is missing."""
    numbers = [float(index) for index in range(len(names))]
    message = JointState(
        name=names, position=numbers, velocity=numbers if velocity else [], effort=numbers if effort else []
    )
    rows = joint_rows(message)
    for name, number in zip(names, numbers, strict=True):
        assert rows[name][0] == number
        assert rows[name][1] == number if velocity else math.isnan(rows[name][1])
        assert rows[name][2] == number if effort else math.isnan(rows[name][2])


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"position": [1.0]}, "position has 1 values for 2 names"),
        ({"position": [1.0, 2.0], "velocity": [1.0, 2.0, 3.0]}, "velocity has 3 values for 2 names"),
    ],
)
def test_unequal_lengths_are_refused(fields: dict[str, list[float]], text: str) -> None:
    """Issue 2: arrays of unequal length are refused, with both lengths."""
    with pytest.raises(MessageError, match=text):
        joint_rows(JointState(name=["a", "b"], **fields))


def test_a_name_twice_is_refused() -> None:
    """Issue 2: one joint cannot have two positions."""
    with pytest.raises(MessageError, match="occurs twice"):
        joint_rows(JointState(name=["a", "a"], position=[1.0, 2.0]))


@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
def test_stamps_survive(sec: int, nanosec: int) -> None:
    """Issue 2: stamps to seconds and back, to the resolution of a double."""
    time = seconds(stamp(sec + 1e-9 * nanosec))
    assert time == pytest.approx(sec + 1e-9 * nanosec, abs=5e-7)


def test_gains_with_and_without_integral() -> None:
    """Issue 2: `pd_gains` with "p,d" or "p,i,d"."""
    assert gains_from_message(table(["a", "b"], ["p", "d"], [1, 2, 3, 4]))["b"] == Gains(stiffness=3.0, damping=4.0)
    with_integral = gains_from_message(table(["a"], ["p", "i", "d"], [1, 2, 3]))["a"]
    assert with_integral == Gains(stiffness=1.0, integral=2.0, damping=3.0)


@pytest.mark.parametrize(
    ("joints", "kinds", "values", "text"),
    [
        (["a"], ["d", "p"], [1, 2], "must be 'p,d' or 'p,i,d'"),
        (["a"], ["p", "d"], [1], "needs 2 values"),
        (["a"], ["p", "d"], [1, math.nan], "gain d of a must be finite: nan"),
    ],
)
def test_bad_gains_are_refused(joints: list[str], kinds: list[str], values: list[float], text: str) -> None:
    """Issue 2: gains that mean nothing are refused with a reason."""
    with pytest.raises(MessageError, match=text):
        gains_from_message(table(joints, kinds, values))


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 7), st.integers(0, 30), st.randoms(use_true_random=False))
def test_pairing_does_not_depend_on_arrival(chunk: int, lead: int, random: object) -> None:
    """Issue 2: samples meet the reference of their own stamp, whichever topic is ahead."""
    pairing = ReferencePairing()
    times = [0.01 * index for index in range(100)]
    batches = []
    reference_at = 0
    for index, time in enumerate(times):
        while reference_at < min(index + lead - 15, 100):
            pairing.add_reference(times[reference_at], 2.0 * times[reference_at], 2.0)
            reference_at += 1
        pairing.add_sample(time, time, math.nan, math.nan)
        if index % chunk == 0:
            batches.append(pairing.take())
    for rest in range(reference_at, 100):
        pairing.add_reference(times[rest], 2.0 * times[rest], 2.0)
    batches.append(pairing.take())
    taken = [batch for batch in batches if batch is not None]
    np.testing.assert_array_equal(np.concatenate([batch.time for batch in taken]), times)
    position = np.concatenate([batch.reference_position for batch in taken])
    known = np.isfinite(position)
    np.testing.assert_allclose(position[known], 2.0 * np.array(times)[known], atol=1e-12)
    assert known.sum() >= 80


def test_references_of_controllers() -> None:
    """Issue 2: desired motion in the shape of control_msgs, which has no wheel: only the fields that are read."""
    point = JointTrajectoryPoint(positions=[1.0, 2.0], velocities=[0.1, 0.2])
    state = SimpleNamespace(joint_names=["a", "b"], reference=point)
    assert reference_rows(state) == {"a": (1.0, 0.1), "b": (2.0, 0.2)}
    with pytest.raises(MessageError, match="2 positions for 1 joints"):
        reference_rows(SimpleNamespace(joint_names=["a"], reference=point))
    dof = SimpleNamespace(dof_states=[SimpleNamespace(name="a", reference=3.0)])
    assert reference_rows(dof)["a"][0] == 3.0


def test_a_stale_reference_says_nothing() -> None:
    """Issue 2: a reference that has ended is not held for ever."""
    pairing = ReferencePairing()
    pairing.add_reference(0.0, 1.0, 0.0)
    pairing.add_sample(0.5, 0.0, math.nan, math.nan)
    pairing.add_sample(5.0, 0.0, math.nan, math.nan)
    batch = pairing.take()
    assert batch is not None
    assert batch.reference_position[0] == 1.0
    assert math.isnan(batch.reference_position[1])


def test_a_joint_that_sticks_in_spite_of_its_margin(puma: Joint) -> None:
    """Issue 5, item 2: advice to keep the gains of a joint that sticks would mislead; what is wrong is said instead."""
    references = 5.8e-6 * np.arange(12_000.0)
    motion = simulate(puma, Gains(stiffness=630.0), references, np.full(12_000, 0.0058))
    batch = Batch(time=motion.time, position=2.5e-5 * np.round(motion.position / 2.5e-5), reference_position=references)
    oiled = replace(puma, friction=replace(puma.friction, stribeck=0.01))
    monitor = JointMonitor(oiled, Gains(stiffness=630.0), MonitorOptions(learn=False))
    monitor.process(batch)
    state = monitor.assessment()
    assert state.recommendation is not None
    assert state.recommendation.keep
    status = joint_diagnostic("a", state, UNKNOWN, UNKNOWN, warn_margin=0.1, silent_for=None)
    assert status.level is Level.ERROR
    assert status.message == "stick_slip, though its margin is there: the friction is not what is believed"
