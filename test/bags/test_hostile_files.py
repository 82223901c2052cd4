# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: files that mean harm cost neither memory nor time, and are refused in one line."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hostile import CORPUS
from limited import SECONDS

pytestmark = pytest.mark.slow

LIMITED = Path(__file__).with_name("limited.py")
# Of these the sound part is read.
READ = {"aliases_in_metadata", "metadata_of_itself", "large_metadata"}


@pytest.fixture(scope="module")
def limited() -> Iterator[subprocess.Popen[str]]:
    """What runs commands with little memory and time."""
    command = [sys.executable, str(LIMITED)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.stdin.close()


@pytest.mark.parametrize("make", CORPUS, ids=lambda make: make.__name__)
def test_hostile_files_are_refused_soon(
    make: Callable[[Path], list[str]], limited: subprocess.Popen[str], tmp_path: Path
) -> None:
    """With a gigabyte of address space, in 20 s: exit status 2 and one line, or the sound part; nothing is left."""
    arguments = make(tmp_path)
    with tempfile.TemporaryDirectory() as folder:
        limited.stdin.write(json.dumps({"arguments": arguments, "folder": folder}) + "\n")
        limited.stdin.flush()
        found = json.loads(limited.stdout.readline())
        printed = (Path(folder) / "printed").read_text(encoding="utf-8")
        left = [path.name for path in Path(folder).iterdir() if path.name != "printed"]
    print(make.__name__, found, printed)
    assert found["status"] in ((0, 2) if make.__name__ in READ else (2,)), printed
    assert found["seconds"] < SECONDS
    assert "Traceback" not in printed
    assert not left
    complaints = [line for line in printed.splitlines() if line.startswith("stickslip: ")]
    assert make.__name__ in READ or len(complaints) == 1
    assert all(len(line) < 1500 for line in complaints)
