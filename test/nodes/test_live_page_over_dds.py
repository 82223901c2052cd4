# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 22, item 7: `stickslip watch --browser` in Chromium, beside a real monitor over real DDS."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from bags.browser import Page, browser
from bokeh.document import Document
from conftest import LIMIT, begun
from nodes.forked_nodes import NodeProcess

from stickslip_ros.cli.live_page import LivePage, Snapshot, advice_text, cycle_duration, joint_table, phase_loop
from stickslip_ros.cli.main import main
from stickslip_ros.cli.watch_view import JointView
from stickslip_ros.model.friction import Friction, Gains, Joint
from stickslip_ros.output.as_json import margin_json
from stickslip_ros.output.diagnosis import Level, diagnosis
from stickslip_ros.output.published import joint_values, published_joint
from stickslip_ros.settings.known_joints import load_joint

_COMMAND = [sys.executable, "-m", "stickslip_ros.cli.main", "watch", "--browser"]
_MONITOR = {"joints": "['']", "state_file": "none", "controller": "/simulated_joint"}
_KNOWN = {**_MONITOR, "model.a": "puma560_joint1", "model.b": "puma560_joint1", "learn": "false"}
# All the text of the page: Bokeh's parts stand in shadow trees.
_TEXT = """
const walk = (node) => [...node.querySelectorAll('*')].map(
  (one) => one.shadowRoot ? one.shadowRoot.textContent + walk(one.shadowRoot) : '').join(' ');
return walk(document);
"""
_MODEL = "Bokeh.documents[0].get_model_by_name"
_TABLE = f"{_MODEL}('table').text"


