# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Samples of a joint that cannot be what was measured, although each of them could: values that are republished, single
wrong ones, velocities that contradict the positions, references in another unit. They are named; nothing is left out
for them.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from stickslip_ros.monitoring.assessment import Assessment
from stickslip_ros.monitoring.samples import Batch, FloatArray
from stickslip_ros.output.wording import constant_effort_text, references_off_text, times_text

_BLOCK = 4096  # samples that are looked at together, however they come
_MOST_BLOCKS = 25  # for what holds of a whole recording
# A single sample is wrong if it stands off its neighbours by this many of their usual steps, or resolutions, while the
# way between the neighbours is a small share of that, and by this many times what any other sample stands off: noise
# and vibration have such samples too, but not far from all others.
_OFF = 20.0
_BETWEEN = 0.1
_BEYOND = 5.0
# A value counts as republished if it comes this many times at least, and nearly every one of so many does.
_REPEATS = 4
_FEWEST_RUNS = 20
_NEARLY_ALL = 0.95
_FEWEST_STEPS = 3  # of different sizes, in tenths of the smallest; a coarse encoder at one speed has one or two
_EXACT_BELOW = 8  # repeats, from which on one more or less is the timers' own
# Velocity and position are compared over stretches of so many samples, if the joint moved in enough of them. Factors
# between the limits, and a correlation above, are those of filters, quantisation and delays.
_STRETCH = 64
_FEWEST_STRETCHES = 10
_LEAST_FACTOR, _LARGEST_FACTOR = 0.6, 1.7
_LEAST_CORRELATION = 0.5
_DEGREES = 180.0 / math.pi
_ANOTHER_UNIT = 10.0  # extent of a reference, of that of the motion, 1: from which on a joint hardly follows it
_REFERENCE_FOLLOWS = "what is published as its reference only repeats what is measured, and does not count"


class SampleChecks:
    """Looks at the samples of one joint in blocks of one size, so that how they come has no effect."""

    def __init__(self) -> None:
        self._waiting: list[FloatArray] = []
        self._count = 0
        self._seen = np.zeros((4, 0))  # the last two samples of the block before
        self._blocks = 0
        self._samples = 0
        self._wrong = 0
        self._runs: Counter[int] = Counter()
        self._steps: set[float] = set()
        self._all_fields = False
        self._ways: list[tuple[float, float]] = []  # by position, and by velocity [rad]
        self._period = math.nan
        self._extents = np.array([[math.inf, -math.inf]] * 2)  # of position and reference, lowest and highest [rad]

    def add(self, batch: Batch) -> None:
        """Take usable samples."""
        for extent, values in zip(self._extents, (batch.position, batch.reference_position), strict=True):
            extent[:] = np.fmin.reduce(values, initial=extent[0]), np.fmax.reduce(values, initial=extent[1])
        columns = np.stack([batch.time, batch.position, batch.velocity, batch.effort])
        self._waiting.append(columns)
        self._count += columns.shape[1]
        if self._count >= _BLOCK:
            joined = np.concatenate(self._waiting, axis=1)
            whole = self._count // _BLOCK * _BLOCK
            for begin in range(0, whole, _BLOCK):
                self._check_block(joined[:, begin : begin + _BLOCK])
            self._waiting, self._count = [joined[:, whole:]], self._count - whole

    def problems(self) -> list[str]:
        """What is wrong, a sentence each; to be asked for once, at the end."""
        if self._count:
            self._check_block(np.concatenate(self._waiting, axis=1))
            self._waiting, self._count = [], 0
        texts = (self._single(), self._republished(), self._contradiction(), self._reference_in_another_unit())
        return [text for text in texts if text]

    def _check_block(self, block: FloatArray) -> None:
        self._samples += block.shape[1]
        columns = np.concatenate([self._seen, block], axis=1)
        self._seen = columns[:, -2:]
        self._wrong += _wrong_samples(columns[1])
        if self._blocks < _MOST_BLOCKS:
            self._blocks += 1
            self._count_repeats(block)
            self._compare(block)

    def _count_repeats(self, block: FloatArray) -> None:
        values = block[1:]
        self._all_fields = self._all_fields or bool(np.isfinite(values[1:]).any())
        same = ((values[:, 1:] == values[:, :-1]) | np.isnan(values[:, 1:])).all(axis=0)
        changes = np.flatnonzero(~same)
        self._runs.update(np.diff(changes).tolist())
        steps = np.abs(np.diff(values[0]))
        if len(self._steps) <= _FEWEST_RUNS and (steps > 0.0).any():
            least = float(steps[steps > 0.0].min())
            # Of nonsense one step may be endlessly many times another.
            with np.errstate(over="ignore"):
                self._steps |= set(np.round(steps[steps > 0.0] / least, 1).tolist())
        periods = np.diff(block[0])
        if math.isnan(self._period) and len(periods):
            self._period = float(np.median(periods))

    def _compare(self, block: FloatArray) -> None:
        count = (block.shape[1] - 1) // _STRETCH * _STRETCH
        if not count or not np.isfinite(block[2]).any():
            return
        time, position, velocity = block[:3]
        ways = np.diff(position[: count + 1 : _STRETCH])
        parts = 0.5 * (velocity[1 : count + 1] + velocity[:count]) * np.diff(time[: count + 1])
        integrals = parts.reshape(-1, _STRETCH).sum(axis=1)
        # A joint at rest goes to and fro by its noise, which its velocity, measured in another way, need not share.
        paths = np.abs(np.diff(position[: count + 1])).reshape(-1, _STRETCH).sum(axis=1)
        known = np.isfinite(integrals) & (np.abs(ways) > _BETWEEN * paths)
        self._ways += list(zip(ways[known].tolist(), integrals[known].tolist(), strict=True))

    def _single(self) -> str:
        if not self._wrong:
            return ""
        samples = "1 sample stands" if self._wrong == 1 else f"{self._wrong} of {self._samples} single samples stand"
        return f"{samples} far off both neighbours: wrong values, which are used"

    def _republished(self) -> str:
        count = sum(self._runs.values())
        if count < _FEWEST_RUNS or (not self._all_fields and len(self._steps) < _FEWEST_STEPS):
            return ""
        lengths = np.array(sorted(self._runs.elements()))
        usual = int(np.median(lengths))
        if usual < _REPEATS:
            return ""
        allowed = 0 if usual < _EXACT_BELOW else 1
        of_one = np.abs(lengths - usual * np.round(lengths / usual)) <= allowed
        if float(of_one.mean()) < _NEARLY_ALL:
            return ""
        rate = 1.0 / self._period if self._period > 0.0 else math.nan
        return (
            f"each value comes {usual} times, {rate / usual:.3g} new ones a second of {rate:.3g}: they are "
            "republished, and stops between them cannot be seen"
        )

    def _contradiction(self) -> str:
        ways = np.array(self._ways).reshape(-1, 2)
        usual = float(np.abs(ways[:, 0]).max(initial=0.0))
        moved = np.abs(ways[:, 0]) > _BETWEEN * usual
        if usual == 0.0 or moved.sum() < _FEWEST_STRETCHES:
            return ""
        by_position, by_velocity = ways[moved].T
        sizes = float(np.linalg.norm(by_position)), float(np.linalg.norm(by_velocity))
        if sizes[1] < 1e-3 * sizes[0]:
            return "its velocity is zero where its position changes: the velocity is no measured one"
        correlation = float(by_position @ by_velocity) / (sizes[0] * sizes[1])
        factor = sizes[1] / sizes[0]
        if abs(correlation) < _LEAST_CORRELATION:
            return "its velocity contradicts its position: they are of different motions"
        if correlation < 0.0:
            return "its velocity has the other sign than the change of its position"
        if _LEAST_FACTOR < factor < _LARGEST_FACTOR:
            return ""
        return f"its velocity is {factor:.3g} times what its position says{_in_degrees(factor, 'velocity')}"

    def _reference_in_another_unit(self) -> str:
        moved, led = self._extents[:, 1] - self._extents[:, 0]
        # Of nonsense one may be endlessly many times the other.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            factor = float(led / moved)
        if not 0.0 < factor < math.inf or 1.0 / _ANOTHER_UNIT < factor < _ANOTHER_UNIT:
            return ""
        return f"its reference moves {factor:.3g} times as far as it{_in_degrees(factor, 'reference')}"


