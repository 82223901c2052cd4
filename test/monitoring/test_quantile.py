# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The compiled quantile is numpy's."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from stickslip_ros.monitoring._quantile_kernel import quantile


@njit
def called(values: np.ndarray, count: int, share: float) -> float:
    return quantile(values, count, share)


@settings(deadline=None)  # the first call compiles
@given(
    st.lists(st.one_of(st.floats(-1e6, 1e6), st.sampled_from([0.0, 1.0])), min_size=1, max_size=80),
    st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0]),
    st.integers(0, 5),
)
def test_it_is_that_of_numpy(values: list[float], share: float, more: int) -> None:
    """Issue 15: numba's own takes a second to compile. Equal values, one value, and room behind them are included."""
    room = np.array([*values, *[np.nan] * more])
    assert np.isclose(called(room, len(values), share), np.quantile(values, share), rtol=1e-12, atol=1e-9)
