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
from conftest import LIMIT, begun, nightly

from stickslip_ros.bags.simulated import recording_size
from stickslip_ros.cli.main import main

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "number"),
    [nightly("a.mcap", signal.SIGTERM), nightly("folder", signal.SIGTERM), ("folder", signal.SIGINT)],
)
def test_nothing_is_left(name: str, number: signal.Signals, tmp_path: Path) -> None:
    """Neither a file nor a folder; the exit status is the signal's."""
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "simulate", "--duration", "100000", "--out"]
    with begun([*command, str(tmp_path / name)], stderr=subprocess.PIPE) as process:
        until = time.monotonic() + LIMIT
        while not _written(tmp_path) and time.monotonic() < until:
            time.sleep(0.02)
        assert process.poll() is None
        process.send_signal(number)
        _, complaint = process.communicate(timeout=LIMIT)
    assert process.returncode == 128 + number
    assert b"Traceback" not in complaint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("options", "status"), [([], 0), (["--json"], 128 + signal.SIGPIPE)])
def test_a_reader_that_has_gone(options: list[str], status: int) -> None:
    """`| head` closes the pipe: exit status 1 would say that a joint sticks; where the command's own status is not
    known, 0 would say that none does.
    """
    command = [sys.executable, "-m", "stickslip_ros.cli.main", "margin", "--model", "puma560_joint1", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.wait(LIMIT) == status
        assert process.stderr.read() == b""


def _written(folder: Path) -> bool:
    """Whether something has been written; a file may be gone again between being found and being looked at."""
    try:
        return any(one.stat().st_size for one in folder.rglob("*.part"))
    except FileNotFoundError:
        return False


_LONG = """
import ctypes, sys
from pathlib import Path
from stickslip_ros.cli.main import main
from stickslip_ros.files import whole_file

def run(options):
    with whole_file(Path(options.file)) as file:
        file.write(b"half of it")
        file.flush()
        print("begun", flush=True)
        ctypes.PyDLL(None).sleep(1)  # as compiled code does, with Python's lock
        ctypes.CDLL(None).sleep(60)

sys.modules["stickslip_ros.cli.margin"] = type(sys)("margin")
sys.modules["stickslip_ros.cli.margin"].add_arguments = lambda parser: parser.add_argument("file")
sys.modules["stickslip_ros.cli.margin"].run = run
sys.argv[1:] = ["margin", *sys.argv[1:]]
sys.exit(main())
"""


@pytest.mark.parametrize("number", [nightly(signal.SIGINT), nightly(signal.SIGTERM), signal.SIGHUP])
def test_work_without_steps_ends_all_the_same(number: signal.Signals, tmp_path: Path) -> None:
    """Issue 35: where nothing asks whether a signal came, the process ends after two seconds, and nothing is left."""
    command = [sys.executable, "-c", _LONG, str(tmp_path / "a.json")]
    with begun(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=_not_ignored) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"begun\n"
        process.send_signal(number)
        _, complaint = process.communicate(timeout=LIMIT)
    assert process.returncode == 128 + number
    assert complaint == b""
    assert not list(tmp_path.iterdir())


_READ_MEANWHILE = """
import os, signal, sys, threading, time
from pathlib import Path
from stickslip_ros.bags.table import load_table
from stickslip_ros.interrupts import came, take_signals

def often():
    for _ in range(20):
        time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

take_signals()
threading.Thread(target=often, daemon=True).start()
table = load_table(Path(sys.argv[1]), [], 10**9)
assert came() == signal.SIGINT
"""


def test_reading_a_table_takes_no_signals(tmp_path: Path) -> None:
    """Issue 35: pyarrow cancels what it reads, and the table was said to be wrong: "received signal 2"."""
    table = tmp_path / "a.csv"
    table.write_text("time [s],position [rad]\n" + "".join(f"{n},{n}\n" for n in range(150_000)))
    done = subprocess.run([sys.executable, "-c", _READ_MEANWHILE, str(table)], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def _not_ignored() -> None:
    """As nohup would have it."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--duration", "3e8"], "so short that the recording has room"),
        (["--duration", "1000", "--rate", "1e9"], "so short that the recording has room"),
        (["--duration", "3e9", "--rate", "1e-6", "--first-stamp", "1"], "<= 2147483646 s: a stamp has no more seconds"),
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
