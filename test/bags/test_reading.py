# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags of every storage, compression and content give the same samples."""

from __future__ import annotations

import math
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.convert import convert as convert_bag
from rosbags.rosbag2 import StoragePlugin
from support_bags import JOINT_STATE, STORE, joint_state, messages_of, read_joint, simulated_bag, write_mcap

from stickslip_ros.bags.table import RecordingError
from stickslip_ros.bags.topics import TopicChoice
from stickslip_ros.messages.joint_states import Block, JointStateDecoder
from stickslip_ros.monitoring.samples import Batch

CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
CONTROLLER_STATE_TEXT = f"""std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{"=" * 80}
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
{"=" * 80}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""
DOF_STATES = "control_msgs/msg/MultiDOFStateStamped"
DOF_STATES_TEXT = f"""std_msgs/Header header
control_msgs/SingleDOFState[] dof_states
{"=" * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{"=" * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{"=" * 80}
MSG: control_msgs/SingleDOFState
string name
float64 reference
float64 feedback
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two joints, three seconds."""
    return simulated_bag(tmp_path_factory.mktemp("bags") / "bag.mcap", names=("a", "b"), duration=3.0)


def same(one: Batch, other: Batch) -> None:
    """Whether two batches are the same, NaN included."""
    for name in Batch.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def rewritten(bag: Path, path: Path, **more: Any) -> Path:
    """The same messages, written otherwise."""
    kinds = {"/pd_gains": "std_msgs/msg/Float64MultiArray"}
    content = [(topic, kinds.get(topic, JOINT_STATE), 1e-9 * time, data) for topic, time, data in messages_of(bag)]
    return write_mcap(path, content, **more)


@pytest.mark.parametrize(
    "how",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.ZSTD},
        {"compression": CompressionType.ZSTD, "chunk_size": 2000},
        {"use_chunking": False},
        {"use_chunking": False, "use_statistics": False, "use_summary_offsets": False, "repeat_channels": False},
        {"enable_crcs": False},
        {"compression": CompressionType.LZ4, "repeat_channels": False, "repeat_schemas": False},
        {"schemas": {JOINT_STATE: ("", "")}},
        {"channels_each": 3},
        {"channels_each": 3, "use_chunking": False, "use_statistics": False},
    ],
)
def test_every_way_of_writing_mcap_reads_the_same(bag: Path, tmp_path: Path, how: dict[str, Any]) -> None:
    """Issue 6, item 1: every compression, chunked and unchunked, with and without index and schema."""
    same(read_joint(bag, "b"), read_joint(rewritten(bag, tmp_path / "other.mcap", **how), "b"))


def test_a_whole_file_may_be_compressed(bag: Path, tmp_path: Path) -> None:
    """Issue 6, item 1: rosbag2's file compression, as a file and in a directory."""
    packed = tmp_path / "packed.mcap.zstd"
    packed.write_bytes(zstandard.ZstdCompressor().compress(bag.read_bytes()))
    same(read_joint(bag, "a"), read_joint(packed, "a"))
    long = simulated_bag(tmp_path / "long.mcap", duration=30.0, compression="none")
    whole = zstandard.ZstdCompressor().compress(rewritten(long, tmp_path / "chunks.mcap", chunk_size=5000).read_bytes())
    packed.write_bytes(whole[: 6 * len(whole) // 10])
    read = read_joint(packed, "joint1")
    assert 1000 < len(read) < 6000
    same(read, read_joint(long, "joint1").where(slice(0, len(read))))


def test_rosbag2_directories(bag: Path, tmp_path: Path) -> None:
    """Issue 6, item 1: metadata.yaml, split bags, sqlite3, without metadata, as the package rosbags writes them."""
    expected = read_joint(bag, "a")
    folder = tmp_path / "folder"
    folder.mkdir()
    content = messages_of(bag)
    middle = 1e-9 * content[len(content) // 2][1]
    kinds = {"/pd_gains": "std_msgs/msg/Float64MultiArray"}
    rows = [(topic, kinds.get(topic, JOINT_STATE), 1e-9 * time, data) for topic, time, data in content]
    write_mcap(folder / "folder_0.mcap", [row for row in rows if row[2] < middle])
    write_mcap(folder / "folder_1.mcap", [row for row in rows if row[2] >= middle])
    same(expected, read_joint(folder, "a"))
    information = {"relative_file_paths": ["folder_0.mcap", "folder_1.mcap"], "storage_identifier": "mcap"}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    same(expected, read_joint(folder, "a"))
    (folder / "folder_0.mcap").unlink()
    assert read_joint(folder, "a").time[0] >= middle - 0.01
    simulated = simulated_bag(tmp_path / "directory", names=("a", "b"), duration=3.0)
    same(expected, read_joint(simulated, "a"))
    convert_bag(
        [simulated], tmp_path / "sqlite", dst_storage=StoragePlugin.SQLITE3, dst_version=9, compress=None,
        compress_mode="none", default_typestore=STORE, typestore=None, exclude_topics=[], include_topics=[],
        exclude_msgtypes=[], include_msgtypes=[],
    )  # fmt: skip
    same(expected, read_joint(tmp_path / "sqlite", "a"))
    database = next((tmp_path / "sqlite").glob("*.db3"))
    same(expected, read_joint(database, "a"))
    other = tmp_path / "named_otherwise.bag"
    shutil.copy(database, other)
    same(expected, read_joint(other, "a"))


def test_names_permuted_and_values_missing(tmp_path: Path) -> None:
    """Issue 6, item 1: names in any order, empty arrays, padding of any content, joints that come and go."""
    rows = []
    for index in range(200):
        time, value = 1.0 + 0.01 * index, float(index)
        names = ["a", "b"] if index % 3 else ["b", "a"]
        position = [value, -value] if index % 3 else [-value, value]
        more = {"velocity": [1.0, 2.0] if index % 3 else [2.0, 1.0]} if index >= 100 else {}
        if index % 50 == 0:
            names, position, more = [*names, f"tool{index}"], [*position, 7.0], {}
        message = joint_state(time, names, position=position, **more)
        rows.append(("/joint_states", JOINT_STATE, time, bytes(STORE.serialize_cdr(message, JOINT_STATE)) + b"junk"))
    path = write_mcap(tmp_path / "bag.mcap", rows)
    batch = read_joint(path, "a")
    np.testing.assert_array_equal(batch.position, np.arange(200.0))
    assert np.isnan(batch.velocity[:100]).all()
    known = np.isfinite(batch.velocity)
    assert known.sum() == 98
    assert (batch.velocity[known] == 1.0).all()
    assert (read_joint(path, "tool50").position == 7.0).all()


@given(
    st.lists(st.text(max_size=12), min_size=0, max_size=6, unique=True),
    st.text(max_size=9),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
    st.integers(1, 5),
)
def test_any_layout_decodes_as_the_library_does(
    names: list[str], frame: str, present: tuple[bool, bool, bool], count: int
) -> None:
    """Issue 6, item 1: whatever the names, the frame and the fields, values come out as a general decoder has them."""
    names = [name.replace("\0", "") for name in names]
    names = list(dict.fromkeys(names))
    generator = np.random.default_rng(len(names))
    messages = []
    for index in range(count):
        fields = {
            field: generator.standard_normal(len(names))
            for field, there in zip(("position", "velocity", "effort"), present, strict=True)
            if there
        }
        message = joint_state(2.0 + index, names, **fields)
        message.header.frame_id = frame.replace("\0", "")
        messages.append(message)
    data = [bytes(STORE.serialize_cdr(message, JOINT_STATE)) for message in messages]
    block = Block.of_messages([(0, 0, one) for one in data], {})
    decoder = JointStateDecoder()
    found = decoder.decode(block, np.arange(count))
    assert not decoder.refused
    assert [rows.names for rows in found] == [tuple(names)]
    for index, message in enumerate(messages):
        for number, field in enumerate(("position", "velocity", "effort")):
            values = getattr(message, field)
            expected = values if len(values) else np.full(len(names), math.nan)
            np.testing.assert_array_equal(found[0].values[index, number], expected)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=120), st.integers(0, 80), st.integers(0, 255))
def test_any_bytes_are_decoded_or_refused(junk: bytes, place: int, value: int) -> None:
    """Issue 6, damage: no bytes make the decoder fail; what it refuses it counts."""
    whole = bytearray(STORE.serialize_cdr(joint_state(1.0, ["a", "bc"], position=[1.0, 2.0]), JOINT_STATE))
    whole[place % len(whole)] = value
    for data in (junk, bytes(whole), bytes(whole)[:place]):
        decoder = JointStateDecoder()
        found = decoder.decode(Block.of_messages([(0, 0, data)], {}), np.arange(1))
        assert len(found) + sum(decoder.refused.values()) == 1


@pytest.mark.parametrize("kind", [CONTROLLER_STATE, DOF_STATES])
def test_references_of_controllers_from_the_bags_own_definitions(tmp_path: Path, kind: str) -> None:
    """Issue 6, item 1: control_msgs is not installed; the definition that the bag carries is enough."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    text = {CONTROLLER_STATE: CONTROLLER_STATE_TEXT, DOF_STATES: DOF_STATES_TEXT}[kind]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, kind))
    rows: list[tuple[str, str, float, Any]] = []
    for index in range(100):
        time = 1.0 + 0.01 * index
        state = joint_state(time, ["a"], position=[0.0])
        rows.append(("/joint_states", JOINT_STATE, time, state))
        header = store.types["std_msgs/msg/Header"](
            stamp=store.types["builtin_interfaces/msg/Time"](
                sec=state.header.stamp.sec, nanosec=state.header.stamp.nanosec
            ),
            frame_id="",
        )
        if kind == CONTROLLER_STATE:
            empty = np.zeros(0)
            duration = store.types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
            point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"](
                positions=np.array([float(index)]), velocities=np.array([2.0]), accelerations=empty, effort=empty,
                time_from_start=duration,
            )  # fmt: skip
            message = store.types[kind](header=header, joint_names=["a"], reference=point, feedback=point)
        else:
            one = store.types["control_msgs/msg/SingleDOFState"](name="a", reference=float(index), feedback=0.0)
            message = store.types[kind](header=header, dof_states=[one])
        rows.append(("/controller_state", kind, time, bytes(store.serialize_cdr(message, kind))))
    path = write_mcap(tmp_path / "bag.mcap", rows, schemas={kind: ("ros2msg", text)})
    batch = read_joint(path, "a")
    np.testing.assert_array_equal(batch.reference_position, np.arange(100.0))
    # A recorder without the package leaves the definition out: said, and the states are read all the same.
    path = write_mcap(tmp_path / "undefined.mcap", rows, schemas={kind: ("", "")})
    assert np.isnan(read_joint(path, "a").reference_position).all()


def test_what_could_be_several_topics_is_listed_with_its_option(tmp_path: Path) -> None:
    """Issue 6, item 1: topics are found by type; where several could be meant they are listed, and options choose."""
    rows = [
        (topic, JOINT_STATE, 1.0 + 0.01 * index, joint_state(1.0 + 0.01 * index, ["a"], position=[value]))
        for index in range(50)
        for topic, value in (("/left/joint_states", 1.0), ("/right/joint_states", 2.0), ("/left/reference", 3.0))
    ]
    path = write_mcap(tmp_path / "bag.mcap", rows)
    with pytest.raises(RecordingError, match=r"/left/joint_states \(50 messages\), /right.*--states"):
        read_joint(path, "a")
    left = read_joint(path, "a", TopicChoice(states="/left/joint_states"))
    assert (left.position == 1.0).all()
    assert (left.reference_position == 3.0).all()
    right = read_joint(path, "a", TopicChoice(states="/right/joint_states", references=()))
    assert (right.position == 2.0).all()
    assert np.isnan(right.reference_position).all()
    with pytest.raises(RecordingError, match=r"no such topic .*/left/joint_states"):
        read_joint(path, "a", TopicChoice(states="/middle/joint_states"))


def test_missing_stamps_are_times_of_recording(tmp_path: Path) -> None:
    """Issue 6, item 1: a stamp of zero means none; the time of recording stands in, as of arrival live."""
    rows = [
        (topic, JOINT_STATE, time + 0.01 * index, joint_state(0.0, ["a"], position=[float(index)]))
        for index in range(20)
        for topic, time in (("/joint_references", 4.996), ("/joint_states", 5.0))
    ]
    batch = read_joint(write_mcap(tmp_path / "bag.mcap", rows), "a")
    np.testing.assert_allclose(batch.time, 5.0 + 0.01 * np.arange(20))
    np.testing.assert_allclose(batch.reference_position[:-1], np.arange(19) + 0.4)


def test_a_database_that_is_none(tmp_path: Path) -> None:
    """Issue 6, damage: a SQLite file that no recorder wrote is refused in a line."""
    path = tmp_path / "bag.db3"
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE other (a)")
    with pytest.raises(RecordingError, match="not a rosbag2 database"):
        read_joint(path, "a")
