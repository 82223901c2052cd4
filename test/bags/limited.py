# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Runs commands in processes with little memory and time: what they need is loaded once, then each is a fork.

A program of its own: `python limited.py`. Takes JSON lines on stdin, each an object with `arguments` and a `folder`
for the temporary files and for what is printed; answers with `status`, `seconds` and `megabytes`.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import lz4.frame  # noqa: F401
import rosbags.typesys  # noqa: F401
import zstandard  # noqa: F401

import stickslip_ros.cli.analyze
import stickslip_ros.cli.identify
import stickslip_ros.cli.simulate  # noqa: F401
from stickslip_ros.cli.main import main

MEMORY = 1_000_000_000  # bytes of address space, beside those that Python and its libraries have when they are loaded
SECONDS = 20


def _address_space() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _child(arguments: list[str], folder: Path) -> None:
    os.dup2(os.open(folder / "printed", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), 1)
    os.dup2(1, 2)
    tempfile.tempdir = str(folder)
    signal.alarm(SECONDS)
    space = _address_space() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (space, space))
    status = main(arguments)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _run(arguments: list[str], folder: Path) -> dict[str, Any]:
    began = time.monotonic()
    process = os.fork()
    if process == 0:
        try:
            _child(arguments, folder)
        finally:
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
            os._exit(99)
    _, status, usage = os.wait4(process, 0)
    seconds, megabytes = time.monotonic() - began, usage.ru_maxrss / 1e3
    return {"status": os.waitstatus_to_exitcode(status), "seconds": seconds, "megabytes": megabytes}


if __name__ == "__main__":
    for line in sys.stdin:
        task = json.loads(line)
        print(json.dumps(_run(task["arguments"], Path(task["folder"]))), flush=True)
