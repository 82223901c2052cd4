# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Damaged, empty and foreign files: an error in one line, or a partial result that says what is missing."""

from __future__ import annotations

import json
import os
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import nightly
from mcap.writer import CompressionType
from support_bags import (
    JOINT_STATE,
    STORE,
    WITHOUT_LEARNING,
    definition,
    joint_state,
    messages_of,
    read_joint,
    simulated_bag,
    write_mcap,
)

from stickslip_ros.analysis.analysis import AnalysisOptions, analyze
from stickslip_ros.analysis.analysis_json import bag_json
from stickslip_ros.cli.main import main
from stickslip_ros.errors import StickSlipError
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

KINDS = {"/pd_gains": "std_msgs/msg/Float64MultiArray"}
WAYS: dict[str, dict[str, Any]] = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 20_000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 20_000},
    "unchunked": {"use_chunking": False, "enable_data_crcs": True},
}


# Neither learning nor advice, which take longer than the reading.
_OPTIONS = AnalysisOptions(parameters=Parameters({"learn": False}))


@pytest.fixture(scope="module", params=list(WAYS))
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound bag of two joints that stick, with checksums."""
    folder = tmp_path_factory.mktemp(request.param)
    source = simulated_bag(folder / "source.mcap", names=("a", "b"))
    rows = [(topic, KINDS.get(topic, JOINT_STATE), 1e-9 * time, data) for topic, time, data in messages_of(source)]
    return write_mcap(folder / "bag.mcap", rows, **WAYS[request.param])


def outcome(path: Path) -> tuple[str, list[str], str]:
    """What an analysis comes to: joints as JSON, warnings, error."""
    try:
        found = bag_json(analyze(path, _OPTIONS))
    except StickSlipError as error:
        return "", [], str(error)
    return json.dumps(found["joints"]), found["warnings"], ""


def check(path: Path, intact: str) -> str:
    """Whether the outcome is honest: an error in one line, a warning, or the whole answer; returns which."""
    joints, warnings, error = outcome(path)
    assert "\n" not in error
    assert len(error) < 1000
    assert error or warnings or joints == intact, "a wrong answer without a word"
    return "error" if error else "partial" if joints != intact else "whole"


@pytest.mark.parametrize("count", [12, nightly(50)])
def test_truncated_anywhere(whole: Path, tmp_path: Path, count: int) -> None:
    """Issue 6: truncated at random bytes: an error in one line, or what was before the cut, with a warning."""
    intact, warnings, _ = outcome(whole)
    assert not warnings
    content, generator = whole.read_bytes(), np.random.default_rng(1)
    path = tmp_path / "cut.mcap"
    found = []
    for length in sorted(generator.integers(0, len(content), count).tolist()):
        path.write_bytes(content[:length])
        found.append(check(path, intact))
        if length > 0.5 * len(content):
            # Half of the file is enough for the better part of an answer.
            assert found[-1] in ("partial", "whole")
            assert len(read_joint(path, "a")) > 0.3 * len(read_joint(whole, "a"))
    assert "partial" in found


@pytest.mark.parametrize("count", [15, nightly(70)])
def test_bits_flipped_anywhere(whole: Path, tmp_path: Path, count: int) -> None:
    """Issue 6: a bit flipped at random places of each kind of file: no traceback, no wrong answer without a word."""
    intact, _, _ = outcome(whole)
    content, generator = whole.read_bytes(), np.random.default_rng(2)
    path = tmp_path / "flipped.mcap"
    found = []
    for place, bit in zip(generator.integers(0, len(content), count), generator.integers(0, 8, count), strict=True):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(bit)
        path.write_bytes(damaged)
        found.append(check(path, intact))
    assert found.count("error") < 0.1 * len(found)


def test_a_damaged_index_costs_nothing(whole: Path, tmp_path: Path) -> None:
    """Issue 6: with an index damaged at the end, everything before it is analysed."""
    intact, _, _ = outcome(whole)
    content = whole.read_bytes()
    start = int.from_bytes(content[-8 - 20 : -8 - 12], "little")
    damaged = bytearray(content)
    for place in range(start + 9, len(content) - 40, 7):
        damaged[place] ^= 0xFF
    path = tmp_path / "index.mcap"
    path.write_bytes(damaged)
    joints, warnings, error = outcome(path)
    assert not error
    assert joints == intact
    assert any("index" in warning for warning in warnings)


def test_an_index_that_counts_no_messages(tmp_path: Path) -> None:
    """A file without statistics was said to have no messages."""
    rows = [
        ("/joint_states", JOINT_STATE, time, joint_state(time, ["a"], position=[0.1]))
        for time in np.linspace(1.0, 2.0, 100).tolist()
    ]
    path = write_mcap(tmp_path / "bag.mcap", rows, use_statistics=False)
    assert analyze(path, WITHOUT_LEARNING).joints["a"].samples == 100


def test_an_index_that_names_a_place_beyond_any_file(tmp_path: Path) -> None:
    """With a checksum that is right: it once cost the whole bag."""
    path = simulated_bag(tmp_path / "a.mcap", duration=2.0)
    intact = outcome(path)[0]
    content = bytearray(path.read_bytes())
    end = len(content) - 8 - 20  # of the last record's content, before the magic bytes
    at = begin = int.from_bytes(content[end : end + 8], "little")
    while content[at] != 0x08:  # the index of a chunk
        at += 9 + int.from_bytes(content[at + 1 : at + 9], "little")
    content[at + 9 + 16 : at + 9 + 24] = (2**63).to_bytes(8, "little")
    content[end + 16 : end + 20] = zlib.crc32(content[begin : end + 16]).to_bytes(4, "little")
    path.write_bytes(content)
    joints, warnings, error = outcome(path)
    assert (joints, error) == (intact, "")
    assert warnings == ["a.mcap: its index is damaged; read from the start as far as it goes"]


def test_a_bag_that_was_not_closed(whole: Path, tmp_path: Path) -> None:
    """Issue 6: a recorder that was killed leaves no index; what it wrote is analysed."""
    content = whole.read_bytes()
    start = int.from_bytes(content[-8 - 20 : -8 - 12], "little")
    path = tmp_path / "killed.mcap"
    path.write_bytes(content[: start - 13])
    joints, warnings, _ = outcome(path)
    assert joints == outcome(whole)[0]
    assert any("not closed" in warning for warning in warnings)


def refused(path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The line that `stickslip analyze` says of a file that cannot be analysed."""
    assert main(["analyze", str(path), "--json"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("stickslip: ")
    assert str(path) in lines[0]
    return lines[0]


def test_files_that_are_no_bags(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6: empty, not a bag, missing, without messages or joints: an error in one line that names the file."""
    path = tmp_path / "bag.mcap"
    assert "no such file" in refused(path, capsys)
    path.write_bytes(b"")
    assert "is empty" in refused(path, capsys)
    path.write_bytes(os.urandom(5000))
    assert "neither an MCAP file nor" in refused(path, capsys)
    write_mcap(path, [])
    assert "no topic of sensor_msgs/msg/JointState" in refused(path, capsys)
    write_mcap(path, [("/chatter", "std_msgs/msg/String", 1.0, b"\0\1\0\0\1\0\0\0\0")])
    assert "/chatter (std_msgs/msg/String)" in refused(path, capsys)
    write_mcap(path, [("/joint_states", JOINT_STATE, 1.0, joint_state(1.0, []))] * 3)
    assert "no joint in it" in refused(path, capsys)
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("nonsense: [", encoding="utf-8")
    assert "no .mcap, .db3 or .bag file is in it" in refused(folder, capsys)


def test_wrong_schemas_and_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6: a type of another definition is refused; messages that are not of the type are counted."""
    path = tmp_path / "bag.mcap"
    rows: list[tuple[str, str, float, Any]] = [
        ("/joint_states", JOINT_STATE, 1.0 + 0.01 * index, joint_state(1.0 + 0.01 * index, ["a"], position=[0.1]))
        for index in range(100)
    ]
    other = definition("sensor_msgs/msg/Imu")
    write_mcap(path, rows, schemas={JOINT_STATE: ("ros2msg", other)})
    assert "has the fields header, orientation" in refused(path, capsys)
    write_mcap(path, rows, schemas={JOINT_STATE: ("ros2msg", "no definition at all ///")})
    assert "its definition of sensor_msgs/msg/JointState" in refused(path, capsys)
    write_mcap(path, [(*row[:3], b"\0\1\0\0" + bytes([index])) for index, row in enumerate(rows)])
    assert "100 messages left out" in refused(path, capsys)
    twice = joint_state(1.5, ["a", "a"], position=[0.1, 0.2])
    uneven = joint_state(1.6, ["a", "b"], position=[0.1])
    write_mcap(path, [*rows, (*rows[0][:3], twice), (*rows[0][:3], uneven)])
    found = analyze(path, WITHOUT_LEARNING)
    assert found.joints["a"].samples == 100
    assert any("occurs twice" in warning for warning in found.warnings)
    assert any("1 values for 2 names" in warning for warning in found.warnings)


def test_missing_split_file(tmp_path: Path) -> None:
    """Issue 6: a split file that is missing is named, and the others are analysed."""
    folder = tmp_path / "bag"
    folder.mkdir()
    source = simulated_bag(tmp_path / "source.mcap")
    rows = [(topic, KINDS.get(topic, JOINT_STATE), 1e-9 * time, data) for topic, time, data in messages_of(source)]
    write_mcap(folder / "bag_1.mcap", [row for row in rows if row[2] > 6.0])
    information = {"relative_file_paths": ["bag_0.mcap", "bag_1.mcap"], "storage_identifier": "mcap"}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    found = analyze(folder, WITHOUT_LEARNING)
    assert any("bag_0.mcap: missing" in warning for warning in found.warnings)
    assert found.joints["joint1"].start > 6.0


def test_unreadable_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 6: a file without permission to read it is an error in one line."""
    path = simulated_bag(tmp_path / "bag.mcap", duration=2.0)
    # Nobody may read the packages either: they are imported before.
    assert main(["analyze", str(path), "--no-learning"]) == 0
    capsys.readouterr()
    path.chmod(0)
    user = os.geteuid()
    try:
        if user == 0:
            # Root can read everything; nobody cannot.
            os.seteuid(65534)
        assert "ermission" in refused(path, capsys)
    finally:
        os.seteuid(user)


def test_what_was_read_of_a_database_before_a_damage_counts(tmp_path: Path) -> None:
    """A database with a damaged page was refused; where it could be counted, up to 4096 messages read were lost."""
    path = tmp_path / "bag.db3"
    columns = "id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT"
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(f"CREATE TABLE topics({columns})")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        # As recorders make it; without it all is sorted before any message is read.
        database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        database.execute("INSERT INTO topics VALUES(1, '/joint_states', ?, 'cdr', '')", (JOINT_STATE,))
        states = (joint_state(0.01 * index, ["a"], position=[1e-3 * index]) for index in range(1, 3001))
        rows = [
            (1, 10_000_000 * index, bytes(STORE.serialize_cdr(state, JOINT_STATE)))
            for index, state in enumerate(states, 1)
        ]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
        size = database.execute("PRAGMA page_size").fetchone()[0]
    content = bytearray(path.read_bytes())
    leaf = content.index(rows[2000][2]) // size * size
    content[leaf : leaf + size] = b"\xff" * size
    path.write_bytes(content)
    assert 1500 < len(read_joint(path, "a")) <= 2001
    assert any("reading stopped after" in warning for warning in outcome(path)[1])
