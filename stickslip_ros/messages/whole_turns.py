# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Positions of continuous joints, which start again at the other end of a turn (±π, or 0 and 2π), made continuous."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from stickslip_ros.messages._whole_turns_kernel import ADDED, follow
from stickslip_ros.messages.blocks import FloatArray, Warn
from stickslip_ros.model.bounds import LARGEST

WRAPS = "position wraps at a whole turn; it is read on as a continuous one"


class WholeTurns:
    """Removes whole turns from the positions of joints, row after row; how rows are cut into batches has no effect.

    A step counts as a whole turn if the motion goes on beyond it: less the turn, it is hardly larger than the step
    before. Positions have to stay within one turn until then, as those that wrap do.

    Parameters
    ----------
    warn : called once for each joint that wraps, with a sentence.

    Attributes
    ----------
    counts : how many whole turns were removed, by joint.
    """

    def __init__(self, warn: Warn = lambda _: None) -> None:
        self._warn = warn
        self.counts: Counter[str] = Counter()
        self._states: dict[str, FloatArray] = {}

    def removed(self, joint: str, rows: FloatArray) -> FloatArray:
        """The rows with positions that go on over whole turns.

        Parameters
        ----------
        rows : time, position [rad], and other values, of shape (n, at least 2). They are not changed.
        """
        state = self._states.get(joint)
        if state is None:
            state = self._states[joint] = np.array([math.nan, math.inf, -math.inf, 0.0, 0.0])
        added = np.empty(len(rows))
        turns = follow(np.ascontiguousarray(rows[:, 1]), LARGEST, state, added)
        if turns:
            if joint not in self.counts:
                self._warn(f"{joint}: {WRAPS}")
            self.counts[joint] += turns
        elif state[ADDED] == 0.0:
            return rows
        found: FloatArray = rows.copy()
        found[:, 1] += added
        return found
