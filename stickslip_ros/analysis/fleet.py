# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Many bags at once: on one machine or on a cluster, with the same answers.

Each bag is a task of its own, whose answer is the JSON object that `stickslip analyze` prints of it. A bag that cannot
be read has an error as its answer; answers are kept in a folder, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import stickslip_ros
from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.analysis_json import bag_json
from stickslip_ros.analysis.report.report import write_report
from stickslip_ros.bags.lerobot import episodes, is_data_set
from stickslip_ros.bags.storage.formats import files_of, is_bag_file, is_bag_folder
from stickslip_ros.compilation import without_linear_algebra
from stickslip_ros.errors import StickSlipError, in_words
from stickslip_ros.files import write_whole
from stickslip_ros.interrupts import Interrupted, check, take_signals, without_interrupts
from stickslip_ros.parent_death import die_with_parent
from stickslip_ros.regular_files import read_regular

_LAYOUT = 4  # of an answer: another one where keys are new, or mean something else
_LARGEST_ANSWER = 1_000_000_000  # bytes
_ATTEMPTS = 2  # of a bag whose process dies
_KILLED = "its process was killed twice: is there too little memory?"

_LOOKED_EVERY = 0.2  # [s] at how far processes are

Answer = dict[str, Any]
# Of how many bags how many are done; a part of one counts as that.
Progress = Callable[[float, float], None]


@dataclass(frozen=True)
class BagTask:
    """One bag to analyse, here or elsewhere, and where its report is to be, if it is to have one."""

    path: Path
    options: AnalysisOptions
    report: Path | None = None


@dataclass(frozen=True)
class TimedAnswer:
    """A bag's answer, and how long it took [s]; NaN if it was kept from before."""

    answer: Answer
    seconds: float


def answer(task: BagTask, share: Callable[[float], None] = lambda _: None) -> TimedAnswer:
    """A bag's JSON object, or one with an error; raises nothing that a bag can cause.

    Parameters
    ----------
    share : told which share of the bag has been read.
    """
    began = time.monotonic()

    def read(done: int, total: int) -> None:
        share(done / total if total else 0.0)

    options = task.options if task.report is None else replace(task.options, with_traces=True)
    try:
        analysis = analyze(task.path, options, read)
        found = bag_json(analysis)
        if task.report is not None:
            try:
                write_report(task.report, analysis)
            except (StickSlipError, OSError) as error:
                found["warnings"].append(f"the report {task.report} was not written: {in_words(error)}")
    except (StickSlipError, OSError) as error:
        found = {"path": str(task.path), "error": in_words(error)}
    return TimedAnswer(found, time.monotonic() - began)


def _no_answer(task: BagTask) -> TimedAnswer:
    return TimedAnswer({"path": str(task.path), "error": f"bag {task.path}: {_KILLED}"}, math.nan)


def find_bags(paths: Sequence[Path]) -> list[Path]:
    """The bags that paths name; a folder that is no bag itself stands for the bags anywhere in it, and a LeRobot data
    set for its episodes.
    """
    found: list[Path] = []
    for path in paths:
        try:
            found += _bags_in(path) if path.is_dir() and not is_bag_folder(path) else [path]
        except OSError:
            # Why it cannot be read is said of it as of any bag.
            found.append(path)
    return list(dict.fromkeys(found))


def _bags_in(folder: Path) -> list[Path]:
    if is_data_set(folder):
        return episodes(folder)
    found: list[Path] = []
    for path in sorted(folder.iterdir()):
        if path.is_dir():
            found += [path] if is_bag_folder(path) else _bags_in(path)
        elif is_bag_file(path):
            found.append(path)
    return found


