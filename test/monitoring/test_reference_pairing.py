# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples and references meet by their stamps, in whatever order and number they come."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.monitoring.samples import ReferencePairing


@given(st.integers(1, 7), st.integers(0, 30), st.randoms(use_true_random=False))
def test_pairing_does_not_depend_on_arrival(chunk: int, lead: int, random: object) -> None:
    """Issue 2: samples meet the reference of their own stamp, whichever topic is ahead."""
    pairing = ReferencePairing()
    times = [0.01 * index for index in range(100)]
    batches = []
    reference_at = 0
    for index, time in enumerate(times):
        while reference_at < min(index + lead - 15, 100):
            pairing.add_references(np.array([[times[reference_at], 2.0 * times[reference_at], 2.0]]))
            reference_at += 1
        pairing.add_samples(np.array([[time, time, math.nan, math.nan]]))
        if index % chunk == 0:
            batches.append(pairing.next_batch())
    for rest in range(reference_at, 100):
        pairing.add_references(np.array([[times[rest], 2.0 * times[rest], 2.0]]))
    batches.append(pairing.next_batch())
    taken = [batch for batch in batches if batch is not None]
    np.testing.assert_array_equal(np.concatenate([batch.time for batch in taken]), times)
    position = np.concatenate([batch.reference_position for batch in taken])
    known = np.isfinite(position)
    np.testing.assert_allclose(position[known], 2.0 * np.array(times)[known], atol=1e-12)
    assert known.sum() >= 80


def test_a_stale_reference_says_nothing() -> None:
    """Issue 2: a reference that has ended is not held for ever."""
    pairing = ReferencePairing()
    pairing.add_references(np.array([[0.0, 1.0, 0.0]]))
    pairing.add_samples(np.array([[0.5, 0.0, math.nan, math.nan]]))
    pairing.add_samples(np.array([[5.0, 0.0, math.nan, math.nan]]))
    batch = pairing.next_batch()
    assert batch is not None
    assert batch.reference_position[0] == 1.0
    assert math.isnan(batch.reference_position[1])


@given(
    st.lists(st.floats(0.001, 0.6), min_size=1, max_size=40),
    st.integers(1, 50),
    st.randoms(use_true_random=False),
)
def test_pairing_at_once_is_pairing_bit_by_bit(gaps: list[float], size: int, random: object) -> None:
    """Issue 6, item 2: a recording paired in large pieces, and the same as it came: the same references."""
    known = np.cumsum(gaps)
    references = np.column_stack([known, np.sin(known), np.cos(known)])
    times = np.arange(0.0, float(known[-1]) + 0.3, 0.01)
    samples = np.column_stack([times, times, np.full((len(times), 2), np.nan)])
    at_once, bit_by_bit = ReferencePairing(), ReferencePairing()
    at_once.add_references(references)
    at_once.add_samples(samples)
    whole = at_once.next_batch(all_of_them=True)
    assert whole is not None
    parts, heard = [], 0
    for begin in range(0, len(times), size):
        end = min(begin + size, len(times))
        bit_by_bit.add_samples(samples[begin:end])
        until = int(np.searchsorted(known, times[end - 1], side="right"))
        bit_by_bit.add_references(references[heard:until])
        heard = until
        parts.append(bit_by_bit.next_batch())
    parts.append(bit_by_bit.next_batch(all_of_them=True))
    position = np.concatenate([part.reference_position for part in parts if part is not None])
    np.testing.assert_array_equal(position, whole.reference_position)


def test_references_that_come_late_or_anew() -> None:
    """Issue 6, item 2: a late reference finds its place; where time begins anew the old ones are void."""
    pairing = ReferencePairing()
    pairing.add_references(np.array([[1.0, 1.0, 0.0], [1.2, 3.0, 0.0], [1.1, 2.0, 0.0]]))
    pairing.add_samples(np.array([[1.15, 0.0, math.nan, math.nan]]))
    batch = pairing.next_batch()
    assert batch is not None
    assert batch.reference_position[0] == pytest.approx(2.5)
    pairing.add_references(np.array([[0.1, 7.0, 0.0], [0.2, 8.0, 0.0]]))
    pairing.add_samples(np.array([[0.15, 0.0, math.nan, math.nan]]))
    batch = pairing.next_batch()
    assert batch is not None
    assert batch.reference_position[0] == pytest.approx(7.5)


