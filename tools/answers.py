# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Answers of the package for fixed seeds in one file, to show that a rebuild changes none of them.

Run from the repository:

    python -m tools.answers FILE.json
    python -m tools.answers --compare BEFORE.json AFTER.json

Sections are in `model_answers.py`, `recording_answers.py` and `monitor_answers.py`. Random joints, machines and motions
are those of the tests. Keys of the file are names that the package has for its results.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The sections import the tests' random joints by their names alone.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "monitoring"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "model"))
from tools import model_answers, monitor_answers, recording_answers
from tools.model_answers import Answer

TOLERANCE = 1e-9  # relative difference below which two numbers are equal: above rounding, below any other change
FLOOR = 1e-6  # SI units: the difference of smaller numbers is relative to this, since sums near 0 are rounding errors
_WORKERS = 2  # processes: as many as the smallest machine in use has cores
_PRINTED = 60  # differences: a page or two


@dataclass(frozen=True)
class Difference:
    """Value that differs between two files.

    Attributes
    ----------
    path : section, index and keys of the value. before, after : the values, `MISSING` where a file has none.
    size : relative difference of two numbers; infinite for anything else.
    """

    path: str
    before: Any
    after: Any
    size: float

    @property
    def section(self) -> str:
        """Name of the section."""
        return self.path.split("/")[1]

    def __str__(self) -> str:
        size = "differs" if math.isinf(self.size) else f"{self.size:.2e}"
        return f"{size:>9}  {self.path}: {_shown(self.before)} -> {_shown(self.after)}"


class _Missing:
    def __repr__(self) -> str:
        return "missing"


MISSING = _Missing()


@dataclass(frozen=True)
class Section:
    """Number of a section's answers, and the function that computes one by its index."""

    count: int
    answer: Callable[[int], Answer]


def sections() -> dict[str, Section]:
    """Sections by name, those first whose answers take longest."""
    return {
        "real recordings": Section(len(recording_answers.real_files()), recording_answers.real_recording),
        "bags": Section(3, recording_answers.bag),
        "diagnostics": Section(len(monitor_answers.RUNS), monitor_answers.diagnostics),
        "recordings": Section(len(recording_answers.RECORDINGS), recording_answers.recording),
        "friction": Section(len(monitor_answers.FRICTION), monitor_answers.friction),
        "hunting": Section(20, model_answers.hunting_case),
        "compensation": Section(16, model_answers.compensation),
        "advice": Section(100, monitor_answers.advice),
        "reversals": Section(20, model_answers.reversal),
        "verdicts": Section(200, model_answers.verdict),
    }


def differences(before: Any, after: Any, tolerance: float = TOLERANCE) -> list[Difference]:
    """Differences between the contents of two files, worst first.

    Parameters
    ----------
    tolerance : largest relative difference of equal numbers; numbers below FLOOR are compared relative to FLOOR.
    """
    found = [one for one in _differences("", before, after) if not one.size <= tolerance]
    return sorted(found, key=lambda one: (-one.size, one.path))


def _differences(path: str, before: Any, after: Any) -> Iterator[Difference]:
    """Differences of any size, those below the tolerance among them."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in dict.fromkeys([*before, *after]):
            yield from _differences(f"{path}/{key}", before.get(key, MISSING), after.get(key, MISSING))
    elif isinstance(before, list) and isinstance(after, list):
        for index in range(max(len(before), len(after))):
            pair = (some[index] if index < len(some) else MISSING for some in (before, after))
            yield from _differences(f"{path}/{index}", *pair)
    elif _is_number(before) and _is_number(after):
        yield Difference(path, before, after, _relative(before, after))
    elif type(before) is not type(after) or before != after:
        yield Difference(path, before, after, math.inf)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _relative(before: float, after: float) -> float:
    """Relative difference: 0 if both numbers are NaN, or the same infinity; infinite if only one is finite."""
    if before == after or (math.isnan(before) and math.isnan(after)):
        return 0.0
    if not (math.isfinite(before) and math.isfinite(after)):
        return math.inf
    return abs(after - before) / max(abs(before), abs(after), FLOOR)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 300 else f"{text[:300]}…"


def computed(names: Sequence[str] = (), count: int | None = None, workers: int = _WORKERS) -> dict[str, list[Answer]]:
    """Answers by section, computed by processes.

    Parameters
    ----------
    names : of sections; () for all. count : how many answers of each section, from the first on; None for all.
    """
    jobs = [
        (name, index)
        for name, section in sections().items()
        if not names or name in names
        for index in range(section.count if count is None else min(count, section.count))
    ]
    answers: dict[str, list[Answer]] = {name: [] for name, _ in jobs}
    spent: defaultdict[str, float] = defaultdict(float)
    # Spawned, not forked: a process of its own loads numpy after main() has set how many threads that has.
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for (name, _), (answer, seconds) in zip(jobs, pool.map(timed_answer, *zip(*jobs, strict=True)), strict=True):
            answers[name].append(answer)
            spent[name] += seconds
    for name, found in answers.items():
        print(f"{name}: {len(found)} answers, {spent[name]:.0f} s of processor time", file=sys.stderr)
    return dict(sorted(answers.items()))


def timed_answer(name: str, index: int) -> tuple[Answer, float]:
    """Answer of a section, or the exception in its place, and its processor time [s]."""
    begin = time.process_time()
    try:
        answer = sections()[name].answer(index)
    except Exception as error:
        answer = {"exception": f"{type(error).__name__}: {error}"}
    return answer, time.process_time() - begin


def write(path: Path, answers: dict[str, list[Answer]]) -> None:
    """Write the answers; NaN and infinity as Python's json has them."""
    path.write_text(json.dumps(answers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def compare(before: Path, after: Path, tolerance: float) -> int:
    """Print what differs between two files, worst first, and how much of it in each section; 1 if anything does."""
    contents = [json.loads(path.read_text(encoding="utf-8")) for path in (before, after)]
    found = differences(contents[0], contents[1], tolerance)
    for one in found[:_PRINTED]:
        print(one)
    if len(found) > _PRINTED:
        print(f"and {len(found) - _PRINTED} more")
    for section in sorted({one.section for one in found}):
        numbers = [one.size for one in found if one.section == section and math.isfinite(one.size)]
        others = sum(one.section == section for one in found) - len(numbers)
        print(f"{section}: {len(numbers)} numbers (worst {max(numbers, default=0.0):.2e}), {others} other values")
    if not found:
        print(f"all answers are equal to {tolerance:g}")
    return 1 if found else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.answers", description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, help="to be written")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"), help="files written before")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="relative, of numbers (%(default)g)")
    parser.add_argument("--sections", nargs="+", choices=list(sections()), default=[], metavar="NAME", help="not all")
    parser.add_argument("--count", type=int, help="of answers in each section (all)")
    parser.add_argument("--workers", type=int, default=_WORKERS, help="processes (%(default)d)")
    given = parser.parse_args(arguments)
    if (given.file is None) == (given.compare is None):
        parser.error("a file to write, or two to compare")
    if given.compare is not None:
        return compare(given.compare[0], given.compare[1], given.tolerance)
    # With one thread a process, sums do not depend on how many cores the machine has.
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
    write(given.file, computed(given.sections, given.count, given.workers))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
