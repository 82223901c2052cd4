# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Signals at random moments; `python -m benchmarks.interrupts 500` does as many more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from conftest import nightly

from benchmarks.interrupts import commands, endings, nodes

_SEED = 35


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, nightly(12)])
def test_every_node_ends_quietly_whenever_it_is_interrupted(ros_domain: int, tmp_path: Path, count: int) -> None:
    """Issues 2 and 35: status 0, nothing but the log; three run at a time, and hear each other."""
    for ending in endings(nodes(), count, _SEED, tmp_path, at_once=3):
        assert not ending.complaints, str(ending)


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, nightly(12)])
def test_commands_end_quietly_whenever_they_are_interrupted(ros_domain: int, tmp_path: Path, count: int) -> None:
    """Issue 35: with the signal's status, if not done before; no file is left half written."""
    chosen = ("recommend", "analyze", "convert", "simulate")
    subjects = [replace(one, until=1.5) for one in commands(tmp_path) if one.words[3] in chosen]
    for ending in endings(subjects, count, _SEED, tmp_path, at_once=2):
        assert not ending.complaints, str(ending)
