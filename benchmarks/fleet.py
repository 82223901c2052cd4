# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Many bags on a Dask cluster of two worker processes, against one process.

As a command: python -m benchmarks.fleet [BAGS [SECONDS]]

The workers are started, and have read a bag or two, before the clock runs: a cluster is there anyway. One process is
warmed up likewise. Dask's own profiler, which looks at the workers a hundred times a second, is switched off.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

import dask
from distributed import Client, LocalCluster

from benchmarks.recordings import write_arm
from stickslip_ros.analysis.analysis import AnalysisOptions
from stickslip_ros.analysis.fleet import analyze_fleet

_BAGS, _SECONDS = 200, 20.0
_RATE, _WORKERS = 200.0, 2


def run(bags: int = _BAGS, seconds: float = _SECONDS) -> None:
    """Arms of seven joints, one of which sticks."""
    options = AnalysisOptions()
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{number:03d}.mcap" for number in range(bags)]
        write_arm(paths[0], seconds, 1, _RATE)
        for path in paths[1:]:
            shutil.copy(paths[0], path)
        analyze_fleet(paths[:1], options)
        begin = time.perf_counter()
        alone = analyze_fleet(paths, options)
        one = time.perf_counter() - begin
        dask.config.set({"distributed.worker.profile.enabled": False})
        cluster = LocalCluster(
            n_workers=_WORKERS, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", silence_logs=50
        )
        with cluster, Client(cluster.scheduler_address):
            address = cluster.scheduler_address
            analyze_fleet(paths[: 2 * _WORKERS], options, scheduler=address)
            begin = time.perf_counter()
            together = analyze_fleet(paths, options, scheduler=address)
            two = time.perf_counter() - begin
    assert together == alone
    print(
        f"{bags} bags of {seconds:g} s, 7 joints at {_RATE:g} Hz, one sticking: {one:.1f} s in one process, "
        f"{two:.1f} s on Dask with {_WORKERS} workers: {one / two:.2f} times as fast"
    )


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else _BAGS, float(sys.argv[2]) if len(sys.argv) > 2 else _SECONDS)
