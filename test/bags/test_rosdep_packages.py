# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 40, item 7: with the packages that rosdep installs, and none of those by pip, recordings are analysed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.convert import convert as convert_bag
from rosbags.rosbag2 import StoragePlugin
from support_bags import STORE, simulated_bag

from stickslip_ros.cli.main import main

BLOCKER = """
import sys
for name in ("bokeh", "lz4", "mcap", "pyarrow", "rosbags", "zstandard"):
    sys.modules[name] = None
"""


def without_pip(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """A command in a process that has none of those packages."""
    (folder / "sitecustomize.py").write_text(BLOCKER, encoding="utf-8")
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-m", "stickslip_ros.cli.main", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        check=False, capture_output=True, text=True, timeout=120, cwd=folder,
    )  # fmt: skip


def database(folder: Path) -> Path:
    """A bag as rosbag2 writes it to SQLite."""
    convert_bag(
        [simulated_bag(folder / "directory")], folder / "sqlite", dst_storage=StoragePlugin.SQLITE3, dst_version=9,
        compress=None, compress_mode="none", default_typestore=STORE, typestore=None, exclude_topics=[],
        include_topics=[], exclude_msgtypes=[], include_msgtypes=[],
    )  # fmt: skip
    return next((folder / "sqlite").glob("*.db3"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["none", "zstd", "db3"])
def test_a_recording_is_analysed_with_the_same_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    """Motion, references and gains are read: the report is the one that all packages give, and nothing is warned of."""
    bag = database(tmp_path) if kind == "db3" else simulated_bag(tmp_path / "a.mcap", compression=kind)
    done = without_pip(tmp_path, "analyze", bag)
    assert (done.returncode, done.stderr) == (0, "")
    capsys.readouterr()
    assert main(["analyze", str(bag)]) == 0
    assert done.stdout == capsys.readouterr().out
    assert "gains and reference known" in done.stdout


@pytest.mark.slow
def test_what_needs_more_says_so_in_one_line(tmp_path: Path) -> None:
    """With the package and the command that installs it."""
    bag = simulated_bag(tmp_path / "a.mcap", duration=2.0, compression="lz4")
    for arguments, package, command in (
        (["analyze", bag, "--html", "report.html"], "bokeh", "pip install bokeh"),
        (["analyze", bag, "--table", "table.parquet"], "pyarrow", "pip install pyarrow"),
        (["analyze", bag], "lz4", "sudo apt install python3-lz4, or pip install lz4"),
        (["simulate", "--out", "b.mcap", "--duration", "1"], "mcap", "pip install mcap"),
        (["watch", "--browser"], "bokeh", "pip install bokeh"),
    ):
        done = without_pip(tmp_path, *arguments)
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.count("\n") == 1
        assert f"needs the package {package}: {command}" in done.stderr
