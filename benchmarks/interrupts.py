# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Signals at random moments of the lives of nodes and commands: each ends soon, without a word, and leaves nothing.

As a command: python -m benchmarks.interrupts [HOW_MANY [SEED]]; prints each process that ended otherwise.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path

from stickslip_ros.cli.processes import isolate

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SOON = 8.0  # [s], on a busy machine; on another one it is 1.5, but for callbacks that take up to 4
_TWICE = 0.2  # share of the processes that are signalled again while they end
_AT_ONCE = 3  # nodes that hear each other
_LIMIT = 30.0  # [s]
# What nodes log, what commands say.
_USUAL = re.compile(r"\[(INFO|WARN)\] |http://|table |joint|20\d\d-")
_NODE = (sys.executable, "-m", "stickslip_ros.nodes")
_COMMAND = (sys.executable, "-m", "stickslip_ros.cli.main")


@dataclass(frozen=True)
class Subject:
    """What is interrupted: its words, and until when at most [s] after its beginning.

    ``empty_cache`` : whether nothing is compiled yet.
    """

    words: tuple[str, ...]
    until: float = 4.0
    empty_cache: bool = False

    @property
    def is_node(self) -> bool:
        """Whether it is a node, and no command."""
        return self.words[: len(_NODE)] == _NODE


@dataclass(frozen=True)
class Ending:
    """How one ended."""

    subject: Subject
    moment: float  # [s]
    number: int
    status: int
    said: str
    took: float  # [s]
    left: tuple[str, ...]  # files that nobody finished

    @property
    def complaints(self) -> list[str]:
        """What is wrong with it."""
        # A command may be done before the signal counts.
        right = {0} if self.subject.is_node else {0, 128 + self.number}
        said = [line for line in self.said.splitlines() if not _USUAL.match(line)]
        found = [f"said {said}"] if said else []
        found += [f"ended with {self.status}"] if self.status not in right else []
        found += [f"took {self.took:.1f} s"] if self.took > _SOON else []
        return found + ([f"left {self.left}"] if self.left else [])

    def __str__(self) -> str:
        words = " ".join(self.subject.words[2:])
        return f"{signal.Signals(self.number).name} after {self.moment:.3f} s of {words}: {'; '.join(self.complaints)}"


def nodes() -> list[Subject]:
    """Each of them: idle alone, busy with one another; the monitor while it is compiled, too."""
    joint = ("-p", "joints:=[a,b]", "-p", "time_factor:=2.0")
    monitor = ("--ros-args", "-p", "state_file:=none")
    return [
        Subject((*_NODE, "monitor", *monitor)),
        Subject((*_NODE, "simulated_joint", "--ros-args", *joint)),
        Subject((*_NODE, "replay", "--ros-args", "-p", "recording:=slider")),
        Subject((*_NODE, "monitor", *monitor), 6.0, empty_cache=True),
    ]


def commands(folder: Path) -> list[Subject]:
    """Some that compute, read, write, wait and begin processes; their files are in the folder."""
    bag = folder / "read.mcap"
    subprocess.run([*_COMMAND, "simulate", "--duration", "60", "--out", str(bag)], check=True, capture_output=True)
    fleet = folder / "fleet"
    fleet.mkdir()
    for name in ("a", "b", "c"):
        (fleet / f"{name}.mcap").write_bytes(bag.read_bytes())
    table = folder / "table.csv"
    rows = (f"{0.001 * n:.3f},{0.01 * n % 6:.6f}\n" for n in range(2_000_000))
    table.write_text("time [s],position [rad]\n" + "".join(rows))
    words = (
        ("margin", "--model", "puma560_joint1"),
        ("recommend", "--model", "puma560_joint1"),
        ("analyze", str(bag), "--json"),
        ("analyze", str(fleet), "--jobs", "2"),
        ("identify", str(bag)),
        ("convert", str(table), "--out", str(folder / "converted.mcap")),
        ("simulate", "--duration", "3000", "--out", str(folder / "written.mcap")),
        ("simulate", "--duration", "3000", "--out", str(folder / "written")),
        ("map", "--model", "puma560_joint1", "--out", str(folder / "map.png")),
        ("demo", "--out", str(folder / "demo.png")),
        ("watch",),
        ("watch", "--browser"),
    )
    found = [Subject((*_COMMAND, *one)) for one in words]
    return [*found, Subject((*_COMMAND, "warm-up"), empty_cache=True)]


def interrupted(subject: Subject, random_numbers: random.Random, folder: Path) -> Ending:
    """Begin a process, and signal it at a random moment, perhaps twice."""
    moment, number = random_numbers.uniform(0.0, subject.until), random_numbers.choice(_SIGNALS)
    again = random_numbers.uniform(0.0, 0.5) if random_numbers.random() < _TWICE else None
    with tempfile.TemporaryDirectory() as own, tempfile.TemporaryFile("w+") as said:
        environment = {**os.environ, **({"NUMBA_CACHE_DIR": own} if subject.empty_cache else {})}
        process = subprocess.Popen(
            subject.words, stdout=subprocess.DEVNULL, stderr=said, env=environment, preexec_fn=_hold_back,
            start_new_session=True,
        )  # fmt: skip
        # Ctrl-C reaches every process of a terminal's job.
        send = os.killpg if number == signal.SIGINT else os.kill
        time.sleep(moment)
        send(process.pid, number)
        begin = time.monotonic()
        if again is not None:
            time.sleep(again)
            send(process.pid, number)
        try:
            process.wait(_LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
        status, took = process.wait(), time.monotonic() - begin
        said.seek(0)
        # Others may remove their folders meanwhile.
        names = (name for *_, names in os.walk(folder) for name in names)
        left = tuple(name for name in names if f".{process.pid}." in name and name.endswith(".part"))
        return Ending(subject, moment, number, status, said.read(), took, left)


def _hold_back() -> None:
    """Until the program takes them: what comes while Python itself starts is not its business."""
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)


def endings(subjects: Sequence[Subject], count: int, seed: int, folder: Path, at_once: int = 1) -> Iterator[Ending]:
    """Of so many processes, one subject after the other, some at the same time."""
    with ThreadPoolExecutor(at_once) as pool:
        pairs = enumerate(islice(cycle(subjects), count))
        running = [pool.submit(interrupted, one, random.Random(f"{seed} {n}"), folder) for n, one in pairs]
        for future in running:
            yield future.result()


def run(count: int = 100, seed: int = 0) -> int:
    """Interrupt so many, half of them nodes; returns how many ended otherwise than they should."""
    isolate()
    found: list[Ending] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for subjects, at_once in ((nodes(), _AT_ONCE), (commands(folder), 1)):
            for ending in endings(subjects, count // 2, seed, folder, at_once):
                found.append(ending)
                if ending.complaints:
                    print(ending, flush=True)
    found.sort(key=lambda ending: ending.took)
    wrong = sum(bool(ending.complaints) for ending in found)
    statuses = dict(Counter(ending.status for ending in found))
    print(
        f"{len(found)} signals, {wrong} of them with complaints; statuses {statuses}; the "
        f"end took {found[len(found) // 2].took:.2f} s in the median, {found[-1].took:.2f} s at most: {found[-1]}"
    )
    return wrong


if __name__ == "__main__":
    raise SystemExit(run(*map(int, sys.argv[1:3])) > 0)
