# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Why statuses were late: what was measured meanwhile, and the sentence that it allows."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

_MOST_OF_A_CORE = 0.8
_BUSY = 0.9  # of all cores
_WAITED = 0.2  # of the time, for a processor
_CLOCK_STEP = 0.1  # [s]


@dataclass(frozen=True, kw_only=True)
class Meters:
    """Readings at one time.

    Attributes
    ----------
    steady, system : clocks [s]. used : processor time of this process [s].
    waited : time that its main thread was ready to run and did not [s]. busy, all : time of all cores [s].
    """

    steady: float
    system: float
    used: float
    waited: float
    busy: float
    all: float

    @staticmethod
    def read() -> Meters:
        """Read them now; what the system does not tell stands still."""
        busy, total = _cores()
        return Meters(
            steady=time.monotonic(),
            system=time.time(),
            used=time.process_time(),
            waited=_waited(),
            busy=busy,
            all=total,
        )


def why_late(begin: Meters, end: Meters, *, late: float, delays: int, joints: int, load: float, cores: int) -> str:
    """A sentence for people.

    Parameters
    ----------
    begin, end : readings. late : the longest that a status took between them [s]. delays : how many were late.
    load : average number of processes that want to run [1].
    """
    duration = max(end.steady - begin.steady, 1e-9)
    own, waited = (end.used - begin.used) / duration, (end.waited - begin.waited) / duration
    busy = (end.busy - begin.busy) / (end.all - begin.all) if end.all > begin.all else 0.0
    step = (end.system - begin.system) - (end.steady - begin.steady)
    symptom = f"statuses were up to {late:.2g} s late: "
    here = f"with {100 * own:.0f} % of a core used here"
    if abs(step) > _CLOCK_STEP:
        return f"{symptom}the system's clock was set by {step:+.2g} s meanwhile"
    if own >= _MOST_OF_A_CORE:
        return f"{symptom}this node uses {100 * own:.0f} % of a core for {joints} joint{'s' if joints != 1 else ''}"
    if waited >= _WAITED or busy >= _BUSY:
        return f"{symptom}the machine is busy with other processes (load {load:.1f} on {cores} cores), {here}"
    return f"{symptom}{'one delay' if delays == 1 else f'{delays} delays'}, {here}"


def machine() -> tuple[float, int]:
    """The load of the last minute, and how many cores there are."""
    try:
        load = os.getloadavg()[0]
    except OSError:
        load = 0.0
    return load, os.cpu_count() or 1


def _waited() -> float:
    try:
        return int(Path("/proc/self/schedstat").read_text().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0


def _cores() -> tuple[float, float]:
    """Time that all cores were busy, and all of their time, since the system began [s]."""
    try:
        with open("/proc/stat") as file:
            counts = [int(word) for word in file.readline().split()[1:9]]
    except (OSError, ValueError):
        return 0.0, 0.0
    tick = os.sysconf("SC_CLK_TCK")
    idle = sum(counts[3:5])
    return (sum(counts) - idle) / tick, sum(counts) / tick
