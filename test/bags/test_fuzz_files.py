# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 20: whatever bytes a file has, it is read, or refused by an error of the package, soon.

An hour by hand, with new examples every time:
`FUZZ_EXAMPLES=100000 pytest --hypothesis-profile=default test/bags/test_fuzz_files.py`
"""

from __future__ import annotations

import io
import json
import os
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.convert import convert
from rosbags.rosbag2.enums import StoragePlugin
from support_bags import joint_state, write_mcap

from stickslip_ros.bags.reading import BagReader
from stickslip_ros.bags.storage.bag import Bag
from stickslip_ros.bags.table import load_recording, load_table
from stickslip_ros.bags.topics import TopicChoice, find_robots
from stickslip_ros.errors import StickSlipError
from stickslip_ros.monitoring.friction.change import FrictionChange, ParameterDifference
from stickslip_ros.monitoring.friction.learner import LearnerMemory
from stickslip_ros.monitoring.joint_monitor import JointMemory
from stickslip_ros.nodes.kept_state import as_text, read_state
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_file import Parameters

pytestmark = pytest.mark.slow

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "100"))
LONGEST = 10.0  # [s] for a file of some kB
Change = tuple[float, int, bytes]

# Where, how many bytes are replaced, and by which.
CHANGES = st.lists(
    st.tuples(
        st.floats(0.0, 1.0),
        st.integers(0, 12),
        st.one_of(
            st.binary(max_size=12),
            st.sampled_from([b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, b"&a [*a]", b"\x1b[2J", b"- " * 500]),
        ),
    ),
    max_size=6,
)


def changed(content: bytes, changes: list[Change], kept: float) -> bytes:
    """A file's content with parts replaced, cut off after a share of it."""
    found = bytearray(content)
    for place, count, put in changes:
        at = int(place * len(found))
        found[at : at + count] = put
    return bytes(found[: int(kept * len(found))])


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """What the package says if it refuses a file, "" if it does not."""
    try:
        read(path)
    except (StickSlipError, OSError) as error:
        return str(error)
    return ""


def read_bag(path: Path) -> None:
    """Everything that an analysis reads."""
    with Bag(path) as bag:
        reader = BagReader(bag, find_robots(bag.channels(), TopicChoice()))
        for _ in reader.pieces():
            pass
        assert all(text.isprintable() for text in reader.joints)


def read_parameters(path: Path) -> None:
    """What they say of a joint."""
    Parameters.of_files([path]).settings_of("shoulder")


def _rows(count: int = 60) -> list[tuple[str, str, float, object]]:
    kind = "sensor_msgs/msg/JointState"
    times = [1.0 + 0.01 * number for number in range(count)]
    return [
        row
        for time in times
        for row in (
            ("/joint_references", kind, time, joint_state(time, ("a", "b"), position=[time, 2.0 * time])),
            ("/joint_states", kind, time, joint_state(time, ("a", "b"), position=[time, 2.0 * time])),
        )
    ]


def _mcap(compression: CompressionType) -> Callable[[Path], bytes]:
    def make(folder: Path) -> bytes:
        return write_mcap(folder / "a.mcap", _rows(), compression=compression, chunk_size=4000).read_bytes()

    return make


def _database(folder: Path) -> bytes:
    source = write_mcap(folder / "a.mcap", _rows())
    convert(
        [source], folder / "bag", dst_storage=StoragePlugin.SQLITE3, dst_version=9, compress=None,
        compress_mode="file", default_typestore=None, typestore=None, exclude_topics=(), include_topics=(),
        exclude_msgtypes=(), include_msgtypes=(),
    )  # fmt: skip
    return next((folder / "bag").glob("*.db3")).read_bytes()


PARAMETERS = b"""/**:
  ros__parameters:
    joints: [shoulder, elbow]
    warn_margin: 0.2
    condition: exact
    model.shoulder: puma560_joint1
    gains: {shoulder: {p: 630.0, d: 20.0, i: 0.0}}
    limits: {shoulder: {p_max: 4000.0, d_max: 200.0, bandwidth: 40.0}}
    friction: {shoulder: {stribeck: 1.5, stribeck_velocity: 0.01}}
"""
METADATA = b"""rosbag2_bagfile_information:
  version: 9
  compression_mode: ""
  relative_file_paths:
    - bag_0.mcap
    - bag_1.mcap
"""
JOINT = b"""name: elbow
inertia: 2.0
friction: {stribeck: 1.5, stribeck_velocity: 0.01, coulomb: 3.0, lag: 0.1}
gains: {stiffness: 600.0, damping: 20.0}
velocity: 0.01
assumed: [lag]
"""


