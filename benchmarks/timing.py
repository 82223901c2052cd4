# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How everything here is timed."""

from __future__ import annotations

import time
from collections.abc import Callable

_REPEATS = 7


def best(work: Callable[[], object], repeats: int = _REPEATS) -> float:
    """Shortest of several runs after a warm-up [s]: machines are shared, and noise only ever adds."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def once(work: Callable[[], object]) -> float:
    """One run, without a warm-up [s]."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
