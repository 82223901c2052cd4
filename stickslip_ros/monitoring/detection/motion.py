# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What is remembered of a joint's motion and its reference, and what it shows: crossings, speeds, travel, turns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from stickslip_ros.monitoring.detection import _crossing_kernel as crossing_kernel
from stickslip_ros.monitoring.detection import _judgement_kernel as judgement
from stickslip_ros.monitoring.detection import _motion_kernel as kernel
from stickslip_ros.monitoring.samples import ROUNDING_STD, Batch, FloatArray


@dataclass(frozen=True, kw_only=True)
class CycleRecord:
    """What the recent cycles and rests tell; times are in seconds, and NaN where there was none.

    Attributes
    ----------
    cycles : how many; period : their median.
    slip, dwell : the longest among them.
    distance : likewise of the slips, without their sign [rad]; reached : where the last cycle ended [rad].
    cycle_end : when the last cycle ended, or the rest in which it ended; the latest that was noted counts.
    last_breakaway : of the last rest; stop_before : of the rest before that, if the joint moved before.
    crept : whether the joint crept in one of the last two rests, all the while.
    """

    cycles: int = 0
    period: float = math.nan
    slip: float = math.nan
    dwell: float = math.nan
    distance: float = math.nan
    reached: float = math.nan
    cycle_end: float = math.nan
    last_breakaway: float = math.nan
    stop_before: float = math.nan
    crept: bool = False


@dataclass(frozen=True, kw_only=True)
class Swing:
    """A motion from one turn to the next about a reference that stands, or goes on slowly.

    Attributes
    ----------
    reached, left : when the joint came to the turn that it begins at, and when it left it [s].
    arrest : when it reached the next turn [s].
    position : of the turn that it begins at [rad]; distance : to the next one, signed [rad].
    error : reference less position at the turn that it begins at [rad]; NaN if the reference has no position.
    effort : measured there [N·m], NaN if unknown.
    middle : time from a tenth to nine tenths of the way [s]; turned : when it left the next turn [s].
    band : the smallest motion that is told from rest [rad]. travel : of the reference from turn to turn, signed [rad].
    """

    reached: float
    left: float
    arrest: float
    position: float
    distance: float
    error: float
    effort: float
    middle: float
    turned: float
    band: float
    travel: float

    @property
    def reference_velocity(self) -> float:
        """Mean of the reference from turn to turn, signed [rad/s]."""
        return self.travel / (self.arrest - self.reached)


class LowSpeed(Enum):
    """Where a joint may have rested: its motion is slow, or was and is fast again, on the fine or the coarse scale."""

    BEGUN, COMPLETE, COARSE = range(3)


class CrossingRecord:
    """The crossings of one scale, in the compiled path's memory.

    Parameters
    ----------
    motion : the record of the joint's motion; detector : that of the scale; velocity : what is measured of the
        velocity.
    """

    def __init__(self, motion: Any, detector: Any, velocity: Any) -> None:
        self._motion, self._detector, self._velocity = motion, detector, velocity
        self._rested = True  # in the low-speed interval just completed

    def did_not_rest(self, *, slowed: bool) -> None:
        """Note that the joint only slowed down where it seemed to rest, or only its stamps say so."""
        self._rested = False

    def close_low_speed(self) -> None:
        """Go on after a low-speed interval that is complete."""
        crossing_kernel.close_low_speed(self._rested, self._detector)
        self._rested = True

    @property
    def sample_interval(self) -> float:
        """Usual time between samples [s]; NaN if unknown."""
        return float(self._motion["interval"])

    @property
    def band(self) -> float:
        """The smallest motion told from rest [rad]: resolution or a multiple of the noise; 0 before any change."""
        band = float(self._detector["position"]["band"])
        return band if math.isfinite(band) else 0.0

    @property
    def velocity_band(self) -> float:
        """The smallest velocity told from none [rad/s]; NaN until the velocity's steps were seen."""
        signal = self._velocity
        return float(signal["band"]) if np.isfinite(signal["smallest"][2]) else math.nan

    @property
    def crossing_count(self) -> int:
        """How many crossings were ever set; the latest :data:`._crossing_kernel.RING` are kept."""
        return int(self._detector["head"])

    def crossings(self, first: int, last: int) -> FloatArray:
        """Crossings by their numbers, both included, in the columns of the kernel; a copy.

        Of the newest one the stand is that until the last sample.
        """
        rows: FloatArray = self._detector["crossings"][np.arange(first, last + 1) % crossing_kernel.RING]
        if last == self.crossing_count - 1:
            columns = [
                crossing_kernel.FLAT_END, crossing_kernel.REFERENCE_FLAT_END, crossing_kernel.ADVANCE,
                crossing_kernel.EFFORT_FLAT_END,
            ]  # fmt: skip
            now = ("last_time", "last_reference", "advance", "last_effort")
            rows[-1, columns] = [self._detector[name] for name in now]
        return rows

    @property
    def longest_gap(self) -> tuple[int, float]:
        """Crossing from which the longest gap of the slow stretch runs, and its duration [s]; 0 if there is none."""
        gap = int(self._detector["longest_gap"])
        return gap, float(self._detector["longest_time"]) if self._detector["in_low_speed"] else 0.0

    @property
    def speed_after(self) -> float:
        """Fastest motion since the longest gap [rad/s]."""
        return float(self._detector["peak_after"])

    @property
    def update(self) -> float:
        """How often the position changes while the joint moves by several bands at a time [s]; 0 if it never did.

        That is once in so many samples. It is rounded to them, so that it is the same wherever a record begins.
        """
        update, interval = float(self._detector["update"]), self.sample_interval
        return max(round(update / interval), 1) * interval if interval > 0.0 < update else update

    @property
    def last_detected(self) -> float:
        """Stamp of the last sample that the search for rests has taken [s]: one sample behind."""
        return float(self._detector["last_time"])


