# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Processes that the commands run."""

from __future__ import annotations

from pathlib import Path

from stickslip_ros.cli.processes import NodeProcess

_LINES = 3_000


def test_reading_what_a_process_prints_loses_none_of_it(tmp_path: Path) -> None:
    """A file's offset is shared by who writes and who reads: a reader that moved it made the process write over it."""
    script = tmp_path / "prints.py"
    script.write_text(f"for line in range({_LINES}):\n    print(line, flush=True)\n", encoding="utf-8")
    with NodeProcess(str(script), {}) as process:
        while process.running:
            process.output()
        assert process.output().split() == [str(line) for line in range(_LINES)]
