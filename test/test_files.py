# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files are written whole or not at all."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from stickslip_ros.files import whole_file, write_whole


def test_what_fails_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    """Until the context ends the file before is there; after an error it still is, and nothing beside it."""
    path = tmp_path / "kept.txt"
    write_whole(path, "before")
    with pytest.raises(KeyboardInterrupt):
        interrupted(path)
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def interrupted(path: Path) -> None:
    """Write half a file."""
    with whole_file(path) as file:
        file.write(b"half")
        assert path.read_text() == "before"
        raise KeyboardInterrupt


def test_permissions_are_those_that_are_wanted(tmp_path: Path) -> None:
    """What was learnt is for the user alone; a report is for all that the umask allows."""
    beside = tmp_path / "usual"
    beside.write_text("")
    write_whole(tmp_path / "report", "ä")
    write_whole(tmp_path / "state", b"x", mode=0o600, durable=True)
    assert (tmp_path / "report").stat().st_mode == beside.stat().st_mode
    assert (tmp_path / "state").stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "report").read_text(encoding="utf-8") == "ä"


def test_names_may_be_as_long_as_the_file_system_has_them(tmp_path: Path) -> None:
    """The name of the file that is being written is no longer than that which it gets."""
    path = tmp_path / ("é" * 127)
    write_whole(path, "x")
    assert path.read_text() == "x"


BEGINS = """
import sys, time
from pathlib import Path
from stickslip_ros.files import whole_file
with whole_file(Path(sys.argv[1])) as file:
    file.write(b"half")
    file.flush()
    print("begun", flush=True)
    time.sleep(60)
"""


def begun(path: Path) -> subprocess.Popen[str]:
    """A process that has written half a file."""
    process = subprocess.Popen([sys.executable, "-c", BEGINS, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    return process


def test_what_killed_processes_left_is_removed(tmp_path: Path) -> None:
    """Issue 20: with the next write of that file; what others write, and other files, stay."""
    path = tmp_path / "state.json"
    others = [
        tmp_path / ".state.json.part",
        tmp_path / ".other.json.99999999.1.part",
        tmp_path / ".state.json.x.1.part",
    ]
    for other in others:
        other.write_text("")
    for _ in range(2):
        with begun(path) as process:
            process.kill()
    with begun(path) as writing:
        (partial,) = [one for one in tmp_path.iterdir() if str(writing.pid) in one.name]
        assert len(list(tmp_path.glob("*.part"))) == len(others) + 1, "each start removes what was left before it"
        link = tmp_path / ".state.json.99999999.1.part"
        link.symlink_to(others[0])
        write_whole(path, "whole")
        assert sorted(tmp_path.iterdir()) == sorted([path, partial, link, *others])
        writing.send_signal(signal.SIGKILL)
    link.unlink()
    write_whole(path, "whole")
    assert sorted(tmp_path.iterdir()) == sorted([path, *others])


def test_a_link_is_followed(tmp_path: Path) -> None:
    """Issue 20: what it leads to is written, beside which the temporary file was; the link stays."""
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "state.json", tmp_path / "state.json"
    link.symlink_to(Path("there") / "state.json")
    for content in ("first", "second"):
        with whole_file(link) as file:
            file.write(content.encode())
            assert len(list(target.parent.glob(".state.json.*.part"))) == 1
        assert link.is_symlink()
        assert target.read_text() == content
    assert sorted(tmp_path.rglob("*")) == sorted([link, target.parent, target])
