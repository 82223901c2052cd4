# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Work that takes up to seconds, in a process of its own: Python's threads share one lock, and intake needs it.

Advice by Eq. (43) takes ten milliseconds, exact advice up to seconds; an exact verdict takes milliseconds, and seconds
for some controllers.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing.process import BaseProcess
from threading import Thread
from time import monotonic, process_time
from typing import Any, Generic, TypeVar

from stickslip_ros.compilation import without_linear_algebra
from stickslip_ros.interrupts import without_interrupts
from stickslip_ros.model.conditions import OperatingConditions
from stickslip_ros.model.friction import Gains
from stickslip_ros.model.verdict import ExactVerdict
from stickslip_ros.monitoring.advice.adviser import advise
from stickslip_ros.monitoring.advice.recommendation import Advice
from stickslip_ros.monitoring.assessment import NOT_COMPUTED, AdviceQuestion, Adviser, Assessment, ExactQuestion
from stickslip_ros.monitoring.friction.learner import FrictionLearner
from stickslip_ros.monitoring.study import study
from stickslip_ros.parent_death import NICENESS, die_with_parent

_MOST_WAITING = 64  # number of questions under way, 1: further ones would be answered too late
_REST = 5.0  # time after a failure of a question, s: the next one of its key is likely to fail too
_LAST_WAIT = 0.5  # wait for the pool to close, s: it takes milliseconds

Key = tuple[str, str]
Question = TypeVar("Question")
Answer = TypeVar("Answer")
_SHARE = 0.1  # of a core, 1: what answers take at most that follow gains, friction and speed while these change
_KIND = "study"


@dataclass(frozen=True)
class _Running:
    question: Any
    future: Future[Any]
    pool: ProcessPoolExecutor
    submitted_at: float


class SlowWork:
    """One process, begun with the first question; each key has at most one question under way.

    Parameters
    ----------
    warn : called with a sentence on each failure.

    ``skipped`` counts questions for which there was no room, ``failures`` questions that were not answered.
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
        """Identifier of the process, if it runs."""
        return [process.pid for process in self._processes if process.pid is not None]

    def is_under_way(self, key: Key) -> bool:
        """Whether the answer of this key is still to come."""
        return key in self._running and not self._running[key].future.done()

    def has_room(self, key: Key) -> bool:
        """Whether a question of this key can be submitted; a want of room is counted in ``skipped``."""
        if key in self._running or self._rests.get(key, 0.0) > monotonic():
            return False
        if len(self._running) >= _MOST_WAITING:
            self.skipped += 1
            return False
        return True

    def submit(self, key: Key, function: Callable[[Any], Any], question: Any) -> bool:
        """Begin to compute ``function(question)``, if there is room; returns whether it was begun."""
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
                future = self._pool.submit(_timed, function, question)
            self._running[key] = _Running(question, future, self._pool, monotonic())
            if not self._processes:
                # The first question begins the process; no other process is begun meanwhile.
                self._processes = [one for one in multiprocessing.active_children() if one not in others]
        except BrokenProcessPool:
            # The process was killed a moment ago; the next question begins another.
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

    def pop_result(self, key: Key) -> tuple[Any, Any, float] | None:
        """Question and answer of this key, once, and what the answer took of a core [s].

        The answer is None after an error; all is None if the question is under way, or there is none.
        """
        running = self._running.get(key)
        if running is None or not running.future.done():
            return None
        del self._running[key]
        try:
            return running.question, *running.future.result()
        except BrokenProcessPool:
            self._lose(running.pool)
        except Exception as error:
            # Whatever the error is, the joints are watched on without an answer.
            self.failures += 1
            self._rests[key] = monotonic() + _REST
            self._warn(f"{' of '.join(key)} failed: {type(error).__name__}: {error}")
        return running.question, None, 0.0

    def _lose(self, pool: ProcessPoolExecutor) -> None:
        self.failures += 1
        if pool is self._pool:
            self._warn("the process for slow work ended unexpectedly; another one is begun")
            self._end()

    def close(self) -> None:
        """End the process, even while it works."""
        self._end()
        self._running.clear()

    def _end(self) -> None:
        if self._pool is None:
            return
        for process in self._processes:
            with contextlib.suppress(OSError, ValueError):
                process.kill()
        if sys.version_info < (3, 11, 5):
            # A question that is being sent would wait for its reader for ever. Newer Pythons close the pipe themselves,
            # in another thread: closed twice at once, the descriptor could be one that has just been given to a socket.
            self._pool._call_queue._reader.close()  # type: ignore[attr-defined]
        # While the pool closes its pipes, the end of Python would stumble over them, and hang.
        closing = Thread(target=self._pool.shutdown, kwargs={"cancel_futures": True}, daemon=True)
        closing.start()
        closing.join(_LAST_WAIT)
        self._pool, self._processes = None, []


def _timed(function: Callable[[Any], Any], question: Any) -> tuple[Any, float]:
    """What a function returns, and what it took of a core [s]."""
    began = process_time()
    return function(question), process_time() - began


def _begin(parent: int) -> None:
    os.nice(NICENESS)
    die_with_parent(parent)
    without_linear_algebra()


class Background(Generic[Question, Answer]):
    """Questions of one kind, each under a name, when they were submitted, and the last answers.

    Parameters
    ----------
    kind : name of the kind. answer : answers a question; a function of a module, which another process can import.
    """

    def __init__(self, work: SlowWork, kind: str, answer: Callable[[Question], Answer]) -> None:
        self._work, self._kind, self._answer = work, kind, answer
        self._answers: dict[str, tuple[Question, Answer]] = {}
        self._submitted_at: dict[str, float] = {}
        self._took: dict[str, float] = {}

    def latest(self, name: str) -> tuple[Question, Answer] | None:
        """The last question of this name that was answered, and its answer."""
        done = self._work.pop_result((self._kind, name))
        if done is not None:
            question, answer, self._took[name] = done
            if answer is not None:
                self._answers[name] = question, answer
        return self._answers.get(name)

    def under_way(self, name: str) -> bool:
        """Whether a question of this name is being answered."""
        return self._work.is_under_way((self._kind, name))

    def is_due(self, name: str, now: float) -> bool:
        """Whether to ask again, where that can wait: all answers together take a tenth of a core."""
        rest = len(self._took) * self._took.get(name, 0.0) / _SHARE
        return now - self._submitted_at.get(name, -math.inf) >= rest

    def submit(self, name: str, question: Question, now: float) -> None:
        """Begin to answer a question, unless one of this name is under way: it is then to be submitted again.

        Parameters
        ----------
        now : a steady time [s].
        """
        if self._work.submit((self._kind, name), self._answer, question):
            self._submitted_at[name] = now


class AdviceWorker:
    """Advisers of the joints."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[AdviceQuestion, Advice] = Background(work, "advice", advise)

    def adviser(self, name: str) -> Adviser:
        """Adviser of a joint's monitor: returns the latest advice, and begins to compute new advice where it is due."""

        def latest(question: AdviceQuestion) -> Advice | None:
            known = self._background.latest(name)
            if known is not None and known[0].similar(question):
                return known[1]
            # A ramp changes the gains all the time, learning the friction with every slip, and the speed may never be
            # the same twice. While the gains are the same, the latest advice is the best there can be.
            now = monotonic()
            if self._background.is_due(name, now):
                self._background.submit(name, question, now)
            return known[1] if known is not None and known[0].comparable(question) else None

        return latest


