# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Many bags: here, in processes, on a cluster of real workers; with broken bags, dead workers, interruptions."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pyarrow.parquet
import pytest
from browser import browser
from conftest import LIMIT
from distributed import Client, LocalCluster
from support_bags import sticking

from stickslip_ros.analysis.analysis import AnalysisOptions
from stickslip_ros.analysis.fleet import analyze_fleet, find_bags
from stickslip_ros.bags.simulated import write_simulation
from stickslip_ros.cli.main import main
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

_WEEK = 7 * 86_400.0
_OPTIONS = AnalysisOptions(parameters=Parameters({"learn": False, "model.*": "puma560_joint1"}))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots, three weeks, one bag that is none."""
    root = tmp_path_factory.mktemp("fleet")
    for robot in ("robot1", "robot2"):
        (root / robot).mkdir()
        for week in range(3):
            write_simulation(
                root / robot / f"week{week}.mcap", {"shoulder": sticking(0.007), "wrist": sticking(0.05)},
                duration=9.0, rate=200.0, start=1.79e9 + week * _WEEK, seed=week,
            )  # fmt: skip
    write_simulation(root / "robot2" / "directory", {"shoulder": sticking(0.007)}, duration=5.0, rate=200.0)
    (root / "robot1" / "broken.mcap").write_bytes(b"no bag at all")
    return root


@pytest.fixture(scope="module")
def alone(fleet: Path) -> str:
    """What one process finds in the fleet, as JSON."""
    return json.dumps(analyze_fleet(find_bags([fleet]), _OPTIONS))


def printed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Exit status, output and errors of `stickslip analyze`."""
    status = main(["analyze", *arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_bags_are_found_in_folders(fleet: Path) -> None:
    """Issue 6, item 5: a folder stands for the bags in it; a rosbag2 directory is one bag."""
    found = [str(path.relative_to(fleet)) for path in find_bags([fleet])]
    assert len(found) == 8
    assert "robot2/directory" in found
    assert not any("directory_0" in name for name in found)
    assert find_bags([fleet / "robot2" / "directory"]) == [fleet / "robot2" / "directory"]


def test_processes_give_the_same_bytes(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6, item 5: --jobs N gives what one process gives; one broken bag does not stop the rest."""
    common = [str(fleet), "--json", "--no-learning", "--model", "puma560_joint1"]
    status, alone, errors = printed(common, capsys)
    assert status == 2
    (complaint,) = [line for line in errors.splitlines() if line.startswith("stickslip: ")]
    assert "broken.mcap" in complaint
    bags = json.loads(alone)["bags"]
    assert [("error" in bag) for bag in bags].count(True) == 1
    assert len(bags) == 8
    _, together, _ = printed([*common, "--jobs", "2"], capsys)
    assert together == alone


def test_tables_and_trends(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6, item 5: a summary table over robots, joints and time; Parquet and CSV; a page with trends."""
    common = [str(fleet), "--results", str(tmp_path / "results")]
    parquet, table, page = tmp_path / "fleet.parquet", tmp_path / "fleet.csv", tmp_path / "fleet.html"
    status, out, _ = printed([*common, "--table", str(parquet), "--html", str(page)], capsys)
    assert status == 2
    assert "robot1" in out
    assert "shoulder" in out
    rows = pyarrow.parquet.read_table(parquet).to_pylist()
    assert len(rows) == 6 * 2 + 1 + 1
    assert {row["robot"] for row in rows} == {"robot1", "robot2"}
    shoulder = [row for row in rows if row["robot"] == "robot1" and row["joint"] == "shoulder"]
    assert [row["status"] for row in shoulder] == ["stick_slip"] * 3
    assert shoulder[1]["recorded"] - shoulder[0]["recorded"] == pytest.approx(_WEEK, abs=1.0)
    known = [row["coulomb_and_load"] for row in shoulder if row["coulomb_and_load_identified"]]
    assert known == pytest.approx([8.43] * len(known), rel=0.1)
    assert len(known) >= 2
    # From the answers that were kept: the same table, and nothing is analysed again.
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "results").glob("*.json")}
    printed([*common, "--table", str(table)], capsys)
    assert {} != kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "results").glob("*.json")}
    with table.open(newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(rows)
    with browser() as view:
        view.open(page)
        assert "Stick-slip in 8 recordings" in view.run("return document.body.textContent")
        assert view.run("return document.querySelectorAll('.plot').length") >= 4
        assert view.run("return Bokeh.documents[0].roots().length") >= 4
        assert view.complaints() == []


def interrupted(arguments: list[str], results: Path) -> int:
    """Exit status of a command that gets Ctrl-C when it has kept two answers."""
    command = [sys.executable, "-m", "stickslip_ros.cli.main", *arguments]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + LIMIT
    while len(list(results.glob("*.json"))) < 2 and run.poll() is None:
        assert time.monotonic() < until
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    return run.wait(LIMIT)


def test_an_interrupted_run_resumes(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6, item 5: what was analysed before the interruption is kept; a changed bag or option is analysed anew."""
    # Where this process waits for a processor too long, nothing is left to interrupt.
    for attempt in range(5):
        results = tmp_path / f"results{attempt}"
        status = interrupted(["analyze", str(fleet), "--no-learning", "--results", str(results), "--json"], results)
        kept = {path: path.stat().st_mtime_ns for path in results.glob("*.json")}
        if len(kept) < 7:
            break
    # A shell sees 130 either way: Python ends itself by the signal if it came while in some extension modules.
    assert status in (130, -signal.SIGINT)
    assert 2 <= len(kept) < 7
    _, resumed, _ = printed([str(fleet), "--no-learning", "--results", str(results), "--json"], capsys)
    assert all(path.stat().st_mtime_ns == time_ for path, time_ in kept.items())
    assert len(list(results.glob("*.json"))) == 7
    _, fresh, _ = printed([str(fleet), "--no-learning", "--json"], capsys)
    assert resumed == fresh
    printed([str(fleet), "--results", str(results), "--json", "--end", "5", "--no-learning"], capsys)
    assert len(list(results.glob("*.json"))) == 14


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a real Dask scheduler with two worker processes on this machine, which are begun anew if killed."""
    # Any free port for its pages: even without a dashboard it would be 8787, which others may have.
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0", host="127.0.0.1",
        silence_logs=50,
    ) as local:  # fmt: skip
        yield local.scheduler_address


def test_a_cluster_gives_the_same_bytes(fleet: Path, alone: str, cluster: str) -> None:
    """Issue 6: a Dask cluster of two worker processes gives byte-identical results to one process."""
    assert json.dumps(analyze_fleet(find_bags([fleet]), _OPTIONS, scheduler=cluster)) == alone


def test_a_killed_worker_loses_nothing(fleet: Path, alone: str, cluster: str) -> None:
    """Issue 6: a worker of the cluster that is killed in mid-run loses nothing."""
    with Client(cluster) as client:
        workers = list(client.run(os.getpid).values())
        killed = []

        def kill_one(done: int, total: int) -> None:
            if done >= 2 and not killed:
                os.kill(workers[0], signal.SIGKILL)
                killed.append(total)

        found = analyze_fleet(find_bags([fleet]), _OPTIONS, scheduler=cluster, progress=kill_one)
    assert killed
    assert json.dumps(found) == alone


def test_a_killed_process_loses_nothing(fleet: Path, alone: str) -> None:
    """Issue 6, item 5: on one machine neither: the bags of a process that was killed are given to another."""
    import multiprocessing

    killed = []

    def kill_one(done: int, total: int) -> None:
        children = multiprocessing.active_children()
        if done >= 2 and not killed and children:
            os.kill(children[0].pid, signal.SIGKILL)
            killed.append(total)

    found = analyze_fleet(find_bags([fleet]), _OPTIONS, jobs=2, progress=kill_one)
    assert killed
    assert json.dumps(found) == alone


def test_a_process_that_dies_stops_no_other_for_ever(tmp_path: Path) -> None:
    """The other one is asked to end in the middle of a bag; it handed that on as its answer, and waited for more."""
    for name in "ab":
        joints = {joint: sticking(0.007) for joint in ("x", "y", "z")}
        write_simulation(tmp_path / f"{name}.mcap", joints, duration=60.0, rate=1000.0)
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "analyze", str(tmp_path), "--jobs", "2", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            until = time.monotonic() + LIMIT
            while len(reading := _reading(process.pid)) < 2:
                assert time.monotonic() < until
            reading[0].kill()
            found = json.loads(process.communicate(timeout=LIMIT)[0])
        finally:
            process.kill()
    assert [bag.get("error") for bag in found["bags"]] == [None, None]


def _reading(parent: int) -> list[psutil.Process]:
    """The processes of a command that have a bag open."""
    found = []
    for one in psutil.Process(parent).children():
        with suppress(psutil.Error):
            found += [one] if any(file.path.endswith(".mcap") for file in one.open_files()) else []
    return found


def test_a_scheduler_that_is_not_there(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6, bad input: no scheduler at the address is said in one line."""
    status, _, errors = printed([str(fleet), "--scheduler", "tcp://127.0.0.1:1"], capsys)
    assert status == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:1" in errors


def test_an_address_that_is_none_leaves_no_client(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A client that was half made waited for ten seconds when it was thrown away, in whatever ran then."""
    before = threading.active_count()
    status, _, errors = printed([str(fleet), "--scheduler", "nonsense,"], capsys)
    assert status == 2
    assert "no Dask scheduler answers at nonsense,: missing port number" in errors
    assert threading.active_count() == before
