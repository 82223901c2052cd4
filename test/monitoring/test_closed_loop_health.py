# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Whether a joint gets worse is seen, and what is no worse is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stickslip_ros.monitoring.closed_loop_health import ClosedLoopHealth, health_of, swing_of, what_got_worse
from stickslip_ros.monitoring.samples import Batch

BAND = 10.0


def batch(shake: float = 0.0, frequency: float = 60.0, error: float = 0.01, rate: float = 1000.0) -> Batch:
    time = np.arange(0.0, 1.0, 1.0 / rate)
    reference = 0.05 * time
    sway = error * np.sin(2 * np.pi * 2.0 * time)
    position = reference + sway + shake * np.sin(2 * np.pi * frequency * time)
    return Batch(time=time, position=position, reference_position=reference, effort=100.0 * (reference - position))


def test_what_is_measured() -> None:
    """Issue 5, item 4: the largest tracking error and effort; what oscillates above the band, and that alone."""
    calm, shaken = health_of(batch(), BAND), health_of(batch(1e-3), BAND)
    assert calm.tracking_error == pytest.approx(0.01, rel=0.01)
    assert calm.effort == pytest.approx(1.0, rel=0.01)
    assert calm.oscillation < 1e-5
    assert shaken.oscillation == pytest.approx(1e-3 / math.sqrt(2), rel=0.02)
    assert shaken.effort_oscillation == pytest.approx(0.1 / math.sqrt(2), rel=0.02)
    # Uneven stamps and a missing reference are taken as they are; too slow a sampling shows nothing.
    kept = np.sort(np.random.default_rng(1).choice(1000, 900, replace=False))
    assert health_of(batch(1e-3).where(kept), BAND).oscillation == pytest.approx(1e-3 / math.sqrt(2), rel=0.1)
    assert math.isnan(health_of(batch(rate=20.0), BAND).oscillation)
    time = np.arange(0.0, 1.0, 0.01)
    assert math.isnan(health_of(Batch(time=time, position=time), BAND).tracking_error)


@pytest.mark.parametrize(
    ("now", "word"),
    [
        (batch(error=0.02), "tracking error"),
        (batch(shake=1e-3), "oscillation of 0.000"),
        (replace(batch(), effort=batch().effort + 0.2 * np.sin(400 * batch().time)), "oscillation of the effort"),
        (replace(batch(), effort=np.full(1000, 5.0)), "at its limit"),
    ],
)
def test_what_gets_worse_is_named(now: Batch, word: str) -> None:
    """Issue 5, item 4: tracking error, oscillation above the mechanical band, saturation."""
    before = health_of(batch(), BAND)
    assert what_got_worse(before, before) == ""
    assert word in what_got_worse(before, health_of(now, BAND), effort_limit=5.0)


def test_gaps_are_no_oscillation() -> None:
    """Where tenths of a second are missing, a line over them is none; what shakes between them is one."""
    time = np.arange(0.0, 1.0, 0.002)
    slip = 0.0037 * (1.0 - np.cos(np.pi * np.clip((time - 0.3) / 0.42, 0.0, 1.0)))
    heard = ~((time > 0.3) & (time < 0.5))
    shaken = slip + 2e-4 * np.sin(2.0 * np.pi * 40.0 * time)
    before = health_of(Batch(time=time, position=slip), BAND)
    now, worse = (health_of(Batch(time=time[heard], position=one[heard]), BAND) for one in (slip, shaken))
    assert what_got_worse(before, now, resolution=1e-6) == ""
    assert "oscillation" in what_got_worse(before, worse, resolution=1e-6)
    # Of scraps alone nothing is known.
    scraps = np.flatnonzero(np.arange(len(time)) % 100 < 5)
    assert math.isnan(health_of(Batch(time=time[scraps], position=shaken[scraps]), BAND).oscillation)


def test_what_is_no_worse() -> None:
    """Issue 5, item 4: a softer joint may lag more, an encoder's steps do not count, nor does the unknown."""
    before = health_of(batch(), BAND)
    assert what_got_worse(before, health_of(batch(error=0.02), BAND), softer=2.0) == ""
    assert what_got_worse(before, health_of(batch(shake=1e-4), BAND), resolution=1e-4) == ""
    unknown = ClosedLoopHealth(
        tracking_error=math.nan, oscillation=math.nan, effort_oscillation=math.nan, effort=math.nan
    )
    assert what_got_worse(before, unknown) == ""
    assert what_got_worse(unknown, before) == ""


def test_swinging_is_seen_without_a_reference() -> None:
    """Issue 20, item 5: to and fro is seen; sticking and slipping, one turn, and an encoder's counts are not."""
    time = np.arange(0.0, 2.0, 0.001)
    cases = {
        "swing": 0.005 * time + 1e-3 * np.exp(time) * np.sin(12.0 * time),
        "stick-slip": 0.005 * (np.floor(time * 2) + np.clip((time * 2 % 1 - 0.6) / 0.4, 0, 1)) / 2,
        "turn": 0.05 * np.abs(time - 1.0),
        "counts": 1e-4 * np.round(np.random.default_rng(3).normal(0.05 * time / 1e-4, 0.4)),
    }
    found = {name: swing_of(Batch(time=time, position=position), 1e-4) for name, position in cases.items()}
    assert found["swing"] == pytest.approx(2 * 1e-3 * math.exp(2.0), rel=0.4)
    assert (found["stick-slip"], found["turn"], found["counts"]) == (0.0, 0.0, 0.0)
    assert math.isnan(swing_of(batch(), 1e-4))
    calm, shaken = (replace(health_of(batch(), BAND), swing=found[name]) for name in ("stick-slip", "swing"))
    assert "swings to and fro" in what_got_worse(calm, shaken, resolution=1e-4)
    assert what_got_worse(shaken, shaken, resolution=1e-4) == ""
