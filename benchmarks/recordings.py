# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Analysis of a recorded arm as a whole command, against decoding its joint states alone with mcap-ros2-support.

As a command: python -m benchmarks.recordings MINUTES [HOW_MANY_OF_THE_JOINTS_STICK]
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.model.friction import Gains
from stickslip_ros.settings.known_joints import load_joint

_MINUTES = 3.0
_JOINTS, _RATE = 7, 1000.0
# Prints the time that the work took from the start of the process on [s], and the most memory that it had [kB].
_MEASURED = """
import re, sys, time
{work}
started = float(open("/proc/self/stat").read().rsplit(")", 1)[1].split()[19]) / 100.0
up = float(open("/proc/uptime").read().split()[0])
print(up - started, re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1], file=sys.stderr)
"""
_ANALYZE = """
from stickslip_ros.cli.main import main
main(["analyze", sys.argv[1], "--json"])
"""
_DECODE = """
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
with open(sys.argv[1], "rb") as file:
    for _ in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/joint_states"]):
        pass
"""


def run(minutes: float = _MINUTES, sticking: tuple[int, ...] = (1, _JOINTS)) -> None:
    """An arm of seven joints at 1 kHz, zstd, with some of its joints sticking."""
    with tempfile.TemporaryDirectory() as folder:
        for count in sticking:
            path = Path(folder) / f"{count}.mcap"
            write_arm(path, 60.0 * minutes, count)
            _measure(_ANALYZE, path)  # the first run may compile
            analysis, memory = _measure(_ANALYZE, path)
            decoding, _ = _measure(_DECODE, path)
            print(
                f"analyze, {minutes:g} min of 7 joints at 1 kHz, {count} sticking: "
                f"{60.0 * minutes / analysis:5.0f} x real time, {memory / 1000:.0f} MB, "
                f"{analysis / decoding:.2f} of the time that mcap-ros2-support decodes"
            )


def write_arm(path: Path, seconds: float, sticking: int, rate: float = _RATE) -> None:
    """A recording of an arm: the first joints stick; the others are stiffer, and move smoothly."""
    known = load_joint("puma560_joint1")
    loose = RecordedJoint(
        joint=known.joint, gains=known.gains, velocities=(0.005,),
        encoder_resolution=known.encoder_resolution, velocity_noise=1e-4,
    )  # fmt: skip
    stiff = replace(loose, gains=Gains(stiffness=6300.0, damping=150.0))
    joints = {
        f"joint{number + 1}": replace(loose if number < sticking else stiff, velocities=(0.005 + 0.002 * number,))
        for number in range(_JOINTS)
    }
    write_simulation(path, joints, duration=seconds, rate=rate)


def _measure(work: str, path: Path) -> tuple[float, float]:
    """Time of a whole process [s], and its largest resident memory [kB]."""
    command = [sys.executable, "-c", _MEASURED.format(work=work), str(path)]
    # What is installed has its byte code; a checkout has it too, unless that is forbidden.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=True, env=environment
    )
    seconds, memory = done.stderr.split()[-2:]
    return float(seconds), float(memory)


if __name__ == "__main__":
    stuck = (int(sys.argv[2]),) if len(sys.argv) > 2 else (1, _JOINTS)
    run(float(sys.argv[1]) if len(sys.argv) > 1 else _MINUTES, stuck)
