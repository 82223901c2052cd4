# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip demo`, as a process of its own with its nodes."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import LIMIT, nightly
from matplotlib.image import imread

from stickslip_ros.cli.main import main

COMMAND = [sys.executable, "-m", "stickslip_ros.cli.main", "demo"]


def processes_on(domain: int) -> list[str]:
    """Command lines of nodes of ours that run with this ROS_DOMAIN_ID."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = (folder / "environ").read_bytes()
            command = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if f"ROS_DOMAIN_ID={domain}\0".encode() in environment and "stickslip_ros.nodes" in command:
            found.append(command)
    return found


@pytest.mark.nightly
def test_the_main_job(ros_domain: int, tmp_path: Path) -> None:
    """Issue 2: stick-slip, advice, gains set, smooth, a picture, exit status 0, no process left."""
    picture = tmp_path / "demo.png"
    done = subprocess.run([*COMMAND, "--out", picture], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    for text in ("Stick-slip: ", "Advice: raise the", "Smooth: no cycle", "joint1: it helped: ", str(picture)):
        assert text in done.stdout
    # What the joint is commanded is said before its status.
    assert done.stdout.index("The joint is commanded") < done.stdout.index("Once a second")
    # Issue 15: told early, and never an advice without words.
    told = re.search(r"Stick-slip: (\d+) cycles", done.stdout)
    assert told is not None
    assert int(told[1]) <= 6
    # The table has the slips of the lines but those of the ramp.
    lines, table = re.findall(r"slips +(\d+)  ", done.stdout), re.search(r"cycles +(\d+) +(\d+)", done.stdout)
    between = re.search(r"\((\d+) slips while the gains rose are in neither\)", done.stdout)
    assert table is not None
    assert between is not None
    assert int(table[1]) + int(between[1]) + int(table[2]) == int(lines[-1])
    assert imread(picture).shape[0] > 500
    assert processes_on(ros_domain) == []


@pytest.mark.parametrize("number", [signal.SIGINT, nightly(signal.SIGTERM), nightly(signal.SIGKILL)])
def test_interrupted_it_leaves_no_process_behind(ros_domain: int, tmp_path: Path, number: signal.Signals) -> None:
    """Issue 2: Ctrl-C (or worse) ends the nodes too."""
    process = subprocess.Popen(
        [*COMMAND, "--out", tmp_path / "demo.png"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + LIMIT
    while len(processes_on(ros_domain)) < 2:
        assert time.monotonic() < until
        time.sleep(0.05)
    process.send_signal(number)
    assert process.wait(LIMIT) != 0
    until = time.monotonic() + LIMIT
    while processes_on(ros_domain):
        assert time.monotonic() < until, processes_on(ros_domain)
        time.sleep(0.05)


@pytest.mark.nightly
def test_a_recorded_joint(ros_domain: int, tmp_path: Path) -> None:
    """Issue 2: `stickslip demo --recording` shows a real machine."""
    picture = tmp_path / "slider.png"
    done = subprocess.run(
        [*COMMAND, "--recording", "slider", "--speed", "24", "--out", picture],
        capture_output=True, text=True, timeout=LIMIT, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "stick-slip cycles" in done.stdout
    assert picture.exists()


@pytest.mark.nightly
def test_what_compensation_does(ros_domain: int, tmp_path: Path) -> None:
    """Issue 23: stick-slip that feed-forward does not cure, reversals that it does, and what too much feedback does."""
    picture = tmp_path / "compensation.png"
    done = subprocess.run(
        [*COMMAND, "--compensation", "--out", picture], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    for text in ("it sticks as before: slips of", "it stands for", "Fed forward at 50 %", "it stops and slips by"):
        assert text in done.stdout
    assert imread(picture).shape[0] > 500
    assert processes_on(ros_domain) == []


def test_a_recording_cannot_be_compensated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused before anything begins."""
    assert main(["demo", "--compensation", "--recording", "slider", "--out", str(tmp_path / "x.png")]) == 2
    assert "--compensation and --recording exclude each other" in capsys.readouterr().err
