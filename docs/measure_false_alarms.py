# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Measures false alarms, and the threshold of what is told without a reference, for docs/detection.md.

The motions are drawn at random, the same ones every time; with a folder of real recordings, the arms there are measured
too. It takes half an hour; less with fewer hours of each motion.

Run from the repository: python docs/measure_false_alarms.py [FOLDER_OF_RECORDINGS] [--hours 10]
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from bisect import bisect
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from random_motions import (
    HAND_GUIDING,
    PROGRAMS,
    RATES,
    REFERENCES,
    RandomStickSlip,
    random_motion,
    random_stick_slip,
    without_reference,
)

from stickslip_ros.monitoring.assessment import MonitorOptions
from stickslip_ros.monitoring.detection import cycles as detection
from stickslip_ros.monitoring.detection.cycles import Cycle, CycleDetector
from stickslip_ros.monitoring.detection.rests import Rest, RestDetector
from stickslip_ros.monitoring.detection.status import Segment, Status
from stickslip_ros.monitoring.joint_monitor import JointMonitor
from stickslip_ros.monitoring.samples import Batch

PICTURE = Path(__file__).parent / "pictures" / "roc.png"
DURATION = 600.0  # [s] of a recording
CURVE_HOURS = 5.0  # of each motion, at most
THRESHOLDS = (4.0, 7.0, 10.0, 12.0, 14.0, 17.0, 20.0, 25.0, 30.0)
STICK_SLIPS = 360
LEAST_DWELL = 0.01  # [s] of a slip that is to be found
APART = 3.0  # periods between two alarms
COUNTS = ((7.0, 15.0), (15.0, 60.0), (60.0, 3000.0))
_, _, REGULAR, JOGGED = PROGRAMS


def recordings(kind: str, hours: float) -> Iterator[Batch]:
    """Recordings of one kind of motion, the same ones every time."""
    for number in range(round(hours * 3600.0 / DURATION)):
        seed = [list(REFERENCES).index(kind), number]
        yield random_motion(kind, np.random.default_rng(seed), duration=DURATION)


def arms(folder: Path) -> dict[str, list[Batch]]:
    """The joints of a real leader and its follower, where they are at hand."""
    paths = [folder / f"prismax_0_arm_left_{which}.npz" for which in ("lead", "follow")]
    if not all(path.exists() for path in paths):
        return {}
    with np.load(paths[0]) as lead, np.load(paths[1]) as follow:
        leader = lead["time_s"].astype(float), lead["position_rad"].astype(float)
        follower = follow["time_s"].astype(float), follow["position_rad"].astype(float)
    return {
        "real leader": [Batch(time=leader[0], position=places) for places in leader[1].T],
        "real follower": [
            Batch(time=follower[0], position=places, reference_position=np.interp(follower[0], leader[0], leaders))
            for places, leaders in zip(follower[1].T, leader[1].T, strict=True)
        ],
    }


@dataclass
class Alarms:
    """How often and how long stick-slip was told."""

    count: int = 0
    duration: float = 0.0
    watched: float = 0.0

    def watch(self, batch: Batch) -> list[Segment]:
        """Add a recording; returns the alarms in it."""
        monitor = JointMonitor(options=MonitorOptions(learn=False), segments_kept=None)
        monitor.process(batch)
        monitor.finish()
        told = [segment for segment in monitor.segments if segment.status is Status.STICK_SLIP]
        self.count += len(told)
        self.duration += sum(segment.end - segment.start for segment in told)
        self.watched += float(batch.time[-1] - batch.time[0])
        return told

    def __str__(self) -> str:
        """Two columns of the table."""
        if self.watched == 0.0:
            return "| | "
        return f"| {3600.0 * self.count / self.watched:.1f} | {100.0 * self.duration / self.watched:.2f} "


