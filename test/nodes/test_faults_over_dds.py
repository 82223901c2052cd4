# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""What happens to robots: processes are killed, come back as others, fall silent; cables are cut."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cut_network import NO_RIGHT
from nodes.forked_nodes import NodeProcess
from support_ros import STALE, Probe, probe


def wait_for_stick_slip(one: Probe, joint: str) -> None:
    """A status and further cycles."""
    one.wait(lambda: one.status(joint) == "stick_slip" and one.diagnostics[joint][0] != STALE, "stick-slip")
    before = len([cycle for cycle in one.cycles if cycle["joint"] == joint])
    one.wait(lambda: len([cycle for cycle in one.cycles if cycle["joint"] == joint]) > before + 1, "further cycles")


@pytest.mark.usefixtures("without_shared_memory")
def test_a_robot_that_is_killed_and_comes_back_after_half_a_minute(ros_domain: int) -> None:
    """Issue 7: DDS participant killed, 30 s of silence, restarted, with other joints: recovered from without help."""
    with NodeProcess("monitor", {"joints": "['']", "state_file": "none"}) as monitor, probe() as one:
        one.wait_for_monitor()
        with NodeProcess("simulated_joint", {"joints": "[a, b]", "rate": 250.0}) as robot:
            wait_for_stick_slip(one, "a")
            robot.kill()
            one.wait(lambda: one.diagnostics["a"][0] == STALE and one.diagnostics["b"][0] == STALE, "silence")
        one.spin(30.0)
        assert one.diagnostics["a"][0] == STALE
        assert "no data for" in one.diagnostics["a"][1]
        with NodeProcess("simulated_joint", {"joints": "[b, c]", "rate": 250.0}):
            wait_for_stick_slip(one, "b")
            wait_for_stick_slip(one, "c")
            assert one.diagnostics["a"][0] == STALE
            # A busy machine loses some on the way; a restart taken for a loss would be a third of all or more.
            own = one.diagnostics["stickslip_monitor"][2]
            assert float(own["messages lost [1]"]) <= 0.1 * float(own["messages received [1]"])
        assert monitor.running
        assert "Traceback" not in monitor.output()


@pytest.mark.nightly
def test_a_network_that_is_cut_and_mended(ros_domain: int) -> None:
    """Issue 7: a robot and a monitor on two hosts (network namespaces), twelve seconds without a cable."""
    if shutil.which("ip") is None:
        pytest.skip("no iproute2, and no right to install it (tools/install_test_packages.sh)")
    script = Path(__file__).with_name("cut_network.py")
    done = subprocess.run(
        [sys.executable, str(script)],
        check=False,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    if done.returncode == NO_RIGHT:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
