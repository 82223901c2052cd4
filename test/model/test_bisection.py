# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bisection finds the boundary, from either side, of numbers and of arrays."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip_ros.model.bisection import bisected, bisected_until


@pytest.mark.parametrize(("inside", "outside"), [(1.0, 2.0), (3.0, 0.5)])
def test_a_boundary_between_numbers(inside: float, outside: float) -> None:
    """The inside stays inside, whichever side it is."""
    edge = math.sqrt(2.0)

    def holds(value: float) -> bool:
        return (value < edge) == (inside < edge)

    found, beyond = bisected(holds, inside, outside, 50)
    assert holds(found)
    assert not holds(beyond)
    assert found == pytest.approx(edge, rel=1e-13)
    near, _ = bisected_until(holds, inside, outside, lambda one, other: abs(one - other) >= 1e-6, geometric=True)
    assert near == pytest.approx(edge, abs=1e-6)


def test_boundaries_of_an_array() -> None:
    """Each element has its own."""
    edges = np.array([0.1, 0.5, 0.9])
    found, _ = bisected(lambda values: values < edges, np.zeros(3), np.ones(3), 40)
    assert np.allclose(found, edges, atol=1e-11)
