# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20, item 6: ramps that were cut off are remembered, and a damaged memory is said and proposes nothing."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from stickslip_ros.messages.gain_parameters import GainPair
from stickslip_ros.nodes.kept_state import JournalError, RampJournal, UnfinishedRamp

RAMP = UnfinishedRamp(
    joint="joint1", controller="/late", before=GainPair(630.0, 0.0), target=GainPair(3820.0, 26.4), offset=4.94
)


def test_it_outlasts_the_process_and_keeps_the_first_beginning(tmp_path: Path) -> None:
    """A second ramp that begins half-way does not make half-way the beginning."""
    path = tmp_path / "new" / "ramps.json"
    RampJournal(path).begin(RAMP)
    again = RampJournal(path)
    assert again["joint1"].before == RAMP.before
    assert again["joint1"].begun
    again.begin(UnfinishedRamp(**{**vars(RAMP), "before": GainPair(900.0, 2.0)}))
    assert RampJournal(path)["joint1"].before == RAMP.before
    again.end("joint1")
    assert len(RampJournal(path)) == 0


@pytest.mark.parametrize("change", [b"\x00", b"9", b"nan"])
def test_what_is_damaged_is_said(tmp_path: Path, change: bytes) -> None:
    """Wherever it is damaged: nothing of it is believed."""
    path = tmp_path / "ramps.json"
    RampJournal(path).begin(RAMP)
    text = path.read_bytes()
    for place in range(0, len(text), 7):
        damaged = text[:place] + change + text[place + len(change) :]
        path.write_bytes(damaged)
        found = RampJournal(path)
        assert damaged == text or (len(found) == 0 and "cannot be read" in found.trouble)
    # The next ramp does not replace the only record of the gains before.
    found.begin(RAMP)
    assert path.with_name("ramps.json.damaged").read_bytes() == damaged


def test_what_a_newer_release_wrote_is_left_alone(tmp_path: Path) -> None:
    """It is sound: called newer, neither set aside nor written over, and ramps go on to be kept in the process."""
    path = tmp_path / "ramps.json"
    RampJournal(path).begin(RAMP)
    newer = path.read_bytes().replace(b'"version": 1', b'"version": 2')
    path.write_bytes(newer)
    found = RampJournal(path)
    found.begin(RAMP)
    assert found["joint1"].before == RAMP.before
    found.end("joint1")
    assert "is newer than this release (it has version 2; this release reads versions up to 1)" in found.trouble
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == newer


def test_what_cannot_be_noted_is_not_begun(tmp_path: Path) -> None:
    """A folder in its place, a file that never ends: an error before anything is written to a controller."""
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(JournalError, match="cannot be noted"):
        RampJournal(tmp_path / "file" / "ramps.json").begin(RAMP)
    os.mkfifo(tmp_path / "ramps.json")
    assert "regular file" in RampJournal(tmp_path / "ramps.json").trouble
