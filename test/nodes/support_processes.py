# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What the system tells of other processes; one that has gone meanwhile is no error."""

from __future__ import annotations

import os
from pathlib import Path

_PROCESSES = Path("/proc")


def _told(pid: int, name: str) -> str:
    """A file of a process, "" if the process has gone."""
    try:
        return (_PROCESSES / str(pid) / name).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def children(pid: int) -> list[int]:
    """Process ids of those that it began and that are not over; none of one that has gone."""
    return [int(child) for child in _told(pid, f"task/{pid}/children").split()]


def command_line(pid: int) -> str:
    """The words that it was begun with, each ended by a NUL; "" of one that has gone."""
    return _told(pid, "cmdline")


def runs(pid: int) -> bool:
    """Whether a process is there, and not only its exit status."""
    return _told(pid, "stat").rpartition(")")[2].split()[:1] not in ([], ["Z"])


def memory(pid: int) -> float:
    """Resident [MB] of a process that is there."""
    return int(_told(pid, "statm").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def processor_time(pid: int) -> float:
    """Of a process that is there [s]."""
    fields = _told(pid, "stat").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