def free_port() -> int:
    """A port that nobody has."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def served(port: int) -> Iterator[subprocess.Popen[str]]:
    """The page of a process of its own."""
    with begun([*_COMMAND, "--port", str(port)], stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert f"http://127.0.0.1:{port}" in process.stderr.readline()
            yield process
        finally:
            process.terminate()
            try:
                process.wait(LIMIT)
            except subprocess.TimeoutExpired:
                process.kill()
                raise


def opened(page: Page, port: int) -> None:
    """Load the page, and wait until it is live."""
    page.driver.get(f"http://127.0.0.1:{port}/")
    page.wait(lambda: page.run("return document.documentElement.dataset.page") == "ready", "the page")


def test_the_page_lives(ros_domain: int) -> None:
    """Opened, updated, another joint chosen, what if; it goes on when the monitor comes back."""
    simulated = {"joints": "[a, b]", "rate": 250.0, "gains.b.p": 9000.0, "gains.b.d": 200.0}
    port = free_port()
    with NodeProcess("simulated_joint", simulated), served(port), browser() as page:
        opened(page, port)
        page.wait(lambda: "No monitor has said anything" in page.run(_TEXT), "that nobody is there")
        assert page.run("return getComputedStyle(document.body).paddingLeft") == "16px"
        with NodeProcess("monitor", _KNOWN):
            page.wait(lambda: "stick-slip" in page.run(f"return {_TABLE}"), "the joint that sticks", 60.0)
            assert "2 joints." in page.run(_TEXT)
            # The worst is looked at: its motion moves on, its cycle is a loop, its map has regions.
            source = "Bokeh.documents[0]._all_models.values()"
            page.wait(
                lambda: page.run(
                    f"return [...{source}].some(one => one.type === 'ColumnDataSource' && one.data.top?.length > 300)"
                ),
                "the map", 60.0,
            )  # fmt: skip
            page.wait(lambda: "the joint sticks" in page.run(_TEXT), "what the present gains do", 30.0)
            # With the advised stiffness and much damping it does not, and `stickslip margin` says the same.
            page.run(f"const one = {_MODEL}('damping'); one.value = one.end; one.value_throttled = one.end")
            page.wait(lambda: "the joint moves steadily" in page.run(_TEXT), "what other gains do", 30.0)
            told = re.search(
                r"With k_p ([\d.]+) N·m/rad and k_v ([\d.]+) N·m·s/rad at ([\d.]+) rad/s the model predicts: "
                r"the joint moves steadily; damping reserve ([+-]\d+) %",
                page.run(_TEXT),
            )
            assert told is not None
            gains = Gains(stiffness=float(told[1]), damping=float(told[2]))
            exact = margin_json(load_joint("puma560_joint1").joint, gains, float(told[3]))["exact"]
            assert float(told[4]) == pytest.approx(100.0 * exact["damping_reserve"], abs=3.0)
            assert exact["outcome"] == "steady"
            page.run(f"{_MODEL}('joint').value = 'b'")
            page.wait(lambda: "b: smooth" in page.run(_TEXT), "the other joint", 30.0)
        page.wait(lambda: "No monitor has said anything for" in page.run(_TEXT), "that it is gone", 30.0)
        with NodeProcess("monitor", _KNOWN):
            page.wait(lambda: "No monitor has said" not in page.run(_TEXT), "that it is back", 60.0)
            page.wait(lambda: "stick-slip" in page.run(f"return {_TABLE}"), "the joint that sticks again", 60.0)
        # A plot that has nothing to show yet has no range yet.
        assert [one for one in page.complaints() if "could not set initial ranges" not in one] == []


@pytest.mark.nightly
def test_sixty_joints(ros_domain: int) -> None:
    """All of them are in the table soon."""
    simulated = {"joints": f"[{', '.join(f'j{number}' for number in range(60))}]", "rate": 50.0}
    port = free_port()
    with NodeProcess("simulated_joint", simulated), NodeProcess("monitor", _MONITOR), served(port), browser() as page:
        opened(page, port)
        rows = f"return {_TABLE}.split('<tr data-joint').length - 1"
        page.wait(lambda: page.run(rows) == 60, "sixty joints", 60.0)


def test_names_are_text_and_nothing_else() -> None:
    """What others named is shown, and does nothing."""
    hostile = "<img src=x onerror='alert(1)'>\""
    view = JointView(
        name=hostile, level=Level.ERROR, status=hostile, message=hostile, velocity=0.1, outcome=hostile, reserve=-0.5,
        cycles=3, slip=0.01, history=np.zeros((0, 2)), values={"recommendation": hostile},
    )  # fmt: skip
    for text in (joint_table([view], hostile), advice_text(view)):
        assert "<img" not in text
        assert "&lt;img src=x onerror=&#x27;alert(1)&#x27;&gt;&quot;" in text


class Listener:
    """Two joints that a monitor knows, with other gains."""

    def __init__(self) -> None:
        told = dict(diagnosis(Level.OK, "", joint_values(load_joint("puma560_joint1").joint), "", "").values)
        told |= {"velocity [rad/s]": "0.0058", "damping [N*m*s/rad]": "20"}
        gains = {"a": "630", "b": "6300"}
        self.snapshot = Snapshot(joints=tuple(
            JointView(
                name=name, level=Level.OK, status="smooth", message="", velocity=0.0058, outcome="", reserve=0.5,
                cycles=0, slip=0.0, history=np.zeros((0, 2)), values=told | {"stiffness [N*m/rad]": gain},
            ) for name, gain in gains.items()
        ))  # fmt: skip

    def look_at(self, _: str) -> None:
        """Nothing moves."""

    look_away = look_at


@pytest.mark.slow
def test_answers_are_of_the_joint_that_is_chosen() -> None:
    """Issue 40, item 6: what gains do to one joint stood under the joint chosen after it until its own came."""
    document = Document()
    with ThreadPoolExecutor(1) as work:
        page = LivePage(document, Listener(), work)  # type: ignore[arg-type]
        answer, until = document.get_model_by_name("answer"), time.monotonic() + LIMIT
        while "k_p 630 " not in answer.text:
            assert time.monotonic() < until
            time.sleep(0.05)
            page.update()
        document.get_model_by_name("joint").value = "b"
        while "k_p 6300 " not in answer.text:
            assert "k_p 630 " not in answer.text
            assert time.monotonic() < until
            time.sleep(0.05)
            page.update()


def handshake(port: int, origin: str) -> str:
    """The first line of the answer to a page of some origin that wants to listen."""
    lines = [
        "GET /ws HTTP/1.1", f"Host: 127.0.0.1:{port}", f"Origin: {origin}", "Connection: Upgrade", "Upgrade: websocket",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13", "", "",
    ]  # fmt: skip
    with socket.create_connection(("127.0.0.1", port), timeout=LIMIT) as one:
        one.sendall("\r\n".join(lines).encode())
        # What follows the head may be a frame of the socket already, which is no text.
        return one.recv(1000).partition(b"\r\n")[0].decode()


def test_only_this_machine_unless_asked(ros_domain: int) -> None:
    """It listens on 127.0.0.1 alone, takes no other site's connections, and says what is wrong with a port."""
    port = free_port()
    with served(port) as process:
        sockets = [line.split() for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()]
        listening = [fields[1] for fields in sockets if fields[3] == "0A"]
        mine = [address for address in listening if address.endswith(f":{port:04X}")]
        assert mine == [f"0100007F:{port:04X}"]
        assert "403" in handshake(port, "http://evil.example")
        assert "403" not in handshake(port, f"http://127.0.0.1:{port}")
        second = subprocess.run(
            [*_COMMAND, "--port", str(port)], capture_output=True, text=True, timeout=LIMIT, check=False
        )
        assert second.returncode == 2
        assert "'--port' must be free" in second.stderr
        assert f"127.0.0.1:{port}" in second.stderr
        assert process.poll() is None