class ExactWorker:
    """Exact verdicts by name, computed again where joint, gains or speed have changed."""

    def __init__(self, work: SlowWork) -> None:
        self._background: Background[ExactQuestion, ExactVerdict] = Background(
            work, "exact verdict", ExactQuestion.verdict
        )

    def verdict_on(
        self, name: str, assessment: Assessment, gains: Gains | None, conditions: OperatingConditions, now: float
    ) -> ExactVerdict:
        """The verdict on an assessed joint, with gains that need not be the present ones.

        It is :data:`NOT_COMPUTED` until it is there.

        Parameters
        ----------
        name : name of the question. now : a steady time [s].
        """
        question = ExactQuestion.on(assessment, gains, conditions)
        if question is None:
            return NOT_COMPUTED
        known = self._background.latest(name)
        if known is None or not known[0].of_the_same_controller(question):
            self._background.submit(name, question, now)
            return NOT_COMPUTED
        before, verdict = known
        if not before.answers(question) and self._background.is_due(name, now):
            self._background.submit(name, question, now)
        # Learning changes the friction with every slip; the latest verdict is the best there can be.
        return verdict if before.at_the_same_speed(question) else NOT_COMPUTED

    def verdict_here(
        self, name: str, assessment: Assessment, conditions: OperatingConditions, now: float
    ) -> ExactVerdict | None:
        """The verdict at the present place or load, None where friction is not known to vary with these."""
        here = assessment.here
        if here is None:
            return None
        local = replace(assessment, joint=here, uncertainty=None)
        return self.verdict_on(name, local, local.margin_gains, conditions, now)


def attend_study(work: SlowWork, name: str, learner: FrictionLearner) -> None:
    """Pass a finished study to a joint's learner, and begin the next one that is due."""
    done = work.pop_result((_KIND, name))
    if done is not None:
        learner.adopt(done[1])
    if learner.study_is_due and work.has_room((_KIND, name)):
        question = learner.wanted_study()
        if question is not None and not work.submit((_KIND, name), study, question):
            learner.adopt(None)
