# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The buffer gives back what it was given, as far as it has to, and does not grow."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip_ros.monitoring.sample_buffer import SampleBuffer
from stickslip_ros.monitoring.samples import Batch


@settings(deadline=None)
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
    buffer, at = SampleBuffer(longest), 0
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
    assert max(sizes[:40]) == max(sizes) <= 12
