# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 40, item 7: with the packages that rosdep installs, and none of those by pip, recordings are analysed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import LIMIT
from rosbags.convert import convert as convert_bag
from rosbags.rosbag2 import StoragePlugin
from support_bags import STORE, simulated_bag

from stickslip_ros.cli.main import main

# Runs commands one after the other in a process that has none of those packages; prints what each of them does.
BLOCKED = """
import json, sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
for name in ("bokeh", "lz4", "mcap", "pyarrow", "rosbags", "zstandard"):
    sys.modules[name] = None
from stickslip_ros.cli.main import main
found = []
for command in json.loads(sys.argv[1]):
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as errors:
        status = main(command)
    found.append((status, out.getvalue(), errors.getvalue()))
print(json.dumps(found))
"""


def without_pip(folder: Path, commands: list[list[str | Path]]) -> list[tuple[int, str, str]]:
    """Exit status, output and errors of commands where none of those packages is."""
    words = json.dumps([[str(word) for word in command] for command in commands])
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, words], check=False, capture_output=True, text=True, timeout=LIMIT, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return [(status, out, errors) for status, out, errors in json.loads(done.stdout)]


def database(folder: Path) -> Path:
    """A bag as rosbag2 writes it to SQLite."""
    convert_bag(
        [simulated_bag(folder / "directory")], folder / "sqlite", dst_storage=StoragePlugin.SQLITE3, dst_version=9,
        compress=None, compress_mode="none", default_typestore=STORE, typestore=None, exclude_topics=[],
        include_topics=[], exclude_msgtypes=[], include_msgtypes=[],
    )  # fmt: skip
    return next((folder / "sqlite").glob("*.db3"))


@pytest.mark.slow
def test_a_recording_is_analysed_with_the_same_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Motion, references and gains are read: the report is the one that all packages give, and nothing is warned of."""
    bags = [simulated_bag(tmp_path / f"{kind}.mcap", compression=kind) for kind in ("none", "zstd")]
    bags.append(database(tmp_path))
    for bag, (status, out, errors) in zip(bags, without_pip(tmp_path, [["analyze", bag] for bag in bags]), strict=True):
        assert (status, errors) == (0, ""), bag
        capsys.readouterr()
        assert main(["analyze", str(bag)]) == 0
        assert out == capsys.readouterr().out, bag
        assert "gains and reference known" in out, bag


@pytest.mark.slow
def test_what_needs_more_says_so_in_one_line(tmp_path: Path) -> None:
    """With the package and the command that installs it."""
    bag = simulated_bag(tmp_path / "a.mcap", duration=2.0, compression="lz4")
    for file in ("set/meta/info.json", "set/data/chunk-000/file-000.parquet"):
        (tmp_path / file).parent.mkdir(parents=True)
        (tmp_path / file).write_text("{}", encoding="utf-8")
    expected: list[tuple[list[str | Path], str, str]] = [
        (["analyze", bag, "--html", "report.html"], "bokeh", "pip install bokeh"),
        (["analyze", bag, "--table", "table.parquet"], "pyarrow", "pip install pyarrow"),
        (["analyze", tmp_path / "set"], "pyarrow", "pip install pyarrow"),
        (["identify", tmp_path / "set"], "pyarrow", "pip install pyarrow"),
        (["convert", tmp_path / "set", "--out", tmp_path / "set.mcap"], "pyarrow", "pip install pyarrow"),
        (["analyze", bag], "lz4", "sudo apt install python3-lz4, or pip install lz4"),
        (["simulate", "--out", "b.mcap", "--duration", "1"], "mcap", "pip install mcap"),
        (["watch", "--browser"], "bokeh", "pip install bokeh"),
    ]
    found = without_pip(tmp_path, [arguments for arguments, _, _ in expected])
    for (_, package, command), (status, out, errors) in zip(expected, found, strict=True):
        assert (status, out) == (2, "")
        assert errors.count("\n") == 1
        assert f"needs the package {package}: {command}" in errors
