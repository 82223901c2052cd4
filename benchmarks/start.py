# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The first minute: compiling everything, the commands with a warm cache, and the monitor's memory.

As a command: python -m benchmarks.start
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from stickslip_ros.cli.processes import NodeProcess, isolate

_STICKSLIP = [sys.executable, "-m", "stickslip_ros.cli.main"]
_IMPORT = [sys.executable, "-c", "import numpy, numba"]
_REPEATS = 5
_SETTLED = 30.0  # [s] after which the monitor has learnt its first slips


def _processor(command: list[str], **more: str) -> tuple[float, float]:
    """Processor time and duration of a command, with the processes that it starts [s]."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env={**os.environ, **more})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, time.perf_counter() - begin


def run() -> None:
    """All of it."""
    with tempfile.TemporaryDirectory() as folder:
        processor, duration = _processor([*_STICKSLIP, "warm-up"], NUMBA_CACHE_DIR=folder)
    print(
        f"compiling everything, once         {processor:8.1f} s of processor, {duration:.1f} s, {os.cpu_count()} cores"
    )
    joint = ["--model", "puma560_joint1", "--velocity", "0.003"]
    bare = min(_processor(_IMPORT)[0] for _ in range(_REPEATS))
    for name, command in (("--help", ["--help"]), ("margin", ["margin", *joint])):
        own = min(_processor([*_STICKSLIP, *command])[0] for _ in range(_REPEATS))
        print(f"stickslip {name:24} {own:8.2f} s of processor, {own / bare:5.2f} x import numpy, numba")
    _memory()


def _memory() -> None:
    isolate()
    names = ", ".join(f"joint{number}" for number in range(1, 8))
    moving = {f"velocity.joint{number}": 0.2 for number in range(2, 8)}
    quiet = {"state_file": "none", "controller": "/simulated_joint"}
    with NodeProcess("simulated_joint", {"joints": f"[{names}]", **moving}), NodeProcess("monitor", quiet) as monitor:
        time.sleep(_SETTLED)
        status = Path(f"/proc/{monitor.pid}/status").read_text()
    kilobytes = {
        line.split(":")[0]: int(line.split()[1]) for line in status.splitlines() if line.startswith(("VmRSS", "Rss"))
    }
    print(
        f"monitor of 7 joints, one learnt     {kilobytes['VmRSS'] / 1e3:7.0f} MB, "
        f"of which {kilobytes['RssFile'] / 1e3:.0f} MB are libraries that processes share"
    )


if __name__ == "__main__":
    run()
