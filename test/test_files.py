# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Files are written whole or not at all."""

from __future__ import annotations

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
