# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""`stickslip watch`: what it shows, and the command in a real terminal over real DDS."""

from __future__ import annotations

import math
import os
import pty
import re
import signal
import subprocess
import sys
import time
from io import StringIO

import numpy as np
import pytest
from conftest import LIMIT, begun
from hypothesis import given
from hypothesis import strategies as st
from nodes.forked_nodes import NodeProcess
from rich.console import Console

from stickslip_ros.cli.main import main
from stickslip_ros.cli.watch_view import JointView, sparkline, view
from stickslip_ros.output.diagnosis import Level

COMMAND = [sys.executable, "-m", "stickslip_ros.cli.main", "watch"]


def joint(name: str, level: Level = Level.OK, **more: object) -> JointView:
    history = np.array([[0.0, 0.0], [10.0, 0.1]])
    plain = {
        "status": "smooth",
        "message": "",
        "velocity": 0.01,
        "outcome": "steady",
        "reserve": 0.5,
        "cycles": 0,
        "slip": math.nan,
    }
    return JointView(**{"name": name, "level": level, "history": history, **plain, **more})


def text(joints: list[JointView], height: int | None = None, width: int = 100) -> str:
    out = StringIO()
    console = Console(file=out, width=width, color_system=None)
    console.print(view(joints, "monitor", console, duration=10.0, height=height))
    return out.getvalue()


@given(
    st.lists(st.tuples(st.floats(0.0, 100.0), st.floats(-1e3, 1e3)), max_size=40),
    st.floats(0.1, 60.0),
    st.integers(1, 60),
)
def test_a_sparkline_is_as_wide_as_asked(rows: list[tuple[float, float]], duration: float, width: int) -> None:
    """Issue 8: whatever a joint did, its line has one character a share of the time."""
    history = np.array(sorted(dict(rows).items())).reshape(-1, 2)
    assert len(sparkline(history, duration, width)) == width


def test_a_sparkline_shows_a_staircase() -> None:
    """Issue 8: steps show as peaks, rests as the lowest bar, times before the first sample as blanks."""
    time_ = np.linspace(0.0, 8.0, 801)
    line = sparkline(np.column_stack((time_, np.floor(time_ / 2.0 + 0.5))), 10.0, 40)
    assert line[:8] == " " * 8
    assert line.count("█") == 4
    assert set(line[8:]) == {"▁", "█"}


def test_the_worst_joints_come_first_and_say_why() -> None:
    """Issue 8: what sticks is on top, with its message; what is well takes one line."""
    shown = text([joint("a"), joint("b", Level.ERROR, status="stick_slip", message="raise the damping")])
    assert shown.index("stick_slip") < shown.index("smooth")
    assert "b: raise the damping" in shown
    assert "+50" in shown


def test_sixty_joints_fit_a_terminal() -> None:
    """Issue 8: the view is no higher than the terminal, and says how many joints it leaves out."""
    joints = [joint(f"joint{n}", Level.WARN if n % 2 else Level.OK, message="thin") for n in range(60)]
    shown = text(joints, height=24)
    assert len(shown.splitlines()) <= 24
    assert re.search(r"… and \d+ more", shown)
    assert len(text(joints).splitlines()) > 90, "without a height all is shown"
    assert max(map(len, text(joints, height=24, width=80).splitlines())) <= 80


@pytest.mark.parametrize("height", [None, 24])
@pytest.mark.parametrize("width", [40, 70, 100])
def test_a_narrow_terminal_has_fewer_columns_and_whole_advice(width: int, height: int | None) -> None:
    """Issue 40, item 6: at 70 columns headings and cells were cut ("rese…", "0.0"), and live the advice."""
    advice = "stick_slip; set stiffness from 630 to 7481 N·m/rad and damping from 20 to 38.5 N·m·s/rad, or move faster"
    rough = {"status": "stick_slip", "message": advice, "velocity": -0.00123, "outcome": "sticks", "slip": 0.00123}
    shown = text([joint("robot1/shoulder", Level.ERROR, **rough), joint("elbow")], height, width)
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= width
    assert "■ stick_slip" in shown
    assert "reserve" in shown
    assert ("cycles" in shown) is (width >= 70)
    assert f"robot1/shoulder: {advice}" in " ".join(shown.split())
    assert f"\nrobot1/shoulder:\n  {advice[:20]}" in shown


@pytest.mark.parametrize("options", [["--once"], ["--seconds", "3"], ["--patience", "5"]])
def test_options_of_the_terminal_have_no_effect_on_the_page(
    options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """They were accepted beside --browser, and forgotten."""
    assert main(["watch", "--browser", "--address", "999.1.1.1", *options]) == 2
    assert f"'{options[0]}' must be given without --browser" in capsys.readouterr().err


def test_without_a_monitor_it_says_what_to_look_at(ros_domain: int) -> None:
    """Issue 8: nobody there: one line with the domain, exit status 2."""
    done = subprocess.run([*COMMAND, "--patience", "1"], capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.returncode == 2
    assert f"No monitor found within 1 s in ROS domain {ros_domain}" in done.stderr


def test_watch_over_dds(ros_domain: int) -> None:
    """Issue 8: joints of two robots from topics alone; once into a pipe, and live in a terminal until Ctrl-C."""
    parameters = {"joints": "[joint1]", "model.joint1": "puma560_joint1", "learn": "false"}
    space = {"__ns": "/robot1"}
    with (
        NodeProcess("simulated_joint", {"rate": 250.0}),
        NodeProcess("simulated_joint", {"rate": 250.0, "profile.joint1": "hold"}, space),
        NodeProcess("monitor", {**parameters, "controller": "/simulated_joint"}),
        NodeProcess("monitor", parameters, space),
    ):
        until = time.monotonic() + LIMIT
        while True:
            done = subprocess.run(
                [*COMMAND, "--once", "--seconds", "5"], capture_output=True, text=True, timeout=LIMIT, check=False
            )
            # What is to be done comes with the advice, some time after the status.
            if "■ stick_slip" in done.stdout and "robot1/joint1" in done.stdout and "stick_slip; " in done.stdout:
                break
            assert time.monotonic() < until, done.stdout + done.stderr
        assert re.search(r"^joint1 +■ stick_slip +[ ▁▂▃▄▅▆▇█]*[▂▃▄▅▆▇█]", done.stdout, re.MULTILINE), done.stdout
        assert re.search(r"^robot1/joint1 +. at_rest", done.stdout, re.MULTILINE), done.stdout
        assert "robot1/stickslip_monitor: " in done.stdout
        assert re.search(r"^joint1:\s+stick_slip; ", done.stdout, re.MULTILINE), done.stdout
        assert _live() == 0


def _live() -> int:
    """Exit status of the live view in a terminal of its own, interrupted once it has shown something."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "24"}
    command = [*COMMAND, "--patience", "60"]
    with begun(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment) as process:
        os.close(theirs)
        seen, until = b"", time.monotonic() + LIMIT
        while (new := _read(ours)) and seen.count(b"stick_slip") < 4:
            seen += new
            assert time.monotonic() < until, seen.decode(errors="replace")
        process.send_signal(signal.SIGINT)
        while new := _read(ours):
            seen += new
        os.close(ours)
        status = process.wait(LIMIT)
    assert seen.count(b"stick_slip") >= 4, seen.decode(errors="replace")
    assert b"Traceback" not in seen, seen.decode(errors="replace")
    return status


def _read(terminal: int) -> bytes:
    """What comes next; nothing once the other end is closed, which Linux calls an error."""
    try:
        return os.read(terminal, 65536)
    except OSError:
        return b""
