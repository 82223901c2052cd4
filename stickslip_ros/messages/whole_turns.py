# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Positions of continuous joints, which start again at the other end of a turn (±π, or 0 and 2π), made continuous."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stickslip_ros.messages.joint_states import FloatArray
from stickslip_ros.model.bounds import LARGEST

_TURN = 2.0 * math.pi
# Step that is left when the whole turn is taken off: as a share of a turn, and in steps before it. A joint that starts
# or speeds up within one sample stays below that.
_SMALL_STEP = 0.02
_STEPS_BEFORE = 3.0
_LARGEST_STEP = 0.1  # however fast the joint was before, so that a jump to a wrong value and back is none
# Width of the interval that a wrapping position never leaves [turns]; a joint that counts its turns leaves it.
_WIDEST = 1.0 + _SMALL_STEP
WRAPS = "position wraps at a whole turn; it is read on as a continuous one"
Say = Callable[[str], None]


@dataclass
class _Wrapped:
    """State of one joint: last position as it came, last step [rad], extremes as they came, and what is added [rad]."""

    last: float
    step: float
    least: float
    most: float
    added: float = 0.0


class WholeTurns:
    """Removes whole turns from the positions of joints, row after row; how rows are cut into batches has no effect.

    A step counts as a whole turn if the motion goes on beyond it: less the turn, it is hardly larger than the step
    before. Positions have to stay within one turn until then, as those that wrap do.

    Parameters
    ----------
    say : called once for each joint that wraps, with a sentence.

    Attributes
    ----------
    counts : how many whole turns were removed, by joint.
    """

    def __init__(self, say: Say = lambda _: None) -> None:
        self._say = say
        self.counts: Counter[str] = Counter()
        self._joints: dict[str, _Wrapped] = {}

    def removed(self, joint: str, rows: FloatArray) -> FloatArray:
        """The rows with positions that go on over whole turns.

        Parameters
        ----------
        rows : time, position [rad], and other values, of shape (n, at least 2). They are not changed.
        """
        state = self._joints.get(joint)
        if state is not None and not state.added and len(rows) > 1:
            # Most joints never wrap: nothing can be a whole turn where all lies within half of one.
            low, high = min(float(rows[:, 1].min()), state.last), max(float(rows[:, 1].max()), state.last)
            if high - low < 0.5 * _TURN:
                state.least, state.most = min(low, state.least), max(high, state.most)
                state.last, state.step = float(rows[-1, 1]), float(rows[-1, 1] - rows[-2, 1])
                return rows
        known = np.flatnonzero(np.abs(rows[:, 1]) < LARGEST)
        if not len(known):
            return rows
        position = rows[known, 1]
        if state is None:
            first = float(position[0])
            state = _Wrapped(last=first, step=0.0, least=first, most=first)
        steps = np.diff(position, prepend=state.last)
        turns = np.where(np.abs(np.abs(steps) - _TURN) < _LARGEST_STEP * _TURN, np.sign(steps), 0.0)
        left = steps - _TURN * turns
        before = np.abs(np.concatenate([[state.step], left[:-1]]))
        least = np.minimum(np.minimum.accumulate(position), state.least)
        most = np.maximum(np.maximum.accumulate(position), state.most)
        goes_on = np.abs(left) <= _STEPS_BEFORE * before + _SMALL_STEP * _TURN
        turns[~goes_on | (most - least > _WIDEST * _TURN)] = 0.0
        added = state.added - _TURN * np.cumsum(turns)
        self._joints[joint] = _Wrapped(
            last=float(position[-1]), step=float(left[-1]), least=float(least[-1]), most=float(most[-1]),
            added=float(added[-1]),
        )  # fmt: skip
        if not added.any():
            return rows
        if joint not in self.counts:
            self._say(f"{joint}: {WRAPS}")
        self.counts[joint] += int(np.count_nonzero(turns))
        found: FloatArray = rows.copy()
        found[known, 1] += added
        return found
