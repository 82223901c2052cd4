# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: what guards against files and names of others stands in one place each, and nothing goes around it.

Issue 37: one thing has one word, which is the field's.
"""

from __future__ import annotations

import io
import re
import tokenize

import pytest
from conftest import ROOT

PACKAGE = ROOT / "stickslip_ros"
PLACES = {
    r"(?<!\.)\bConsole\(": set(),
    r"\bcsv\.(writer|DictWriter)\b": {"output/csv_table.py"},
    r"\byaml\.(safe_load|load|SafeLoader|CSafeLoader)\b": {"regular_files.py"},
    r"\b(ZstdDecompressor|LZ4FrameDecompressor|lz4\.frame\.decompress)\b": {
        "bags/storage/unpacking.py",
        "bags/storage/formats.py",
        "bags/storage/system_zstd.py",  # the same names by the system's library
    },
    r"file=sys\.stderr": {"cli/terminal.py", "cli/main.py", "nodes/running.py"},
    r"print\(json\.dumps": set(),
    r"\bnp\.load\(": {"bags/table_files.py"},
    r"\btempfile\b": {"bags/storage/formats.py", "compilation.py", "cli/demo.py", "cli/processes.py"},
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


# Words that code does not use, and the field's; rooms that are not done yet are not looked at.
WORDS = {
    "Supplement": "OptionalTerm", "Surroundings": "PositionDisturbance", "Growth": "FrictionFactor",
    "Look": "Screening", "hopeless": "rejected", "glance": "truncated_fit", "promises": "prior_evidence",
    "told": "reported, distinguished", "tell": "record, report", "say": "report", "ask": "evaluate, request",
    "said": "what the result is called", "asked": "what was computed", "take": "add_rest, process_sample",
    "look": "poll, scan", "begin_anew": "restart", "remember": "restore, push", "taken_off": "subtracted_force",
    "rougher": "known_factor", "elsewhere": "without_position_force", "lasting": "without_drift", "stray": "jitter",
    "alike": "similar, autocorrelation", "news": "prewhitened, change_token",
    "repeated": "residuals_per_observation", "pulls": "bias_sensitivity", "HELD": "HOLDING_FORCE, FIXED_STD",
    "foresee": "detect_at_arrest", "mend": "relabel", "stirred": "creep_onset", "SPELL": "LOW_SPEED",
    "spell": "low_speed", "quickness": "peak_speed_ratio", "directness": "path_efficiency",
    "Belief": "SelectedModel", "belief": "selected", "believed": "select_model", "doubt": "error_floor",
    "Vitals": "ClosedLoopHealth", "widening": "error_inflation", "remains": "stribeck_fraction",
    "REMAINS": "STRIBECK_FRACTION", "UNTOLD": "PENDING", "tell_slip": "record_breakaway", "HASTY": "COARSE",
    "GLANCE": "COARSE_PERSISTENCE", "patient": "full_accuracy", "strange": "outlier", "Lateness": "DelayEstimate",
}  # fmt: skip
DONE = (
    "model", "messages", "monitoring", "monitoring/detection", "monitoring/friction", "monitoring/advice", "bags",
    "bags/storage", "analysis", "analysis/report", "output", "settings", "cli", "", "nodes", "nodes/gains",
    "nodes/intake",
)  # fmt: skip


@pytest.mark.parametrize("room", DONE)
def test_names_are_the_fields_words(room: str) -> None:
    """Issue 37: no identifier of a room that is done is one of those words."""
    for path in sorted((PACKAGE / room).glob("*.py")):
        tokens = tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline)
        names = {token.string.lstrip("_") for token in tokens if token.type == tokenize.NAME}
        used = {name: WORDS[name] for name in sorted(names & set(WORDS))}
        assert not used, f"{path.relative_to(PACKAGE)}: {used}"
