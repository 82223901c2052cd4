# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""How the demo waits for what it shows: bounded, with a line a second."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from rich.console import Console

from stickslip_ros.cli.analysis_tables import status_text
from stickslip_ros.cli.demo_log import DemoListener
from stickslip_ros.cli.processes import NodeProcess
from stickslip_ros.errors import StickSlipError
from stickslip_ros.output.published import RESERVE_FIELD

_COLUMNS = (
    "[dim]Once a second: position; number of slips so far; damping reserve, the damping in excess of that at which\n"
    "stick-slip ends (below 0 the joint sticks); and the monitor's status, which is of the last seconds of motion.[/]"
)


class Stage:
    """The nodes of a demo, and who listens to them.

    Parameters
    ----------
    unit : of the positions.
    """

    def __init__(self, console: Console, listener: DemoListener, nodes: Sequence[NodeProcess], unit: str) -> None:
        self._console, self._listener, self._nodes, self._unit = console, listener, nodes, unit
        self._next = time.monotonic() + 1.0
        self._start = math.nan

    def wait(self, reached: Callable[[], bool], limit: float, what: str) -> None:
        """Listen until the goal is reached, with a line a second on where things stand.

        Raises
        ------
        StickSlipError
            If the time limit [s] has passed, or a node has ended.
        """
        until = time.monotonic() + limit
        while not reached():
            self._listener.listen(0.1)
            self._show()
            for node in self._nodes:
                if not node.running:
                    raise StickSlipError(f"the node {node.module} ended: {last_line(node.output())}")
            if time.monotonic() > until:
                status = self._listener.status or "not heard"
                raise StickSlipError(f"waited {limit:.0f} s in vain for {what}; the joint is {status}")

    def _show(self) -> None:
        listener = self._listener
        if time.monotonic() < self._next or math.isnan(listener.now):
            return
        self._next = time.monotonic() + 1.0
        if math.isnan(self._start):
            self._start = listener.data.states[0][0]
            self._console.print(_COLUMNS)
        reserve = listener.data.margins[-1][RESERVE_FIELD] if listener.data.margins else math.nan
        text = f"reserve {100.0 * reserve:+5.0f} %" if math.isfinite(reserve) else "reserve     –  "
        reason = f": {listener.value('reason')}" if listener.value("reason") else ""
        self._console.print(
            f"  {listener.now - self._start:5.1f} s  position {1e3 * listener.data.states[-1][1]:9.2f} m{self._unit}  "
            f"slips {len(listener.data.cycles):3d}  {text}  "
            f"{status_text(listener.status or 'no status yet')}[dim]{reason}[/]"
        )


def last_line(text: str) -> str:
    """Of what a node printed."""
    return text.strip().splitlines()[-1] if text.strip() else "it said nothing"
