# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""colcon builds the package as ros.ament_python, and its executables start from the install space."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import LIMIT, ROOT
from nodes.support_ros import probe

from stickslip_ros import __version__
from stickslip_ros.parent_death import die_with_parent

pytestmark = pytest.mark.slow

COLCON = Path(sys.executable).with_name("colcon")
TRACKED = [
    "bin",
    "package.xml",
    "setup.py",
    "setup.cfg",
    "pyproject.toml",
    "resource",
    "stickslip_ros",
    "config",
    "launch",
    "policies",
    "examples",
    "test",
    "LICENSE",
]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A colcon workspace with the package built in it."""
    folder = tmp_path_factory.mktemp("workspace")
    source = folder / "src" / "stickslip_ros"
    source.mkdir(parents=True)
    for name in TRACKED:
        path = ROOT / name
        if path.is_dir():
            shutil.copytree(path, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif path.exists():
            shutil.copy(path, source / name)
    listed = subprocess.run([COLCON, "list"], cwd=folder, capture_output=True, text=True, timeout=LIMIT, check=True)
    assert "(ros.ament_python)" in listed.stdout
    run_colcon(folder, "build")
    return folder / "install" / "stickslip_ros"


def run_colcon(folder: Path, *arguments: str) -> str:
    """What colcon prints, which must end well."""
    environment = {**os.environ, "PYTHONWARNINGS": "ignore", "PATH": f"{COLCON.parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        [COLCON, *arguments], cwd=folder, capture_output=True, text=True, timeout=300, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_colcon_test_is_green(workspace: Path) -> None:
    """Issue 8: `colcon test` finds the tests and runs them; two of their files here, which compile nothing."""
    folder = workspace.parents[1]
    # A report of what of all files they reach takes ten times as long as they do.
    files = ("test/model/test_friction.py", "test/test_parameter_names.py")
    run_colcon(folder, "test", "--pytest-args", "--no-cov", *files)
    summary = re.search(r"Summary: (\d+) tests, 0 errors, 0 failures", run_colcon(folder, "test-result", "--all"))
    assert summary is not None
    assert int(summary.group(1)) > 5


def test_the_install_space_is_what_ros2_looks_for(workspace: Path) -> None:
    """Issue 2: executables in lib/, ament index marker, joints and parameters in share/."""
    for name in ("monitor", "simulated_joint", "replay", "stickslip"):
        assert os.access(workspace / "lib" / "stickslip_ros" / name, os.X_OK)
    assert (workspace / "share" / "ament_index" / "resource_index" / "packages" / "stickslip_ros").exists()
    share = workspace / "share" / "stickslip_ros"
    for name in (
        "package.xml",
        "config/monitor.yaml",
        "config/joints/puma560_joint1.yaml",
        "launch/demo.launch.py",
        "config/views/foxglove.json",
        "policies/stickslip_monitor.policy.xml",
    ):
        assert (share / name).exists()
    site = next(workspace.glob("lib/python*/site-packages"))
    for name in ("static/style.css", "static/page.js", "templates/report.html"):
        assert (site / "stickslip_ros" / "analysis" / "report" / name).exists()


def test_the_command_is_on_the_path_of_a_workspace(workspace: Path) -> None:
    """Issue 15: README, tutorial and how-to pages say `stickslip`, as a ROS workspace must have it, too."""
    script = f". {workspace.parent}/setup.bash && command -v stickslip && stickslip --version"
    # The search path is the workspace's and the system's alone, with this Python in it as `python3`.
    folder = workspace.parents[1] / "python"
    folder.mkdir(exist_ok=True)
    (folder / "python3").symlink_to(sys.executable)
    environment = {**os.environ, "PATH": f"{folder}:/usr/bin:/bin"}
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, timeout=LIMIT, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(workspace / "bin" / "stickslip"), __version__]


def test_the_monitor_starts_from_the_install_space(workspace: Path, ros_domain: int) -> None:
    """Issue 2: lib/stickslip_ros/monitor runs with the installed parameter file and is heard."""
    site = next(workspace.glob("lib/python*/site-packages"))
    environment = {**os.environ, "PYTHONPATH": str(site), "AMENT_PREFIX_PATH": str(workspace)}
    command = [
        workspace / "lib" / "stickslip_ros" / "monitor",
        "--ros-args",
        "--params-file",
        workspace / "share" / "stickslip_ros" / "config" / "monitor.yaml",
    ]
    process = subprocess.Popen(
        command, env=environment, cwd=workspace, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        preexec_fn=die_with_parent,
    )  # fmt: skip
    try:
        with probe() as one:
            # In a new place it compiles first; it is heard meanwhile.
            one.wait(lambda: "joint1" in one.diagnostics, "joint1")
        process.terminate()
        assert process.wait(LIMIT) == 0
    finally:
        process.kill()
        process.communicate()
