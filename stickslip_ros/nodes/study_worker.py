# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Studies of slips in a process of their own: they take seconds, and Python's threads share one lock."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from stickslip_ros.monitoring.friction_learner import FrictionLearner, Learnt, study

_NICE = 10  # what else runs on the robot comes first


class StudyWorker:
    """One process, begun with the first study; each joint has at most one study under way."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._running: dict[str, tuple[Future[Learnt | None], ProcessPoolExecutor]] = {}
        self.failures = 0

    def attend(self, name: str, learner: FrictionLearner) -> None:
        """Take over what was found of a joint, and begin what is due."""
        if name in self._running:
            running, pool = self._running[name]
            if not running.done():
                return
            del self._running[name]
            try:
                learner.adopt(running.result())
            except BrokenProcessPool:
                # The process was killed, by a shortage of memory perhaps; the next study begins another.
                self.failures += 1
                learner.adopt(None)
                if pool is self._pool:
                    self._end()
        question = learner.wanted_study()
        if question is not None:
            if self._pool is None:
                # Not forked: a copy of this process with its ROS threads would not work.
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(
                    max_workers=1, mp_context=context, initializer=os.nice, initargs=(_NICE,)
                )
            self._running[name] = (self._pool.submit(study, question), self._pool)

    def close(self) -> None:
        """End the process, whatever it does."""
        self._end()
        self._running.clear()

    def _end(self) -> None:
        if self._pool is None:
            return
        processes = list((self._pool._processes or {}).values())
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        self._pool = None