class Answers:
    """Answers kept in a folder, each under what it depends on: files, options, version and layout."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)

    def _file(self, task: BagTask) -> Path | None:
        if self._folder is None:
            return None
        try:
            files = files_of(task.path)
            states = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
        except (OSError, ValueError):
            return None
        basis = (
            stickslip_ros.__version__,
            _LAYOUT,
            str(task.path),
            states,
            repr(task.options),
            task.options.parameters.fingerprint(),
        )
        return self._folder / f"{task.path.stem}-{hashlib.sha256(repr(basis).encode()).hexdigest()[:16]}.json"

    def get(self, task: BagTask) -> Answer | None:
        """The answer to a task, if it is there and whole, and so is the bag's report if it is to have one."""
        if task.report is not None and not task.report.exists():
            return None
        file = self._file(task)
        try:
            found = json.loads(read_regular(file, _LARGEST_ANSWER)) if file is not None else None
        except (OSError, ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None

    def keep(self, task: BagTask, found: Answer) -> None:
        """Keep an answer; errors are not kept, for their reason may go."""
        file = self._file(task)
        if file is None or "error" in found:
            return
        write_whole(file, json.dumps(found, ensure_ascii=False))


def analyze_fleet(
    paths: Sequence[Path],
    options: AnalysisOptions,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    results: Path | None = None,
    reports: Mapping[Path, Path] | None = None,
    progress: Progress = lambda _, __: None,
    finished: Callable[[TimedAnswer], None] = lambda _: None,
) -> list[Answer]:
    """The answers to all bags, in their order.

    Parameters
    ----------
    jobs : processes on this machine. scheduler : address of a Dask scheduler, whose workers see the same files.
    results : folder in which answers are kept, and looked for first. reports : by bag, the pages to write.
    progress : told how many are done of how many, while a bag is read too. finished : told of each bag as it is done.

    Raises
    ------
    StickSlipError
        If the scheduler cannot be reached, or Dask is missing.
    """
    kept = Answers(results)
    tasks = [BagTask(path, options, (reports or {}).get(path)) for path in paths]
    found: dict[int, Answer] = {}
    for number, task in enumerate(tasks):
        known = kept.get(task)
        if known is not None:
            found[number] = known
            finished(TimedAnswer(known, math.nan))

    reached = 0.0

    def report(share: float) -> None:
        """Of the bags that are being read; a bag that has to be read again takes nothing back."""
        nonlocal reached
        reached = max(reached, len(found) + share)
        progress(reached, len(tasks))

    report(0.0)
    missing = [number for number in range(len(tasks)) if number not in found]
    if scheduler is not None:
        coming = _by_dask(tasks, missing, scheduler)
    elif jobs > 1:
        coming = _by_processes(tasks, missing, jobs, report)
    else:
        coming = ((number, answer(tasks[number], report)) for number in missing)
    for number, one in coming:
        # As from a file, whatever way it came.
        found[number] = json.loads(json.dumps(one.answer))
        kept.keep(tasks[number], found[number])
        finished(one)
        report(0.0)
    return [found[number] for number in range(len(tasks))]


_shares: Any = None  # of the bags that have been read, shared by the processes


def _begin(parent: int, shares: Any) -> None:
    """In a process of its own: it ends with the one that began it, or when that says so."""
    global _shares
    _shares = shares
    take_signals([signal.SIGTERM])
    die_with_parent(parent)
    without_linear_algebra()


def _answer_of(number: int, task: BagTask) -> TimedAnswer:
    """An answer, in a process of its own."""

    def report(share: float) -> None:
        check()
        _shares[number] = share

    try:
        return answer(task, report)
    except Interrupted as interrupted:
        # The pool would hand on whatever is raised, and the process would wait for another bag: for ever, where the
        # pool waits for its end because another process died.
        os._exit(interrupted.status)


def _by_processes(
    tasks: Sequence[BagTask], numbers: Sequence[int], jobs: int, report: Callable[[float], None]
) -> Iterator[tuple[int, TimedAnswer]]:
    """Answers as they come from processes; one that dies takes no other bag with it."""
    waiting = list(numbers)
    attempts = dict.fromkeys(numbers, 0)
    context = multiprocessing.get_context("spawn")
    while waiting:
        done: set[int] = set()
        # Plain memory: a lock would stay with a process that dies.
        shares = context.RawArray("d", len(tasks))
        with ProcessPoolExecutor(min(jobs, len(waiting)), context, _begin, (os.getpid(), shares)) as pool:
            running: dict[Future[TimedAnswer], int] = {}
            queue = iter(list(waiting))
            try:
                while True:
                    # No more than there are processes, so that it is known which bags were being read.
                    while len(running) < jobs and (number := next(queue, None)) is not None:
                        with without_interrupts():
                            running[pool.submit(_answer_of, number, tasks[number])] = number
                    if not running:
                        break
                    for future in wait(running, _LOOKED_EVERY, FIRST_COMPLETED).done:
                        yield running[future], future.result()
                        done.add(running.pop(future))
                    report(sum(shares[number] for number in running.values()))
            except BrokenProcessPool:
                for number in running.values():
                    attempts[number] += 1
            except BaseException:
                # Nobody waits for what is being read.
                for process in multiprocessing.active_children():
                    process.terminate()
                raise
        waiting = [number for number in waiting if number not in done]
        for number in [number for number in waiting if attempts[number] >= _ATTEMPTS]:
            yield number, _no_answer(tasks[number])
            waiting.remove(number)


def _by_dask(tasks: Sequence[BagTask], numbers: Sequence[int], scheduler: str) -> Iterator[tuple[int, TimedAnswer]]:
    """Answers as they come from the workers of a cluster, which gives the bags of a dead worker to others."""
    try:
        from distributed import Client, KilledWorker, as_completed
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise StickSlipError(f"--scheduler needs Dask ({error.name}): pip install 'stickslip_ros[dask]'") from error
    try:
        # Asked first: a client of an address that is none stays half made, and its end waits for ten seconds.
        get_address_host_port(scheduler)
        client = Client(scheduler, timeout="5s")
    except (OSError, ValueError) as error:
        raise StickSlipError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    with client:
        futures = {client.submit(answer, tasks[number], pure=False, key=f"bag-{number}"): number for number in numbers}
        for future in as_completed(list(futures)):
            number = futures[future]
            try:
                yield number, future.result()
            except KilledWorker:
                yield number, _no_answer(tasks[number])