class MotionRecord(CrossingRecord):
    """The compiled path's memory, and the only one who touches it.

    Parameters
    ----------
    window : over which velocities are taken where none is given [s].

    Attributes
    ----------
    coarse : the crossings of the coarse scale; its own are those of the fine one.
    silent : see :meth:`follow`.
    """

    def __init__(self, window: float = 1.0) -> None:
        # Records, and the arrays that they lie in.
        self._motions: Any = np.zeros(1, judgement.MOTION)
        self._detectors: Any = np.zeros(2, crossing_kernel.DETECTOR)
        super().__init__(self._motions[0], self._detectors[0], self._detectors[0]["velocity"])
        self.coarse = CrossingRecord(self._motion, self._detectors[1], self._velocity)
        for name in ("now", "turned", "rested_at", "last_end", "referenced", "uneven_at"):
            self._motion[name] = -np.inf
        for name in (
            "first_time", "position", "reference", "reference_velocity", "interval", "slice", "last_reference",
            "before", "cycle_end",
        ):  # fmt: skip
            self._motion[name] = np.nan
        self._motion["looked"] = -1
        self.note(CycleRecord())
        self._motion["window"] = window
        self._detectors["peak"] = np.inf
        for detector in self._detectors:
            for signal in (detector["position"], detector["velocity"]):
                signal["smallest"] = np.inf
                signal["noises"] = signal["block"] = np.nan
                signal["band"] = np.inf
        self._detectors["crossings_to_wait"] = crossing_kernel.CROSSINGS_TO_WAIT
        self._slices = np.zeros((1, kernel.SLICE_COLUMNS))
        self._turns_taken = 0
        self.silent: int | None = None

    def follow(self, samples: Batch) -> Iterator[LowSpeed | Swing]:
        """Take samples; stops where there may be a rest, and at every complete swing.

        Where a rest may have begun it stops only if that is awaited, see :meth:`await_rest`. It ends where
        no sample came for so long that what follows is another story: :attr:`silent` then has the number of the
        first sample that was not taken.

        What is asked in between is answered as of then.
        """
        duration = float(samples.time[-1] - samples.time[0]) if len(samples) else 0.0
        self._make_room(min(len(samples), int(duration / kernel.SLICE_LENGTH) + 2) + 1)
        index, self.silent = 0, None
        while index < len(samples):
            index, why = kernel.follow(
                index, samples.time, samples.position, samples.velocity, samples.effort,
                samples.reference_position, samples.reference_velocity, self._slices, self._motions, self._detectors,
            )  # fmt: skip
            if why == kernel.SILENT:
                self.silent = index
                return
            if why == kernel.STANDS:
                yield LowSpeed.BEGUN
            if self._motion["swung"]:
                self._motion["swung"] = False
                yield Swing(**dict(zip(Swing.__dataclass_fields__, self._motion["swing"].tolist(), strict=True)))
            complete = why == kernel.LOW_SPEED
            while complete:
                yield LowSpeed.COMPLETE
                self.close_low_speed()
                # The first block, which had to wait, may hold more than one.
                complete = kernel.replay(self._detector)
            if self._motion["coarse_complete"]:
                self._motion["coarse_complete"] = False
                yield LowSpeed.COARSE
                self.coarse.close_low_speed()

    def close_slice(self) -> None:
        """End the slice of time that is open, where no more samples come."""
        self._make_room(1)
        kernel.close_slice(self._slices, self._motion, *self._detectors)

    def closed(self) -> FloatArray:
        """Take the slices closed since the last time, in the columns of the kernel."""
        rows: FloatArray = self._slices[: int(self._motion["closed"])].copy()
        self._motion["closed"] = 0
        return rows

    def note(self, record: CycleRecord) -> None:
        """Let the judgement know the recent cycles and rests."""
        # The end of a cycle stays the latest one, though another rest may have begun since.
        latest = np.fmax(self._motion["cycle_end"], record.cycle_end)
        for name in record.__dataclass_fields__:
            self._motion[name] = getattr(record, name)
        self._motion["cycle_end"] = latest

    def await_rest(self, *, awaited: bool) -> None:
        """Whether :meth:`follow` is to stop where a rest may have begun, from the next sample on; at first not."""
        self._motion["awaits_rest"] = awaited

    def did_not_rest(self, *, slowed: bool) -> None:
        """Let the judgement know that the joint did not rest where it seemed to."""
        super().did_not_rest(slowed=slowed)
        judgement.did_not_rest(slowed, self._motion)

    def turns(self) -> list[float]:
        """Take the times at which the joint was seen to move the other way, since the last time [s]."""
        count = int(self._motion["turn_count"])
        new = range(max(self._turns_taken, count - judgement.TURNS), count)
        self._turns_taken = count
        return [float(self._motion["turns"][number % judgement.TURNS]) for number in new]

    def require(self, *, motion: float, window: float) -> None:
        """Let the judgement know how long motion without a rest must last to be smooth, and the window [s]."""
        self._motion["needed"], self._motion["window"] = motion, window

    def judge(self) -> tuple[int, float, float]:
        """What the motion shows now: a code of the kernel's, and two numbers that explain it."""
        rest = judgement.open_rest(self._motion["window"], self._detector)
        code, first, second = judgement.judge(rest, self._motion, *self._detectors, False)
        return int(code), float(first), float(second)

    def goes_on(self, samples: Batch, *, largest: float) -> bool:
        """Whether samples simply go on: in strict order, and all within ``largest``."""
        return bool(kernel.unbroken(samples.time, samples.position, self.last_time, largest))

    @property
    def last_time(self) -> float:
        """Stamp of the last sample [s]; -inf before any."""
        return float(self._motion["now"])

    @property
    def position(self) -> float:
        """At the last sample [rad]."""
        return float(self._motion["position"])

    @property
    def reference_follows(self) -> bool:
        """Whether what is published as the reference only repeats what is measured, so that it counts as none."""
        return bool(self._motion["follows"])

    @property
    def period(self) -> float:
        """Median period of the recent cycles [s]."""
        return float(self._motion["period"])

    def errors(self, window: float) -> tuple[float, float]:
        """Largest tracking error [rad] and velocity error [rad/s] of the last ``window`` seconds; NaN if unknown."""
        if not self._motion["first_time"] <= self.last_time:
            return math.nan, math.nan
        tracking, velocity = judgement.errors(self.last_time - window, self._motion)
        return float(tracking), float(velocity)

    def reference_velocity(self, window: float) -> float:
        """Desired velocity now [rad/s]: as given, else over the last ``window`` seconds; NaN if unknown."""
        return float(judgement.reference_velocity(window, self._motion))

    def mean_velocity(self, window: float) -> float:
        """Mean velocity of the joint over the last ``window`` seconds [rad/s]; NaN if unknown."""
        return float(judgement.mean_velocity(window, self._motion))

    @property
    def resolution(self) -> float:
        """Smallest step of the signal [rad]."""
        return float(self._detector["position"]["resolution"])

    @property
    def noise(self) -> float:
        """Standard deviation of the position's noise [rad]."""
        return float(self._detector["position"]["noise"])

    def measurement_noise(self) -> tuple[float, float]:
        """Standard deviations of noise and quantisation of position [rad] and velocity [rad/s]; 0 if unknown."""
        signals = (self._detector[name] for name in ("position", "velocity"))
        position, velocity = (
            math.hypot(*np.nan_to_num([signal["noise"], signal["resolution"] * ROUNDING_STD], posinf=0.0))
            for signal in signals
        )
        return position, velocity

    def _make_room(self, count: int) -> None:
        """Let so many slices be closed before they are taken."""
        if self._motion["closed"] + count <= len(self._slices):
            return
        waiting = self.closed()
        self._slices = np.zeros((len(waiting) + count, kernel.SLICE_COLUMNS))
        self._slices[: len(waiting)] = waiting
        self._motion["closed"] = len(waiting)