def _in_a_bag(path: Path) -> None:
    """Metadata of a bag whose file is sound."""
    folder = path.with_name("whole")
    folder.mkdir(exist_ok=True)
    path.replace(folder / "metadata.yaml")
    if not (folder / "bag_0.mcap").exists():
        write_mcap(folder / "bag_0.mcap", _rows(3))
    read_bag(folder)


def _state() -> bytes:
    """What is remembered of a joint that learnt nothing yet, and of one whose friction changed."""
    difference = ParameterDifference(name="stribeck_velocity", old=1.0, new=0.1)
    change = FrictionChange(time=14.0, learning_anew=False, differences=(difference,))
    learner = LearnerMemory(configured=None, learnt=None, change=change)
    memory = JointMemory(cycles=1, last_cycle=None, friction=learner)
    return as_text({"a": memory, "b": memory})


def _with_checksum(path: Path) -> None:
    body = path.read_bytes()
    header = {"format": "stickslip_ros state", "version": 2, "crc32": zlib.crc32(body)}
    path.write_bytes(json.dumps(header).encode() + b"\n" + body)
    read_state(path)


def _parquet() -> bytes:
    content = io.BytesIO()
    times = np.arange(30.0)
    table = pa.table({"timestamp": times, "position": [[0.1, 0.2]] * 30, "header": [{"seq": 1}] * 30})
    pyarrow.parquet.write_table(table, content)
    return content.getvalue()


def _npz() -> bytes:
    content = io.BytesIO()
    np.savez_compressed(content, time_s=np.arange(30.0), position_rad=np.zeros((30, 2)), joints=np.array(["a", "b"]))
    return content.getvalue()


FILES: dict[str, tuple[str, Callable[[Path], bytes], Callable[[Path], object]]] = {
    "zstd": ("a.mcap", _mcap(CompressionType.ZSTD), read_bag),
    "lz4": ("a.mcap", _mcap(CompressionType.LZ4), read_bag),
    "plain": ("a.mcap", _mcap(CompressionType.NONE), read_bag),
    "packed": (
        "a.mcap.zstd",
        lambda folder: zstandard.ZstdCompressor().compress(_mcap(CompressionType.NONE)(folder)),
        read_bag,
    ),
    "db3": ("a.db3", _database, read_bag),
    "metadata": ("metadata.yaml", lambda _: METADATA, _in_a_bag),
    "parameters": ("a.yaml", lambda _: PARAMETERS, read_parameters),
    "joint": ("a.yaml", lambda _: JOINT, lambda path: load_joint(str(path))),
    "state": ("a.json", lambda _: _state(), read_state),
    "state, checksum right": ("a.json", lambda _: _state().partition(b"\n")[2], _with_checksum),
    "parquet": ("a.parquet", lambda _: _parquet(), load_table),
    "npz": ("a.npz", lambda _: _npz(), load_table),
    "table": ("a.csv", lambda _: b"time_s,position_rad\n" + b"0.01,0.1\n" * 30, load_recording),
    "wide table": ("a.csv", lambda _: b"t;q1;q2\n" + b"0,01;0,1;2,5\n" * 30, load_table),
}


@pytest.mark.parametrize("kind", FILES)
def test_whatever_bytes_a_file_has(kind: str, tmp_path: Path) -> None:
    """Read or refused, in time; nothing else is raised."""
    name, make, read = FILES[kind]
    content = make(tmp_path)

    @settings(
        max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
    )
    @given(changes=CHANGES, kept=st.sampled_from([1.0, 1.0, 1.0, 0.99, 0.5, 0.0]))
    def whatever(changes: list[Change], kept: float) -> None:
        path = tmp_path / name
        path.write_bytes(changed(content, changes, kept))
        began = time.process_time()
        refused = refusal(read, path)
        assert refused.isprintable()
        assert time.process_time() - began < LONGEST

    whatever()


@settings(max_examples=EXAMPLES, deadline=None)
@given(content=st.binary(max_size=300), kind=st.sampled_from(sorted(FILES)))
def test_bytes_that_mean_nothing(content: bytes, kind: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Files that never were of the kind, with its first bytes or without."""
    name, _, read = FILES[kind]
    begin = {"a.mcap": b"\x89MCAP0\r\n", "a.db3": b"SQLite format 3\0", "a.mcap.zstd": b"\x28\xb5\x2f\xfd"}
    path = tmp_path_factory.mktemp("any") / name
    for before in (b"", begin.get(name, b"")):
        path.write_bytes(before + content)
        assert refusal(read, path).isprintable()
