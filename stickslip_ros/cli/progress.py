# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A progress bar on stderr, so that stdout stays the answer's; and an end of long work on Ctrl-C, whenever it comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from stickslip_ros.cli.terminal import Terminal
from stickslip_ros.interrupts import check


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float, float], None]]:
    """A bar that is told what is done and of how much; nothing is drawn where stderr is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Terminal(stderr=True)
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar as progress:
        task = progress.add_task(text, total=None)

        def advance(done: float, total: float) -> None:
            check()
            progress.update(task, completed=done, total=total)

        yield advance
