# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Where commands print: names and messages of others appear as they are, and command no terminal."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.status import Status
from rich.table import Table

from stickslip_ros.interrupts import check
from stickslip_ros.visible import visible

_OF_LAYOUT = "\n"  # by which tables and paragraphs are made
_ENDLESS = 10_000  # columns: more than any table needs
COLOURS = {"stick_slip": "red", "at_risk": "yellow", "smooth": "green"}
_WIDTH = 120  # columns of tables, where no terminal has a width


class Terminal(Console):
    """A rich console whose texts hold no control characters but the ends of lines; what rich adds itself stays."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """See :meth:`rich.console.Console.render`."""
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                yield Segment(visible(segment.text, kept=_OF_LAYOUT), segment.style)

    def on_broken_pipe(self) -> None:
        """Drop the rest where a reader such as `head` has gone; rich would end the command with exit status 1, which
        says that a joint sticks.
        """
        self.quiet = True
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), self.file.fileno())


def console_of_text(*, stderr: bool = False) -> Console:
    """For texts, whose lines are as long as they are."""
    return Terminal(stderr=stderr, highlight=False, soft_wrap=True)


def console_of_tables(width: int = _WIDTH, *, stderr: bool = False) -> Console:
    """As wide as the terminal; where there is none, so many columns wide."""
    console = Terminal(stderr=stderr, highlight=False)
    return console if console.is_terminal else Terminal(stderr=stderr, highlight=False, width=width)


def working(text: str) -> Status:
    """What is worked out, on stderr, until it is done; a context manager."""
    return Terminal(stderr=True).status(f"{text} (after installation this compiles for ten seconds)")


def new_table(headings: Iterable[str], left: Container[str] = ("",), **more: Any) -> Table:
    """An empty table without lines; ``left``: headings of the columns of words, as all others are of numbers."""
    table = Table(box=None, **more)
    for heading in headings:
        table.add_column(escape(heading), justify="left" if heading in left else "right", no_wrap=True)
    return table


def width_of(console: Console, table: Table) -> int:
    """Columns that a table takes where nothing of it is cut or wrapped."""
    return Measurement.get(console, console.options.update(width=_ENDLESS), table).maximum


def fitting_table(
    console: Console, rows: Sequence[Mapping[str, str]], spared: Sequence[str], left: Container[str], **more: Any
) -> Table:
    """A table of rows, whose cells are by heading, that the console has room for: some headings may be spared."""

    def table(headings: Sequence[str]) -> Table:
        made = new_table(headings, left, **more)
        for row in rows:
            made.add_row(*[row[heading] for heading in headings])
        return made

    return table(fitting(console, rows[0], spared, table))


def fitting(
    console: Console, headings: Iterable[str], spared: Iterable[str], make: Callable[[Sequence[str]], Table]
) -> list[str]:
    """The headings that the console has room for.

    Parameters
    ----------
    spared : headings that a narrow console does without, the first one first. make : the table of some headings.
    """
    kept = list(headings)
    for heading in spared:
        if width_of(console, make(kept)) <= console.width:
            break
        kept.remove(heading)
    return kept


def number_text(value: float | None, form: str = ".3g", unit: str = "") -> str:
    """A number as tables have it; "-" for none."""
    return "-" if value is None or not math.isfinite(value) else f"{value:{form}}{unit}"


def status_text(word: str) -> str:
    """A status word in its colour."""
    return f"[{COLOURS.get(word, 'dim')}]{word}[/]"


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float, float], None]]:
    """A bar that is told what is done and of how much, and ends long work on Ctrl-C, whenever it comes. It is on
    stderr, so that stdout stays the answer's; nothing is drawn where that is no terminal.
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Terminal(stderr=True)
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar as progress:
        task = progress.add_task(text, total=None)

        def advance(done: float, total: float) -> None:
            check()
            progress.update(task, completed=done, total=total)

        yield advance


def print_warning(console: Console, text: str) -> None:
    """Print a warning, in which others may be named."""
    console.print(f"[yellow]warning:[/] {escape(visible(text))}", soft_wrap=True)


def complain(text: str) -> None:
    """Say in one line on stderr what is wrong."""
    print(f"stickslip: {visible(text)}", file=sys.stderr)
