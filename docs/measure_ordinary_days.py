# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Measures the table of docs/detection.md on ordinary days: moves, pauses, and slow stretches in which a joint sticks.

The days are random, and the same ones every time. 200 of them take two minutes.

Run from the repository: python docs/measure_ordinary_days.py [--days 200]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
from ordinary_days import RATES, DayTally, OrdinaryDay, ordinary_day, watch_day

COUNTS = ((12.0, 50.0), (50.0, 300.0), (300.0, 3000.0))
SLIPS = ((1, 6), (7, 14), (15, 1000))


def slips_a_stretch(day: OrdinaryDay) -> float:
    """How many slips a slow stretch has, as a mean."""
    return len(day.slips) / len(day.stretches)


def row(name: str, days: list[OrdinaryDay], tallies: dict[tuple[int, bool], DayTally]) -> str:
    """One row of the table: the days of one kind, with and without the reference."""
    cells = []
    for with_reference in (True, False):
        total = DayTally()
        for day in days:
            total.add(tallies[id(day), with_reference])
        share = 100.0 * total.right / total.judged if total.judged else 0.0
        cells += [
            f"{100.0 * total.recall:.1f} % of {total.slips}", f"{total.outside} of {total.cycles}", f"{total.false}",
            f"{share:.0f} %",
        ]  # fmt: skip
    return f"| {name} | {len(days)} | {' | '.join(cells)} |"


def main(count: int) -> None:
    """Print the table."""
    days = [ordinary_day(seed) for seed in range(count)]
    tallies = {
        (id(day), with_reference): watch_day(day, with_reference=with_reference)
        for day in days
        for with_reference in (True, False)
    }
    heads = ["slips found", "cycles outside of slow stretches", "of these no slips", "time with the right status"]
    print("| days | number | " + " | ".join([f"{head}, with reference" for head in heads] + heads) + " |")
    print("|" + " --- |" * 10)
    print(row("all", days, tallies))
    groups: list[tuple[str, Callable[[OrdinaryDay], bool]]] = [
        *((f"{rate} Hz", lambda day, rate=rate: day.rate == rate) for rate in RATES),
        *(
            (f"{low:g} to {high:g} counts a slip", lambda day, low=low, high=high: low <= day.counts < high)
            for low, high in COUNTS
        ),
        *(
            (f"{low} to {high} slips a stretch", lambda day, low=low, high=high: low <= slips_a_stretch(day) < high + 1)
            for low, high in SLIPS
        ),
    ]
    for name, belongs in groups:
        chosen = [day for day in days if belongs(day)]
        print(row(name.replace(" to 1000 slips", " slips or more"), chosen, tallies))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=200)
    main(parser.parse_args().days)
