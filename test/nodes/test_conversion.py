# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Messages to arrays and back, and the refusal of those that mean nothing."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trajectory_msgs.msg import JointTrajectoryPoint

from stickslip_ros.messages.joint_states import MessageError, gains_from_message, reference_rows, seconds
from stickslip_ros.model.friction import Gains
from stickslip_ros.nodes.conversion import stamp, table


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
        (["a"], ["p", "d"], [1, math.nan], "gain d of a must be finite and less than 1e[+]12: nan"),
    ],
)
def test_bad_gains_are_refused(joints: list[str], kinds: list[str], values: list[float], text: str) -> None:
    """Issue 2: gains that mean nothing are refused with a reason."""
    with pytest.raises(MessageError, match=text):
        gains_from_message(table(joints, kinds, values))


def test_references_of_controllers() -> None:
    """Issue 2: desired motion in the shape of control_msgs, which has no wheel: only the fields that are read."""
    point = JointTrajectoryPoint(positions=[1.0, 2.0], velocities=[0.1, 0.2])
    state = SimpleNamespace(joint_names=["a", "b"], reference=point)
    assert reference_rows(state) == {"a": (1.0, 0.1), "b": (2.0, 0.2)}
    with pytest.raises(MessageError, match="2 positions for 1 joints"):
        reference_rows(SimpleNamespace(joint_names=["a"], reference=point))
    dof = SimpleNamespace(dof_states=[SimpleNamespace(name="a", reference=3.0)])
    assert reference_rows(dof)["a"][0] == 3.0