def _in_degrees(factor: float, name: str) -> str:
    """The question that a factor between a quantity and what the position says of it leads to, "" for none."""
    if abs(math.log(factor / _DEGREES)) < 0.1:
        return f": is the {name} in degrees?"
    return ": is the position in degrees?" if abs(math.log(factor * _DEGREES)) < 0.1 else ""


def _wrong_samples(position: FloatArray) -> int:
    """How many single samples stand far off both their neighbours, which stand close to each other."""
    if len(position) < 3:
        return 0
    between = np.abs(position[2:] - position[:-2])
    steps = np.abs(np.diff(position))
    if not (steps > 0.0).any():
        return 0
    usual = max(float(np.median(between)), float(steps[steps > 0.0].min()))
    off = np.abs(position[1:-1] - 0.5 * (position[2:] + position[:-2]))
    wrong = (off > _OFF * usual) & (between < _BETWEEN * off)
    # What swings from sample to sample is no single value.
    beside = np.zeros(len(wrong), dtype=bool)
    beside[1:] |= wrong[:-1]
    beside[:-1] |= wrong[1:]
    largest = float(off[~wrong & ~beside].max(initial=0.0))
    return int((wrong & ~beside & (off > _BEYOND * largest)).sum())


def data_problems(assessment: Assessment, samples: int, references_off: float) -> list[str]:
    """What is wrong with a joint's samples, a sentence each; nothing if all is in order.

    Parameters
    ----------
    samples : how many came, those that were left out among them. references_off : by how much the stamps of the
        references are off, where these are not used for it [s]; else NaN.
    """
    restarts = assessment.restarts
    texts = [f"{count} of {samples} samples left out: {why}" for why, count in assessment.dropped.items()]
    texts += [f"{count} of {samples} values left out: {why}" for why, count in assessment.blanked.items()]
    if math.isfinite(assessment.constant_effort):
        texts.append(constant_effort_text(assessment.constant_effort))
    if assessment.reference_follows:
        texts.append(_REFERENCE_FOLLOWS)
    if math.isfinite(references_off):
        texts.append(references_off_text(references_off))
    if restarts:
        texts.append(f"stamps jump back {times_text(restarts)}: the motion is followed anew from there")
    return texts
