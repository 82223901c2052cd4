# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How the demo waits for what it shows: bounded, with a line a second."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from rich.console import Console

from stickslip_ros.cli.demo_log import DemoListener
from stickslip_ros.cli.processes import NodeProcess
from stickslip_ros.errors import StickSlipError
from stickslip_ros.output.margin_table import RESERVE

_COLUMNS = (
    "[dim]Once a second: position; cycles, which are the slips seen so far; the damping reserve, by which the damping\n"
    "exceeds what ends stick-slip, below 0 where it sticks; and the monitor's verdict on the motion, not_judged until\n"
    "it has seen enough of it.[/]"
)


class Ticker:
    """One line a second on where things stand."""

    def __init__(self, console: Console, listener: DemoListener, unit: str) -> None:
        self._unit = unit
        self._console = console
        self._listener = listener
        self._next = time.monotonic() + 1.0
        self._start = math.nan

    def __call__(self) -> None:
        """Print it, if it is time."""
        listener = self._listener
        if time.monotonic() < self._next or math.isnan(listener.now):
            return
        self._next = time.monotonic() + 1.0
        if math.isnan(self._start):
            self._start = listener.data.states[0][0]
            self._console.print(_COLUMNS)
        colour = {"stick_slip": "red", "smooth": "green", "at_risk": "yellow"}.get(listener.status, "dim")
        reserve = listener.data.margins[-1][RESERVE] if listener.data.margins else math.nan
        text = f"reserve {100.0 * reserve:+5.0f} %" if math.isfinite(reserve) else "reserve     –  "
        self._console.print(
            f"  {listener.now - self._start:5.1f} s  position {1e3 * listener.data.states[-1][1]:9.2f} m{self._unit}  "
            f"cycles {len(listener.data.cycles):3d}  {text}  [{colour}]{listener.status}[/]"
        )


def wait(
    listener: DemoListener,
    nodes: list[NodeProcess],
    reached: Callable[[], bool],
    limit: float,
    what: str,
    show: Callable[[], None] | None,
) -> None:
    """Listen until the goal is reached.

    Raises
    ------
    StickSlipError
        If the time limit [s] has passed, or a node has ended.
    """
    until = time.monotonic() + limit
    while not reached():
        listener.listen(0.1)
        if show is not None:
            show()
        for node in nodes:
            if not node.running:
                raise StickSlipError(f"the node {node.module} ended: {last_line(node.output())}")
        if time.monotonic() > until:
            raise StickSlipError(
                f"waited {limit:.0f} s in vain for {what}; the joint is {listener.status or 'not heard'}"
            )


def last_line(text: str) -> str:
    """Of what a node printed."""
    return text.strip().splitlines()[-1] if text.strip() else "it said nothing"
