# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A stamp of zero is none: nobody set it. Another time stands for it, and how often is told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip_ros.messages.joint_states import FloatArray


def with_times(
    stamps: FloatArray, others: Callable[[], FloatArray], what: str, refuse: Callable[[str, int], None]
) -> FloatArray:
    """The stamps [s], and where there are none the others.

    Parameters
    ----------
    what : the others are the time of, for people. refuse : is told why stamps were not used, and how many.
    """
    unset = stamps == 0.0
    if not unset.any():
        return stamps
    refuse(f"stamp is zero; the time of {what} is used instead", int(unset.sum()))
    return np.where(unset, others(), stamps)


def with_time(stamp: float, other: float, what: str, refuse: Callable[[str, int], None]) -> float:
    """The same of one stamp."""
    return float(with_times(np.array([stamp]), lambda: np.array([other]), what, refuse)[0])