def test_options_of_the_page_alone(capsys: pytest.CaptureFixture[str]) -> None:
    """A port or an address without a page is a mistake."""
    assert main(["watch", "--port", "8000"]) == 2
    assert "'--port' must be given together with --browser: 8000" in capsys.readouterr().err
    assert main(["watch", "--browser", "--port", "0"]) == 2


@pytest.mark.parametrize("friction", [{}, {"presliding_stiffness": 1e5, "contact": "lugre"}, {"law": "exponential"}])
@pytest.mark.parametrize("delay", [0.0, 0.00317])
def test_the_believed_joint_is_told_and_read(friction: dict[str, object], delay: float) -> None:
    """What a monitor believes can be computed with elsewhere, to the last digit."""
    joint = Joint(
        inertia=6.3,
        actuation_delay=delay,
        friction=Friction(
            stribeck=1.6, stribeck_velocity=0.0058, lag=0.05, rise_time=0.26, viscous=4.94, coulomb=8.43, **friction
        ),  # type: ignore[arg-type]
    )
    told = dict(diagnosis(Level.OK, "", joint_values(joint), "", "").values)
    assert published_joint(json.loads(json.dumps(told))) == joint
    assert published_joint({}) is None
    assert published_joint(told | {"believed inertia [kg*m^2]": "-1"}) is None


def test_the_loop_of_a_cycle() -> None:
    """A sine about an even motion is an ellipse in the phase plane, with its reference or without."""
    time_ = np.linspace(0.0, 4.0, 2001)
    samples = np.stack([time_, 0.1 * time_ + 0.01 * np.sin(np.pi * time_), np.full(2001, np.nan)], axis=1)
    references = np.stack([time_, 0.1 * time_, np.full(2001, 0.1)], axis=1)
    for known in (references, np.zeros((0, 3))):
        error, velocity = phase_loop(samples, known, 2.0)
        radius = np.hypot(error / 0.01, (velocity - 0.1) / (0.01 * np.pi))
        assert radius[10:-10] == pytest.approx(np.ones(len(radius) - 20), abs=0.01)
    assert cycle_duration({"last dwell [s]": 1.0, "last slip duration [s]": 1.0}) == pytest.approx(2.6)
    assert cycle_duration({}) == 3.0
