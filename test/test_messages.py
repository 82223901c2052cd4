# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What live messages and recorded ones mean alike: stamps that nobody set, gains in parameters."""

from __future__ import annotations

import math
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from stickslip_ros.messages.gain_parameters import HeardGains, gain_name, gain_value, joint_and_kind
from stickslip_ros.messages.joint_states import with_time, with_times
from stickslip_ros.model.friction import Gains


def test_a_stamp_of_zero_is_none() -> None:
    """Other times stand for those that nobody set, and it is told how many they are."""
    told: Counter[str] = Counter()

    def refuse(reason: str, count: int) -> None:
        told[reason] += count

    stamps = np.array([0.0, 5.0, 0.0])
    assert with_times(stamps, np.array([1.0, 2.0, 3.0]), "arrival", refuse).tolist() == [1.0, 5.0, 3.0]
    assert with_time(4.0, 9.0, "arrival", refuse) == 4.0
    assert with_time(0.0, 9.0, "recording", refuse) == 9.0
    assert told == {
        "stamp is zero; the time of arrival is used instead": 2,
        "stamp is zero; the time of recording is used instead": 1,
    }


@pytest.mark.parametrize(
    ("name", "found"),
    [
        (gain_name("joint1", "p"), ("joint1", "p")),
        ("gains.left.arm.d", ("left.arm", "d")),
        ("gains.joint1.ff", None),
        ("gains.p", None),
        ("gains", None),
        ("other.joint1.p", None),
    ],
)
def test_names_of_gains(name: str, found: tuple[str, str] | None) -> None:
    """Joints may have dots in their names; what is no gain is none."""
    assert joint_and_kind(name) == found


def test_gains_come_one_by_one() -> None:
    """Without a stiffness there are none; what is not heard is 0; what is no finite number is left out."""
    heard = HeardGains()
    heard.set("a", "d", 2.0)
    assert heard.of("a") is None
    heard.set("a", "p", 3.0)
    assert heard.of("a") == Gains(stiffness=3.0, damping=2.0)
    double, integer = SimpleNamespace(type=3, double_value=math.inf), SimpleNamespace(type=2, integer_value=7)
    assert math.isnan(gain_value(double))
    assert gain_value(integer) == 7.0
    assert math.isnan(gain_value(SimpleNamespace(type=4, string_value="7")))
