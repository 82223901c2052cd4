# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Work that takes up to seconds, in a process of its own: Python's threads share one lock, and intake needs it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from threading import Thread
from time import monotonic
from typing import Any, Generic, TypeVar

from stickslip_ros.interrupts import without_interrupts
from stickslip_ros.parent_death import die_with_parent

_NICE = 10  # what else runs on the robot comes first
_MOST_WAITING = 64  # questions; further ones are skipped until there is room
_REST = 5.0  # [s] before a question of a key is taken again, where the last one could not be answered

_LAST_WAIT = 0.5  # [s] for the pool to close; it takes milliseconds

Key = tuple[str, str]
Question = TypeVar("Question")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class _Running:
    question: Any
    future: Future[Any]
    pool: ProcessPoolExecutor
    submitted_at: float


@dataclass(frozen=True)
class Done:
    """A question that was dealt with; the answer is None, and ``failed`` set, if that went wrong."""

    question: Any
    answer: Any
    failed: bool = False


class SlowWork:
    """One process, begun with the first question; each key has at most one question under way.

    Parameters
    ----------
    warn : told what went wrong.

    ``skipped`` counts questions that found no room, ``failures`` those that came to nothing.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._pool: ProcessPoolExecutor | None = None
        self._processes: list[BaseProcess] = []
        self._running: dict[Key, _Running] = {}
        self._rests: dict[Key, float] = {}
        self.skipped = self.failures = 0

    @property
    def waiting(self) -> int:
        """Questions under way."""
        return sum(not one.future.done() for one in self._running.values())

    @property
    def lateness(self) -> float:
        """How long the oldest question has waited [s]; 0 if none does."""
        submitted = [one.submitted_at for one in self._running.values() if not one.future.done()]
        return monotonic() - min(submitted) if submitted else 0.0

    @property
    def process_ids(self) -> list[int]:
        """Of the process, if it runs."""
        return [process.pid for process in self._processes if process.pid is not None]

    def is_under_way(self, key: Key) -> bool:
        """Whether the answer of this key is still to come."""
        return key in self._running and not self._running[key].future.done()

    def has_room(self, key: Key) -> bool:
        """Whether a question of this key would be taken; if it is for want of room that it would not, that counts."""
        if key in self._running or self._rests.get(key, 0.0) > monotonic():
            return False
        if len(self._running) >= _MOST_WAITING:
            self.skipped += 1
            return False
        return True

    def submit(self, key: Key, function: Callable[[Any], Any], question: Any) -> bool:
        """Begin to work out ``function(question)``, if there is room; returns whether it was begun."""
        if not self.has_room(key):
            return False
        if self._pool is None:
            # Not forked: a copy of this process with its ROS threads would not work.
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(
                max_workers=1, mp_context=context, initializer=_begin, initargs=(os.getpid(),)
            )
        others = multiprocessing.active_children() if not self._processes else []
        try:
            with contextlib.nullcontext() if self._processes else without_interrupts():
                future = self._pool.submit(function, question)
            self._running[key] = _Running(question, future, self._pool, monotonic())
            if not self._processes:
                # Begun by the first question; nobody else begins one meanwhile.
                self._processes = [one for one in multiprocessing.active_children() if one not in others]
        except BrokenProcessPool:
            # Killed a moment ago, by a shortage of memory perhaps: the next question begins another.
            self._lose(self._pool)
            return False
        except (OSError, RuntimeError) as error:
            # No process could be begun: too little memory, too many processes.
            self.failures += 1
            self._rests[key] = monotonic() + _REST
            self._warn(f"no process for slow work can be begun: {error!s:.200}")
            self._end()
            return False
        return True

    def pop_result(self, key: Key) -> Done | None:
        """What became of the question of this key, once: None if it is under way, or there is none."""
        running = self._running.get(key)
        if running is None or not running.future.done():
            return None
        del self._running[key]
        try:
            return Done(running.question, running.future.result())
        except BrokenProcessPool:
            self._lose(running.pool)
        except Exception as error:
            # Whatever it was, the joints are watched on without an answer.
            self.failures += 1
            self._rests[key] = monotonic() + _REST
            self._warn(f"{' of '.join(key)} failed: {type(error).__name__}: {error}")
        return Done(running.question, None, failed=True)

    def _lose(self, pool: ProcessPoolExecutor) -> None:
        self.failures += 1
        if pool is self._pool:
            self._warn("the process for slow work ended unexpectedly; another one is begun")
            self._end()

    def close(self) -> None:
        """End the process, whatever it does."""
        self._end()
        self._running.clear()

    def _end(self) -> None:
        if self._pool is None:
            return
        for process in self._processes:
            with contextlib.suppress(OSError, ValueError):
                process.kill()
        if sys.version_info < (3, 12):
            # A question that is being sent would wait for ever for the rest of it to be read; newer ones see to it.
            self._pool._call_queue._reader.close()  # type: ignore[attr-defined]
        # While the pool closes its pipes, the end of Python would stumble over them, and hang.
        closing = Thread(target=self._pool.shutdown, kwargs={"cancel_futures": True}, daemon=True)
        closing.start()
        closing.join(_LAST_WAIT)
        self._pool, self._processes = None, []


def _begin(parent: int) -> None:
    os.nice(_NICE)
    die_with_parent(parent)


class Background(Generic[Question, Answer]):
    """Questions of one kind, each under a name.

    Parameters
    ----------
    kind : of question, in words. answer : answers it; a function of a module, as another process has to find it.
    """

    def __init__(self, work: SlowWork, kind: str, answer: Callable[[Question], Answer]) -> None:
        self._work, self._kind, self._answer = work, kind, answer
        self._answers: dict[str, tuple[Question, Answer]] = {}

    def latest(self, name: str) -> tuple[Question, Answer] | None:
        """The last question of this name that was answered, and its answer."""
        done = self._work.pop_result((self._kind, name))
        if done is not None and not done.failed:
            self._answers[name] = (done.question, done.answer)
        return self._answers.get(name)

    def under_way(self, name: str) -> bool:
        """Whether a question of this name is being answered."""
        return self._work.is_under_way((self._kind, name))

    def submit(self, name: str, question: Question) -> None:
        """Begin to answer, unless a question of this name is under way: then it is to be asked again."""
        self._work.submit((self._kind, name), self._answer, question)
