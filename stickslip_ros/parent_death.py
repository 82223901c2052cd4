# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Processes that end with the one that started them, however that ends."""

from __future__ import annotations

import ctypes
import os
import signal

NICENESS = 10  # niceness of processes in the background, steps: everything else on the robot comes first
_PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int | None = None) -> None:
    """Let the kernel end this process when its parent ends; call in the child.

    Parameters
    ----------
    parent : process id; if it is given and has ended already, this process ends at once.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if parent is not None and os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)