def print_false_alarms(rows: Iterable[tuple[str, Iterable[Batch]]]) -> None:
    """The table of false alarms."""
    print(
        "| motion | duration [h] | alarms per hour, with reference | time in alarm [%], with reference "
        "| alarms per hour, without | time in alarm [%], without |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for name, batches in rows:
        with_it, without = Alarms(), Alarms()
        for number, batch in enumerate(batches):
            for alarm in with_it.watch(batch) if len(batch.reference_position) else []:
                # These should not be: a list of them, to look at.
                print(
                    f"{name}, recording {number}: {alarm.start:.2f} to {alarm.end:.2f} s", file=sys.stderr, flush=True
                )
            without.watch(without_reference(batch))
        print(f"| {name} | {without.watched / 3600.0:.1f} {with_it}{without}|", flush=True)


def rests_of(batch: Batch) -> list[Rest]:
    """The rests of a motion without its reference: no threshold has a say in them."""
    detector = RestDetector()
    found = (detector.rest_at(complete=True) for _ in detector.motion.follow(without_reference(batch)))
    return [rest for rest in found if rest is not None]


def set_threshold(enough: float) -> None:
    """Let another threshold, with what hangs on it, tell slips."""
    detection.ENOUGH, detection._MOST, detection._GIVEN_UP = enough, 1.5 * enough, 0.5 * enough


def told(rests: list[Rest]) -> tuple[list[Cycle], float]:
    """The cycles among rests, and when the first was told [s]."""
    detector, cycles, first = CycleDetector(), [], math.inf
    for rest in rests:
        found = detector.add_rest(rest)
        if found and not cycles:
            first = rest.arrest
        cycles += found
    return cycles, first


def alarms_among(cycles: list[Cycle]) -> int:
    """How many trains the cycles make."""
    return bool(cycles) + sum(
        other.breakaway - other.dwell - one.arrest > APART * other.period for one, other in itertools.pairwise(cycles)
    )


@dataclass
class Recall:
    """What was found of some recordings of stick-slip."""

    slips: int = 0
    slips_found: int = 0
    recordings: int = 0
    recordings_found: int = 0

    def __post_init__(self) -> None:
        self._needed: list[int] = []

    def add(self, recording: RandomStickSlip, rests: list[Rest]) -> None:
        """Add a recording."""
        cycles, first = told(rests)
        breakaways = [cycle.breakaway for cycle in cycles]
        for stick, after in itertools.pairwise(recording.sticks):
            if stick.dwell >= LEAST_DWELL:
                self.slips += 1
                last = bisect(breakaways, after.arrest) - 1
                self.slips_found += last >= 0 and cycles[last].arrest > stick.breakaway
        self.recordings += 1
        if cycles:
            self.recordings_found += 1
            self._needed.append(sum(stick.arrest <= first + LEAST_DWELL for stick in recording.sticks))

    @property
    def share_of_recordings(self) -> float:
        """[%]."""
        return 100.0 * self.recordings_found / self.recordings if self.recordings else math.nan

    @property
    def share_of_slips(self) -> float:
        """[%]."""
        return 100.0 * self.slips_found / self.slips if self.slips else math.nan

    @property
    def slips_needed(self) -> float:
        """Median of the number of slips until stick-slip was told."""
        return median(self._needed) if self._needed else math.nan


def print_recall(stick_slip: list[tuple[RandomStickSlip, list[Rest]]]) -> None:
    """The table of recall without a reference, at the threshold that is used."""
    print("| rate [Hz] | " + " | ".join(f"found, {low:g} to {high:g} counts a slip" for low, high in COUNTS) + " |")
    print("| --- " * (1 + len(COUNTS)) + "|")
    needed = set()
    for rate in RATES:
        cells = []
        for low, high in COUNTS:
            recall = Recall()
            for recording, rests in stick_slip:
                if recording.rate == rate and low <= recording.counts < high:
                    recall.add(recording, rests)
            cells.append(f"{recall.share_of_slips:.0f} % of {recall.slips}")
            needed.add(recall.slips_needed)
        print(f"| {rate:g} | " + " | ".join(cells) + " |")
    print(f"reported with slip {min(needed):g} to {max(needed):g} (medians of the cells)")
    for low, high in ((0.0, 0.4), (0.4, 0.8), (0.8, 1.2)):
        recall = Recall()
        for recording, rests in stick_slip:
            if low <= recording.damping_ratio < high:
                recall.add(recording, rests)
        print(
            f"damping ratio {low:g} to {high:g}: {recall.share_of_slips:.0f} % of {recall.slips} slips, "
            f"{recall.share_of_recordings:.0f} % of {recall.recordings} recordings"
        )


def measure_curve(
    stick_slip: list[tuple[RandomStickSlip, list[Rest]]], others: dict[str, list[tuple[float, list[Rest]]]]
) -> None:
    """The table of thresholds, and the picture of it; ``others`` are durations [s] and rests, by kind of motion."""
    used = detection.ENOUGH
    print("| threshold | recordings found [%] | slips found [%] | " + " | ".join(others) + " |")
    print("| --- " * (3 + len(others)) + "|")
    points: dict[str, list[tuple[float, float, float]]] = {name: [] for name in others}
    for threshold in THRESHOLDS:
        set_threshold(threshold)
        recall = Recall()
        for recording, rests in stick_slip:
            recall.add(recording, rests)
        cells = []
        for name, recorded in others.items():
            hours = sum(duration for duration, _ in recorded) / 3600.0
            trains = [told(rests)[0] for _, rests in recorded]
            taken = sum(len(cycles) for cycles in trains) / hours
            points[name].append((taken, recall.share_of_recordings, recall.share_of_slips))
            cells.append(f"{sum(alarms_among(cycles) for cycles in trains) / hours:.1f} ({taken:.0f})")
        print(
            f"| {threshold:g} | {recall.share_of_recordings:.0f} | {recall.share_of_slips:.0f} | "
            + " | ".join(cells) + " |", flush=True,
        )  # fmt: skip
    set_threshold(used)
    draw_curve({name: np.array(rows) for name, rows in points.items()}, THRESHOLDS.index(used))


def draw_curve(points: dict[str, np.ndarray], used: int) -> None:
    """Recall against motions that are taken for slips, the threshold used marked."""
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4.2), sharey=True, layout="constrained")
    for panel, column, title in zip(panels, (1, 2), ("recordings", "slips"), strict=True):
        for (name, rows), color in zip(points.items(), ("#1f5fa8", "#e08a1e", "#c0392b"), strict=False):
            panel.plot(rows[:, 0], rows[:, column], ".-", color=color, linewidth=1.5, label=name)
            panel.plot(rows[used, 0], rows[used, column], "o", color=color, markersize=10, markerfacecolor="none")
        panel.set_xscale("symlog", linthresh=1.0, linscale=0.5)
        panel.set_xlim(left=0.0)
        panel.set_xlabel("motions taken for slips, a joint-hour [1/h]")
        panel.set_ylabel(f"{title} of stick-slip found [%]")
        panel.set_ylim(50.0, 100.0)
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].legend(loc="lower right", frameon=False, title=f"circle: the threshold used, {THRESHOLDS[used]:g}")
    figure.savefig(PICTURE, dpi=80)
    pyplot.close(figure)


