# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the motion shows beside what friction believed in says of it."""

from __future__ import annotations

import math

import pytest

from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.assessment import as_seen
from stickslip_ros.monitoring.detection.status import Status


@pytest.mark.parametrize(
    ("status", "before", "after"),
    [
        (Status.STICK_SLIP, 0.3, 0.99),
        (Status.STICK_SLIP, 0.999, 0.999),
        (Status.SMOOTH, 0.3, 0.3),
        (Status.NOT_JUDGED, 0.3, 0.3),
        (Status.STICK_SLIP, math.nan, math.nan),
    ],
)
def test_what_is_seen_is_probable(status: Status, before: float, after: float) -> None:
    """Issue 36, item 9: the probability of stick-slip was 0.30 to 0.83 beside a joint that sticks all the time."""
    verdict = as_seen(ExactVerdict(smooth=False, stick_slip_probability=before), status)
    assert verdict.stick_slip_probability == pytest.approx(after, nan_ok=True)
