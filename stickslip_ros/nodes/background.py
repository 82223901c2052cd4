# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Work beside the node's own: one thread, and each name has at most one question under way."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Background(Generic[Question, Answer]):
    """Answers questions in a thread of its own.

    Parameters
    ----------
    answer : does the work. name : of the thread.
    """

    def __init__(self, answer: Callable[[Question], Answer], name: str) -> None:
        self._answer = answer
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        self._running: dict[str, tuple[Question, Future[Answer]]] = {}
        self._answers: dict[str, tuple[Question, Answer]] = {}

    def latest(self, name: str) -> tuple[Question, Answer] | None:
        """The last question of this name that was answered, and its answer."""
        if name in self._running and self._running[name][1].done():
            question, future = self._running.pop(name)
            self._answers[name] = (question, future.result())
        return self._answers.get(name)

    def ask(self, name: str, question: Question) -> None:
        """Begin to answer, unless a question of this name is under way: then it is to be asked again."""
        if name not in self._running:
            self._running[name] = (question, self._pool.submit(self._answer, question))

    def close(self) -> None:
        """Drop the questions not begun."""
        self._pool.shutdown(wait=False, cancel_futures=True)