def main(folder: Path, hours: float, parts: list[str]) -> None:
    """Print the tables and draw the picture."""
    real = arms(folder)
    if "alarms" in parts:
        rows = [(kind, recordings(kind, hours)) for kind in REFERENCES]
        print_false_alarms(itertools.chain(rows, real.items()))
    if "threshold" in parts:
        stick_slip = []
        for seed in range(STICK_SLIPS):
            recording = random_stick_slip(seed, rate=RATES[seed % len(RATES)])
            stick_slip.append((recording, rests_of(recording.batch)))
        print_recall(stick_slip)
        pools: dict[str, list[tuple[float, list[Rest]]]] = {
            "people, real arms, moves that differ": [],
            JOGGED: [],
            REGULAR: [],
        }
        moving = [kind for kind in REFERENCES if kind != HAND_GUIDING]
        sources = [(kind, recordings(kind, min(hours, CURVE_HOURS))) for kind in moving]
        for kind, batches in itertools.chain(sources, [("", batches) for batches in real.values()]):
            pool = next((name for name in pools if kind.endswith(name)), next(iter(pools)))
            for batch in batches:
                pools[pool].append((float(batch.time[-1] - batch.time[0]), rests_of(batch)))
        measure_curve(stick_slip, pools)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("."))
    parser.add_argument("--hours", type=float, default=10.0, help="of each motion")
    parser.add_argument("--parts", nargs="+", choices=("alarms", "threshold"), default=["alarms", "threshold"])
    arguments = parser.parse_args()
    main(arguments.folder, arguments.hours, arguments.parts)
