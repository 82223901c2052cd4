# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The buffer gives back what it was given, as far as it has to, and does not grow."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip_ros.monitoring.samples import MOST_BYTES, Batch, SampleBuffer


@given(
    sizes=st.lists(st.integers(1, 3000), min_size=1, max_size=12),
    seed=st.integers(0, 1000),
    longest=st.floats(0.5, 20.0),
    ends=st.tuples(st.floats(-1.0, 40.0), st.floats(-1.0, 40.0)),
)
def test_what_is_asked_for_is_what_was_given(
    sizes: list[int], seed: int, longest: float, ends: tuple[float, float]
) -> None:
    """Issue 7: every column, NaN included, of the last seconds; blocks are used again without a trace."""
    random = np.random.default_rng(seed)
    count = sum(sizes)
    columns = random.standard_normal((6, count))
    columns[0] = 0.001 * np.arange(count)
    for column in columns[2:]:
        # A column may begin, end or be missing.
        begin, end = sorted(random.integers(0, count + 1, 2))
        column[begin:end] = np.nan
    columns[random.integers(2, 6)] = np.nan
    names = tuple(Batch.__dataclass_fields__)
    whole = Batch(**dict(zip(names, columns, strict=True)))
    buffer, at = SampleBuffer(longest, most_bytes=10**9), 0
    for size in sizes:
        buffer.add(whole.where(slice(at, at + size)))
        at += size
    begin, end = min(ends), max(ends)
    now = float(whole.time[-1])
    begin = max(begin, now - longest + 0.002)  # and the sample before
    found = buffer.between(begin, end)
    first, last = np.searchsorted(whole.time, [begin, end], side="right")
    if not last > first:
        assert found is None or len(found) <= 1
        return
    expected = whole.where(slice(max(int(first) - 1, 0), int(last)))
    assert found is not None
    for name in names:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def test_it_does_not_grow() -> None:
    """Issue 7: after its time is full, blocks are used again."""
    buffer = SampleBuffer(longest=10.0)
    sizes = []
    for number in range(300):
        times = number + 0.001 * np.arange(1000)
        buffer.add(Batch(time=times, position=times))
        sizes.append(len(buffer._blocks))
    assert max(sizes[:40]) == max(sizes) <= 23


def stick_slip(rate: float, dwell: float, slip: float, periods: int) -> Batch:
    """Every column of a joint that stands and slips by 0.01 rad, with counts of 1e-5 rad."""
    times = np.arange(int(periods * (dwell + slip) * rate)) / rate
    number, phase = np.divmod(times, dwell + slip)
    course = 0.5 - 0.5 * np.cos(np.pi * np.clip((phase - dwell) / slip, 0.0, 1.0))
    position = 1e-5 * np.round(0.01 * (number + course) / 1e-5)
    return Batch(
        time=times,
        position=position,
        velocity=np.gradient(position, times),
        effort=8.0 + times,
        reference_position=0.01 * times / (dwell + slip),
        reference_velocity=np.full(len(times), 0.01 / (dwell + slip)),
    )


@pytest.mark.parametrize(("rate", "dwell", "slip"), [(1000.0, 4.0, 0.4), (1000.0, 20.0, 0.5), (5000.0, 4.0, 0.2)])
def test_rests_are_thinned_out_and_slips_are_not(rate: float, dwell: float, slip: float) -> None:
    """Issue 21: less than half a megabyte a joint, and the last slip is there in full when the rest after it ends."""
    whole = stick_slip(rate, dwell, slip, 3)
    batched, singly = SampleBuffer(), SampleBuffer()
    batched.add(whole)
    for begin in range(0, len(whole), 777):
        singly.add(whole.where(slice(begin, begin + 777)))
    assert batched.size <= MOST_BYTES
    # The rest after the second slip has just ended.
    end = 3 * dwell + 2 * slip
    upto = whole.where(whole.time < end)
    buffer = SampleBuffer()
    buffer.add(upto)
    begin = 2 * dwell + slip - 0.4 * slip
    found = buffer.between(begin, 2 * dwell + 2 * slip)
    first, last = np.searchsorted(upto.time, [begin, 2 * dwell + 2 * slip], side="right")
    expected = upto.where(slice(int(first) - 1, int(last)))
    assert found is not None
    for name in Batch.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    # Of the rest before and after it there is enough to tell where it stood.
    for middle in (begin - 0.5 * dwell, end - 0.5 * dwell):
        rest = buffer.between(middle - 0.25 * dwell, middle + 0.25 * dwell)
        assert rest is not None
        assert len(rest) >= 10
        assert np.all(np.diff(rest.position) == 0)
    # It does not matter how they came.
    for one in Batch.__dataclass_fields__:
        np.testing.assert_array_equal(
            getattr(batched.between(0.0, 100.0), one), getattr(singly.between(0.0, 100.0), one), err_msg=one
        )


@given(
    rate=st.sampled_from([100.0, 1000.0, 5000.0]),
    seed=st.integers(0, 1000),
    columns=st.integers(2, 6),
    still=st.floats(0.0, 1.0),
)
def test_the_bound_holds_for_any_motion(rate: float, seed: int, columns: int, still: float) -> None:
    """Whatever moves, samples are in order, each was given, the newest are all there, and they take no more memory."""
    random = np.random.default_rng(seed)
    count = 60_000
    values = random.standard_normal((6, count))
    values[0] = np.arange(count) / rate
    values[1, random.random(count) < still] = 0.0
    values[columns:] = np.nan
    buffer = SampleBuffer()
    given_batch = Batch.of_columns(values)
    buffer.add(given_batch)
    assert buffer.size <= MOST_BYTES
    found = buffer.between(-1.0, values[0, -1])
    assert found is not None
    assert np.all(np.diff(found.time) > 0)
    at = np.searchsorted(values[0], found.time)
    np.testing.assert_array_equal(found.position, values[1, at])
    newest = min(MOST_BYTES // (8 * columns) // 2 - 1024, int(57.0 * rate))
    np.testing.assert_array_equal(found.time[-newest:], values[0, -newest:])
