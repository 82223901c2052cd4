# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Numbers that no joint, controller or clock has: they are counted and named, and no library warns of them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import nightly
from hypothesis import given, settings
from hypothesis import strategies as st
from support import record

from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.detection.status import Status
from stickslip_ros.monitoring.identification import identify
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.settings.known_joints import load_joint

pytestmark = pytest.mark.slow

GAINS = Gains(stiffness=630.0)
TOO_LARGE, TOO_SMALL = (
    "effort is infinite or larger than 1e+12",
    "effort is denormal (below 2.2e-308), as memory that nobody wrote is",
)
EFFORTS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "denormal": lambda effort: np.full(len(effort), 5e-324),
    "denormal noise": lambda effort: 1e-314 * effort,
    "zero": np.zeros_like,
    "constant": lambda effort: np.full(len(effort), 3.5),
    "rounding": lambda effort: 1e-17 * effort,
    "absurd": lambda effort: 1e200 * np.where(np.arange(len(effort)) % 2, 1.0, -1.0),
    "infinite": lambda effort: np.full(len(effort), math.inf),
}


@cache
def sticking() -> Batch:
    """Samples of a joint that sticks and slips."""
    return record(load_joint("puma560_joint1").joint, GAINS, 0.0058, duration=10.0, every=4).batch


@pytest.fixture(autouse=True)
def _warnings_are_errors() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def followed(batch: Batch, gains: Gains | None) -> Assessment:
    """What a monitor knows after a recording."""
    monitor = JointMonitor(None, gains, studies_at_once=True)
    monitor.process(batch)
    monitor.finish()
    return monitor.assessment()


@cache
def without_effort(gains: Gains | None) -> Assessment:
    """What the monitor knows of the same motion if no effort is published."""
    return followed(replace(sticking(), effort=np.zeros(0)), gains)


@pytest.mark.parametrize(
    ("case", "gains"),
    [
        *((case, (None, GAINS)[number % 2]) for number, case in enumerate(EFFORTS)),
        *(nightly(case, (GAINS, None)[number % 2]) for number, case in enumerate(EFFORTS)),
    ],
)
def test_efforts_that_are_none_count_as_unknown(case: str, gains: Gains | None) -> None:
    """Issue 34, items 7 and 12: the answers are those without an effort, and the effort is named."""
    batch = sticking()
    found = followed(replace(batch, effort=EFFORTS[case](batch.effort)), gains)
    expected = without_effort(gains)
    assert found.finding.status is Status.STICK_SLIP
    assert found.dropped == {}
    assert found.estimate is not None
    assert expected.estimate is not None
    assert found.estimate.source is expected.estimate.source
    np.testing.assert_array_equal(found.estimate.logarithms, expected.estimate.logarithms)
    if case in ("absurd", "infinite"):
        assert found.blanked == {TOO_LARGE: len(batch)}
    elif "denormal" in case:
        assert found.blanked[TOO_SMALL] > 0.9 * len(batch)
    else:
        assert math.isfinite(found.constant_effort)


def test_single_absurd_values_are_counted_by_their_field() -> None:
    """Issue 34, item 12: velocity, effort and reference have bounds as positions have them; the sample is used."""
    batch = sticking()
    wrong = {name: getattr(batch, name).copy() for name in ("effort", "reference_position", "reference_velocity")}
    wrong["velocity"] = np.full(len(batch), 0.0058)
    for number, values in enumerate(wrong.values()):
        values[100 * number + 50] = -1e300
    found = followed(replace(batch, **wrong), None)
    reason = "is infinite or larger than 1e+12"
    names = ("velocity", "effort", "reference position", "reference velocity")
    assert found.blanked == {f"{name} {reason}": 1 for name in names}
    assert found.dropped == {}


def test_an_effort_that_changes_is_one() -> None:
    """Issue 34, item 7: a measured effort is neither constant nor left out."""
    found = followed(sticking(), None)
    assert found.blanked == {}
    assert math.isnan(found.constant_effort)


@pytest.mark.parametrize("case", EFFORTS)
def test_identification_has_no_curve_of_an_effort_that_is_none(case: str) -> None:
    """Issue 34, item 7: no friction over speed is fitted to zeros, a constant or absurd values."""
    batch = sticking()
    found = identify(replace(batch, effort=EFFORTS[case](batch.effort)), None)
    assert found.sliding is None


SCALE = st.sampled_from([1e-320, 1e-200, 1e-100, 1e-12, 1e-3, 1.0, 1e6, 1e11, 1e100, 1e300])


@pytest.mark.slow
@settings(max_examples=4, deadline=None)
@given(position=SCALE, effort=SCALE, gain=SCALE, time=st.sampled_from([1e-9, 1.0, 1e6]), spikes=st.booleans())
def test_no_scale_of_the_inputs_makes_a_fit_warn(
    position: float, effort: float, gain: float, time: float, spikes: bool
) -> None:
    """Issue 34, item 7: overflow in a fit is no estimate; what is estimated is finite."""
    batch = sticking()
    efforts = np.clip(effort * batch.effort, -1e307, 1e307)
    if spikes:
        efforts[::97] = 1e11
    scaled = Batch(
        time=time * batch.time, position=position * batch.position, effort=efforts,
        reference_position=position * batch.reference_position,
        reference_velocity=position / time * batch.reference_velocity if position / time < 1e300 else np.zeros(0),
    )  # fmt: skip
    for gains in (None, Gains(stiffness=gain)):
        found = followed(scaled, gains)
        if found.estimate is not None:
            assert np.isfinite(found.estimate.logarithms).all()
