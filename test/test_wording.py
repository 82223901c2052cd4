# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The sentences for what the monitor finds: each reason has its own, and others look for their words."""

from __future__ import annotations

from typing import get_args

import pytest

from stickslip_ros.monitoring.detection.status import (
    Finding,
    Hunting,
    NoSamples,
    Reason,
    Reversing,
    SpeedFalls,
    Status,
    StopsAndGoes,
    Stuck,
    ThinReserve,
    TooCoarse,
    TooFewSamples,
    TooShort,
)
from stickslip_ros.output.wording import friction_change_text, reason_text

SENTENCES: list[tuple[Reason | None, str]] = [
    (None, ""),
    (NoSamples(), "no samples yet"),
    (
        NoSamples(left_out=("position is missing", "time is not finite")),
        "position is missing; time is not finite",
    ),
    (TooFewSamples(), "too few samples"),
    (Hunting(), "hunting"),
    (Stuck(duration=9.25, travel=0.09876), "stuck for 9.2 s while the reference moved by 0.0988 rad"),
    (Reversing(), "reversing"),
    (TooShort(moving=0.5, needed=2.345), "too short a motion: 0.50 s of 2.35 s"),
    (StopsAndGoes(), "stops and goes; publish the reference to tell commanded stops from sticking"),
    (TooCoarse(counts=4.2), "the encoder is too coarse to count: 4 counts a slip"),
    (SpeedFalls(share=0.126), "the speed falls to 13 % of its mean"),
    (ThinReserve(reserve=0.05, exactly=False), "damping reserve 5 % by Eq. (43)"),
    (ThinReserve(reserve=-0.5, exactly=True), "damping reserve -50 % exactly"),
]


@pytest.mark.parametrize(("reason", "sentence"), SENTENCES)
def test_every_reason_has_its_sentence(reason: Reason | None, sentence: str) -> None:
    """Word by word, as diagnostics and JSON have had them."""
    assert reason_text(Finding(status=Status.AT_RISK, reason=reason)) == sentence


def test_no_reason_is_left_out() -> None:
    """The list above has one of each."""
    assert {type(reason) for reason, _ in SENTENCES} == {type(None), *get_args(Reason)}


def test_no_change_is_no_sentence() -> None:
    """Nothing is said where nothing changed."""
    assert friction_change_text(None) == ""
