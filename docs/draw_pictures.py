# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Draws the pictures of README and docs/, each made by the program itself: make pictures.

The demo, the terminal view, the stability map as the monitor publishes it, the report on a recording, a comparison,
Fig. 13; and with a folder of real recordings as argument those of docs/detection.md. Chromium photographs what is no
picture yet.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import draw_recordings
from rclpy.qos import DurabilityPolicy, QoSProfile
from rich.console import Console
from rich.terminal_theme import MONOKAI
from sensor_msgs.msg import CompressedImage

from stickslip_ros.cli.main import main as stickslip
from stickslip_ros.cli.monitor_client import WatchListener
from stickslip_ros.cli.processes import NodeProcess, isolate
from stickslip_ros.cli.watch_view import view

PICTURES = Path(__file__).parent / "pictures"
_JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
_LISTEN = 45.0  # [s] the learning needs some slips
_PAGE = """<html><body style="margin:0;background:#0c1016"><pre style="margin:0;padding:14px;color:#d9dee5;
font:15px/1.25 'DejaVu Sans Mono',monospace">{code}</pre></body></html>"""


def photograph(page: Path, picture: Path, width: int, height: int) -> None:
    """What Chromium shows of a page."""
    with tempfile.TemporaryDirectory() as profile:
        command = [
            "chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={profile}", f"--window-size={width},{height}", "--virtual-time-budget=10000",
            f"--screenshot={picture}", page.as_uri(),
        ]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True, timeout=120)


def draw_demo() -> None:
    """Stick-slip, the advice, the cure."""
    if stickslip(["demo", "--out", str(PICTURES / "demo.png")]) != 0:
        raise SystemExit("the demo did not end well")


def draw_running(folder: Path) -> None:
    """Terminal view and stability map of four joints, of which one sticks."""
    parameters = {
        "joints": f"[{', '.join(_JOINTS)}]", "profile.wrist_1_joint": "hold", "velocity.shoulder_lift_joint": 0.05,
        "gains.shoulder_lift_joint.p": 3000.0, "gains.shoulder_lift_joint.d": 120.0, "velocity.elbow_joint": 0.02,
        "gains.elbow_joint.p": 2016.0, "gains.elbow_joint.d": 34.0,
    }  # fmt: skip
    models = {f"model.{name}": "puma560_joint1" for name in _JOINTS}
    monitor: dict[str, object] = {
        "joints": f"[{', '.join(_JOINTS)}]", "controller": "/simulated_joint", "state_file": "none", **models,
    }  # fmt: skip
    isolate()
    with NodeProcess("simulated_joint", parameters), NodeProcess("monitor", monitor):
        listener = WatchListener()
        images: dict[str, bytes] = {}
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        listener.node.create_subscription(
            CompressedImage,
            "/stickslip_monitor/stability_map",
            lambda message: images.update({message.header.frame_id: bytes(message.data)}),
            qos,
        )
        until = time.monotonic() + _LISTEN
        while time.monotonic() < until:
            listener.listen(1.0)
        console = Console(record=True, width=112, file=io.StringIO(), force_terminal=True, color_system="truecolor")
        console.print(view(listener.joints(), listener.header(), console, duration=10.0))
        listener.close()
    (PICTURES / "stability_map.png").write_bytes(images[_JOINTS[0]])
    page = folder / "watch.html"
    code = console.export_html(theme=MONOKAI, inline_styles=True, code_format="{code}")
    page.write_text(_PAGE.format(code=code), encoding="utf-8")
    lines = code.count("\n")
    photograph(page, PICTURES / "watch.png", 1050, 19 * lines + 30)


def draw_report(folder: Path) -> None:
    """The top of the page on a recording."""
    bag, page = str(folder / "arm.mcap"), folder / "report.html"
    joints = ["--names", "shoulder,elbow,wrist", "--velocity", "0.0058,0.02,0.08"]
    stickslip(["simulate", "--out", bag, *joints, "--first-stamp", "1795000000"])
    stickslip(["analyze", bag, "--html", str(page)])
    photograph(page, PICTURES / "report.png", 1200, 1500)


def draw_comparison(folder: Path) -> None:
    """The top of the page on a cure."""
    bags, page = [str(folder / f"{name}.mcap") for name in ("before", "after")], folder / "comparison.html"
    for bag, gains in zip(bags, ([], ["--stiffness", "7400", "--damping", "40"]), strict=True):
        stickslip(["simulate", "--out", bag, "--names", "shoulder", "--duration", "30", *gains])
    stickslip(["compare", *bags, "--html", str(page)])
    photograph(page, PICTURES / "comparison.png", 1000, 900)


def draw_figure(folder: Path) -> None:
    """Fig. 13 of the paper."""
    stickslip(["figures", "13", "--out", str(folder)])
    (PICTURES / "figure_13.png").write_bytes(next(folder.glob("*13*.png")).read_bytes())


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        draw_running(Path(name))
        draw_report(Path(name))
        draw_comparison(Path(name))
        draw_figure(Path(name))
    draw_demo()
    if len(sys.argv) > 1:
        draw_recordings.main(Path(sys.argv[1]))
