# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Ctrl-C in the middle of long work."""

from __future__ import annotations

import signal
import subprocess
import sys

from stickslip_ros.cli.progress import progress_bar

LOST = """
import os, signal
from stickslip_ros.cli.progress import progress_bar

class Finalized:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

with progress_bar("working") as tell:
    tell(1, 3)
    Finalized()
    print("went on", flush=True)
    tell(2, 3)
    print("too far", flush=True)
"""


def test_an_interrupt_in_a_finalizer_is_not_lost() -> None:
    """Issue 6, item 5: an interrupted run ends, also where Python drops the exception: the next step raises it."""
    done = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "went on\n"
    assert done.stderr.rstrip().endswith("KeyboardInterrupt")
    assert done.returncode != 0


def test_the_handler_is_given_back() -> None:
    """Issue 6: whoever handled Ctrl-C before handles it afterwards."""
    before = signal.getsignal(signal.SIGINT)
    with progress_bar("working") as tell:
        tell(1, 1)
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before
