# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: a command that is ended takes with it what it had begun, and one that cannot end is not begun."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stickslip_ros.bags.simulated import recording_size
from stickslip_ros.cli.main import main

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "number"), [("a.mcap", signal.SIGTERM), ("folder", signal.SIGTERM), ("folder", signal.SIGINT)]
)
def test_nothing_is_left(name: str, number: signal.Signals, tmp_path: Path) -> None:
    """Neither a file nor a folder; the exit status is the signal's."""
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "simulate", "--duration", "100000", "--out"]
    with subprocess.Popen([*command, str(tmp_path / name)], stderr=subprocess.PIPE) as process:
        until = time.monotonic() + 60.0
        while not [one for one in tmp_path.rglob("*.part") if one.stat().st_size] and time.monotonic() < until:
            time.sleep(0.02)
        assert process.poll() is None
        process.send_signal(number)
        _, complaint = process.communicate(timeout=20.0)
    assert process.returncode == 128 + number
    assert b"Traceback" not in complaint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_within_a_callback_is_not_lost(number: signal.Signals) -> None:
    """An event loop, as of `watch --browser`, lets it out: once swallowed, it would be ignored for ever."""
    code = f"""
import asyncio, os, signal, sys
from stickslip_ros.cli.ending import Ended, ended_by_exception
signal.signal({int(number)}, signal.SIG_DFL)  # nohup ignores it
loop = asyncio.new_event_loop()
loop.call_soon(os.kill, os.getpid(), {int(number)})
loop.call_later(10.0, loop.stop)
try:
    with ended_by_exception():
        loop.run_forever()
except Ended as ended:
    sys.exit(ended.status)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 128 + number, done.stderr


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--duration", "1e9"], "so short that the recording has room"),
        (["--duration", "1000", "--rate", "1e9"], "so short that the recording has room"),
        (["--duration", "3e9", "--rate", "1e-6"], "<= 2147483646 s: a stamp has no more seconds"),
        (["--duration", "inf"], "finite and > 0"),
        (["--duration", "nan"], "finite and > 0"),
    ],
)
def test_what_cannot_be_is_refused(
    arguments: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is written, with the rule."""
    assert main(["simulate", "--out", str(tmp_path / "a.mcap"), *arguments]) == 2
    assert f"'--duration' must be {reason}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("names", ["a", "a,b,c,d,e,f,a_joint_of_a_long_name"])
def test_sizes_are_told_ahead(names: str, tmp_path: Path) -> None:
    """A recording is no larger than was said, and without compression not much smaller."""
    path = tmp_path / "a.mcap"
    options = ["--duration", "5", "--compression", "none", "--position-noise", "1e-5", "--names", names]
    assert main(["simulate", "--out", str(path), *options]) == 0
    said = recording_size(names.split(","), 5.0, 1000.0)
    assert 0.5 * said < path.stat().st_size <= said
