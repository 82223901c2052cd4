# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: what guards against files and names of others stands in one place each, and nothing goes around it."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT

PACKAGE = ROOT / "stickslip_ros"
PLACES = {
    r"(?<!\.)\bConsole\(": set(),
    r"\bcsv\.(writer|DictWriter)\b": {"output/csv_table.py"},
    r"\byaml\.(safe_load|load|SafeLoader|CSafeLoader)\b": {"regular_files.py"},
    r"\b(ZstdDecompressor|LZ4FrameDecompressor|lz4\.frame\.decompress)\b": {
        "bags/storage/unpacking.py",
        "bags/storage/bag_file.py",
    },
    r"file=sys\.stderr": {"cli/terminal.py", "cli/main.py", "nodes/running.py"},
    r"print\(json\.dumps": {"warm_up.py"},
    r"\bnp\.load\(": {"bags/table_files.py"},
    r"\btempfile\b": {"bags/storage/workspace.py", "compilation.py", "cli/demo.py", "cli/processes.py"},
}


@pytest.mark.parametrize("pattern", PLACES)
def test_it_stands_in_one_place(pattern: str) -> None:
    """Whoever needs it calls that place."""
    found = {
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob("*.py")
        if re.search(pattern, path.read_text(encoding="utf-8"))
    }
    assert found <= PLACES[pattern], f"{found - PLACES[pattern]} should use {PLACES[pattern]}"