def test_what_is_played_fast_has_as_long_to_arrive() -> None:
    """References 0.1 s late on the clock, of a bag played at 5 times its speed, are waited for; others are not."""
    pairing = ReferencePairing()
    pairing.add_references(np.array([[1.0, 1.0, 0.0]]))
    pairing.add_samples(np.array([[1.0, 0.0, math.nan, math.nan]]))
    assert pairing.next_batch(10.0) is not None
    pairing.add_samples(np.array([[1.1, 0.0, math.nan, math.nan], [1.5, 0.0, math.nan, math.nan]]))
    assert pairing.next_batch(10.1) is None
    pairing.add_references(np.array([[1.1, 2.0, 0.0]]))
    batch = pairing.next_batch(10.12)
    assert batch is not None
    assert batch.reference_position.tolist() == [2.0]
    # By a clock that is far behind they are not waited for again and again.
    for now, stamp in ((10.33, 2.0), (10.34, 2.1), (10.35, 2.2)):
        pairing.add_references(np.array([[stamp - 0.8, 5.0, 0.0]]))
        pairing.add_samples(np.array([[stamp, 0.0, math.nan, math.nan]]))
        assert pairing.next_batch(now) is not None
    assert pairing.waiting == 0


def test_references_that_came_too_late_are_counted() -> None:
    """Only those whose samples had gone on without them, and none by a clock that was set back."""
    pairing = ReferencePairing()
    pairing.add_references(np.array([[1.0, 1.0, 0.0]]))
    pairing.add_samples(np.array([[stamp, 0.0, math.nan, math.nan] for stamp in (1.0, 1.1, 1.2)]))
    pairing.next_batch(10.0)
    pairing.add_references(np.array([[1.1, 1.0, 0.0], [1.2, 1.0, 0.0]]))
    pairing.next_batch(10.1)
    assert pairing.too_late == 0
    pairing.add_samples(np.array([[stamp, 0.0, math.nan, math.nan] for stamp in (1.3, 1.4, 1.5)]))
    pairing.next_batch(11.0)
    assert pairing.waiting == 0
    pairing.add_references(np.array([[1.3, 1.0, 0.0], [1.4, 1.0, 0.0], [1.6, 1.0, 0.0]]))
    pairing.next_batch(11.1)
    assert pairing.too_late == 2
    pairing.add_references(np.array([[0.1, 1.0, 0.0]]))
    pairing.next_batch(11.2)
    assert pairing.too_late == 2


@pytest.mark.parametrize("offset", [-1.7e9, -4.0, -0.5, 0.5, 4.0, 1.7e9])
def test_references_by_another_clock(offset: float) -> None:
    """Stamps that are never near those of the samples are off, by how much; such references are not kept for later."""
    pairing = ReferencePairing()
    stamps = 100.0 + 0.01 * np.arange(1200)
    taken = []
    for times in np.split(stamps, 300):
        pairing.add_samples(np.column_stack([times, np.zeros((4, 3))]))
        pairing.add_references(np.column_stack([times + offset, times, times]))
        batch = pairing.next_batch(float(times[-1]))
        taken += [] if batch is None else [batch]
        # A moment without any reference near is no proof.
        assert times[-1] > 102.0 or math.isnan(pairing.offset)
    used = np.isfinite(np.concatenate([batch.reference_position for batch in taken]))
    assert used.any() == (abs(offset) < 1.0)
    assert pairing.offset == pytest.approx(math.nan if used.any() else offset, abs=0.1, nan_ok=True)


def test_references_that_end_or_begin_anew_are_not_off() -> None:
    """Neither references of a motion that has ended, nor those of time that began anew are of another clock."""
    pairing = ReferencePairing()
    for begin in (50.0, 3.0):
        for times in np.split(begin + 0.01 * np.arange(1000), 250):
            pairing.add_samples(np.column_stack([times, np.zeros((4, 3))]))
            if times[0] < begin + 2.0:
                pairing.add_references(np.column_stack([times, times, times]))
            pairing.next_batch(float(times[-1]))
            assert math.isnan(pairing.offset)
