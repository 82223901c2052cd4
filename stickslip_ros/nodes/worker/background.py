# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Questions that are asked again and again while the last answer serves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from stickslip_ros.nodes.worker.process import SlowWork

Question = TypeVar("Question")
Answer = TypeVar("Answer")


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
