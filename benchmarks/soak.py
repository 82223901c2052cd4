# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Memory of the monitor under ten times the usual traffic, for as long as one likes: python -m benchmarks.soak MINUTES.

Seven joints at 1 kHz, one of them sticking: joint_state_broadcaster publishes at 100 Hz by default.
"""

from __future__ import annotations

import sys
import time

from benchmarks.node import resident, stream
from stickslip_ros.cli.processes import NodeProcess, isolate

_JOINTS, _RATE, _STICKING = 7, 1000.0, 1
_EVERY = 60.0  # [s]
_STREAM_BEGINS = 8.0  # [s], for the publisher works its motion out first


def run(minutes: float) -> None:
    """Print the resident memory every minute, and by how much it grew after the first."""
    isolate()
    with NodeProcess("monitor", {"joints": "['']"}) as monitor:
        time.sleep(4.0)
        with stream(_JOINTS, _RATE, 60.0 * minutes + 30.0, _STICKING):
            time.sleep(_STREAM_BEGINS)
            sizes = []
            for minute in range(round(minutes) + 1):
                if minute:
                    time.sleep(_EVERY)
                sizes.append(resident(monitor.pid))
                print(f"{minute:4d} min {sizes[-1]:7.1f} MB", flush=True)
    print(f"grown after the first minute: {sizes[-1] - sizes[1]:+.1f} MB")


if __name__ == "__main__":
    run(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
