# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The sentences for what the monitor finds: each reason has its own, and others look for their words."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from stickslip_ros.monitoring.detection.status import (
    Finding,
    Hunting,
    NoSamples,
    NotFollowing,
    Reason,
    Reversing,
    SampledTooSlowly,
    SpeedFalls,
    StampsInBursts,
    Status,
    StopsAndGoes,
    Stuck,
    ThinReserve,
    TooCoarse,
    TooFewCounts,
    TooFewSamples,
    TooShort,
)
from stickslip_ros.monitoring.friction.dry_friction import DryFriction, Term
from stickslip_ros.monitoring.friction.ripple import Ripple
from stickslip_ros.output.wording import counted, dry_friction_text, friction_change_text, reason_text

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
    (TooShort(moving=0.9984, needed=2.345), "only 0.998 s of motion without a stop, 2.35 s are needed"),
    (
        StopsAndGoes(),
        "stops and goes while no reference moves; publish the joint's own to tell commanded stops from sticking",
    ),
    (
        NotFollowing(share=-0.512),
        "moves 0.51 times as far as its reference, the other way: check that the reference is this joint's own, "
        "in its unit",
    ),
    (TooCoarse(counts=4.2), "the encoder is too coarse: 4 counts a slip"),
    (TooCoarse(counts=math.nan), "the encoder is too coarse: too few counts a slip"),
    (StampsInBursts(), "samples come in bursts: by their stamps the joint stops and goes, by their number it does not"),
    (TooFewCounts(), "the joint has moved by too few counts of its encoder"),
    (SampledTooSlowly(rate=5.0, needed=20.0), "sampled too slowly: 5 Hz; at least 20 Hz are needed"),
    (SpeedFalls(share=0.126), "the speed fell to 13 % of its mean a short time ago"),
    (ThinReserve(reserve=0.05, exactly=False), "damping reserve 5 % by Eq. (43)"),
    (ThinReserve(reserve=-0.5, exactly=True), "damping reserve -50 %"),
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


DRY = DryFriction(
    coulomb=Term(value=8.0, std=0.01, significance=0.0),
    load=Term(value=1.0, std=0.01, significance=0.0),
    drift=Term(value=-8.0 * 0.05 / 60.0, std=1e-4, significance=1e-6),
    distinguished=True,
    ripple=Ripple(
        amplitude=0.123, amplitude_std=0.01, period=0.05, period_std=1e-4, phase=0.0, phase_std=0.1, about=0.0,
        significance=1e-6, aliases=(),
    ),
    load_dependence=Term(value=0.1, std=0.01, significance=1e-4),
    scatter=0.05,
    places=(),
    direction=np.ones(1),
    position=np.zeros(1),
    time=np.zeros(1),
    kinetic=np.full(1, 8.0),
)  # fmt: skip


def test_what_dry_friction_depends_on() -> None:
    """One sentence of what is significant; what cannot be told apart is said."""
    assert dry_friction_text(DRY) == (
        "Coulomb friction varies by ±0.12 N·m with position, 20 times a radian; it falls by 5 % a minute; "
        "it grows by 10 % of the load."
    )
    assert DRY.ripple is not None
    unsure = replace(
        DRY, load=None, distinguished=False, load_dependence=None, ripple=replace(DRY.ripple, aliases=(0.01,))
    )
    assert dry_friction_text(unsure) == (
        "Coulomb friction with any load varies by ±0.12 N·m with position, 20 times a radian (or 100 times: the slips "
        "are spaced too evenly to distinguish them); it falls by 5 % a minute (or over position, which went with time)."
    )
    assert dry_friction_text(replace(DRY, ripple=None, drift=None, load_dependence=None)) == ""
    assert dry_friction_text(None) == ""


def test_one_of_a_kind_is_singular() -> None:
    """Issue 40, item 6: pages and terminal say "1 joint"."""
    assert [counted(number, "joint") for number in (0, 1, 2)] == ["0 joints", "1 joint", "2 joints"]
