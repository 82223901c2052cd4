# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Issue 34: recordings as other programs write them; each test is a row of docs/recordings.md#what-is-read."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from conftest import nightly
from support_bags import JOINT_STATE, joint_state, read_joint, simulated_bag, write_mcap

from stickslip_ros.cli.main import main
from stickslip_ros.messages.joint_states import WholeTurns

pytestmark = pytest.mark.slow

TURN = 2.0 * math.pi


def wrapped(values: np.ndarray, least: float) -> np.ndarray:
    """Positions within one turn from the least one on."""
    return np.mod(values - least, TURN) + least


@pytest.mark.parametrize("least", [-math.pi, 0.0])
def test_a_continuous_joint_that_wraps(least: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is judged as if it did not, and that is said; positions that jump otherwise are left alone."""
    plain = read_joint(simulated_bag(tmp_path / "plain.mcap"), "joint1")
    found = {}
    for name, position, wanted in (
        ("plain", plain.position, plain.reference_position),
        ("wrapped", *(wrapped(one + least - 0.03, least) for one in (plain.position, plain.reference_position))),
    ):
        messages = []
        for time, value, reference in zip(plain.time, position, wanted, strict=True):
            message = joint_state(time, ["joint1"], position=[reference])
            messages.append(("/joint_references", JOINT_STATE, time, message))
            messages.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["joint1"], position=[value])))
        write_mcap(tmp_path / "a.mcap", messages)
        assert main(["analyze", str(tmp_path / "a.mcap"), "--json", "--no-learning"]) == 0
        found[name] = json.loads(capsys.readouterr().out)["bags"][0]
    assert "joint1: position wraps at a whole turn" in " ".join(found["wrapped"]["warnings"])
    one, other = (found[name]["joints"]["joint1"] for name in ("plain", "wrapped"))
    assert one["status"] == other["status"] == "stick_slip"
    assert len(one["cycles"]) == len(other["cycles"])
    assert "wraps" not in " ".join(found["plain"]["warnings"])


def test_servo_counts_that_wrap(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A servo whose count starts again at 4096 moves on."""
    counts = np.mod(np.floor(40.0 * np.arange(600)), 4096).astype(int)
    rows = "\n".join(f"{0.02 * number:.3f},{count}" for number, count in enumerate(counts.tolist()))
    (tmp_path / "a.csv").write_text(f"time_s,pos_counts\n{rows}\n", encoding="utf-8")
    out = tmp_path / "a.mcap"
    command = ["convert", str(tmp_path / "a.csv"), "--out", str(out), "--column", "position=pos_counts:counts/4096"]
    assert main(command) == 0
    assert main(["analyze", str(out), "--no-learning", "--json"]) == 0
    bag = json.loads(capsys.readouterr().out)["bags"][0]
    assert "position wraps at a whole turn; it is read on as a continuous one (5 times)" in bag["warnings"][0]
    assert bag["joints"]["joint1"]["status"] == "smooth"
    batch = read_joint(out, "joint1")
    np.testing.assert_allclose(np.diff(batch.position), TURN * 40 / 4096)


@pytest.mark.parametrize("size", [1, 7, 400])
def test_whole_turns_are_removed_alike_in_batches_of_any_size(size: int) -> None:
    """Three turns forwards and back, with gaps; a joint that counts its turns, or is wrong once, is left alone."""
    times = np.arange(0.0, 8.0, 0.02)
    motion = 9.0 * np.sin(times)
    broken = motion.copy()
    broken[50:52] = np.nan
    cases = [(wrapped(broken, -math.pi), broken), (motion, motion)]
    glitch = np.full(len(times), 0.6)
    glitch[100] = -math.pi
    cases.append((glitch, glitch))
    for number, (given, right) in enumerate(cases):
        turns = WholeTurns()
        rows = np.column_stack([times, given])
        parts = [turns.removed("a", rows[begin : begin + size])[:, 1] for begin in range(0, len(rows), size)]
        np.testing.assert_allclose(np.concatenate(parts), right, atol=1e-9)
        assert bool(turns.counts) == (number == 0)


def test_wrong_values_about_a_turn_away_leave_no_turn_behind() -> None:
    """Every tenth sample is zero, at positions from 5 to 6.3 rad: the others stay where they are."""
    times = np.arange(0.0, 13.0, 0.01)
    right = 5.0 + 0.1 * times
    rows = np.column_stack([times, np.where(np.arange(len(times)) % 10 == 5, 0.0, right)])
    found = WholeTurns().removed("a", rows)[:, 1]
    measured = np.arange(len(times)) % 10 != 5
    np.testing.assert_allclose(found[measured], right[measured], atol=1e-9)


ARM = ("shoulder_pan", "elbow", "wrist", "x", "y", "z", "gripper")


def write_data_set(
    folder: Path,
    version: str,
    *,
    names: Any = tuple(f"{joint}.pos" for joint in ARM),
    actions: Any = tuple(f"{joint}.pos" for joint in ARM[::-1] if joint != "gripper"),
    units: Any = "rad",
    lengths: Sequence[int] = (900, 600),
) -> Path:
    """A LeRobot data set of seven states and six actions in another order, as version 2.1 or 3.0 lays it out."""
    tables = []
    for episode, length in enumerate(lengths):
        times = np.arange(length) / 30.0
        steps, part = np.divmod(0.02 * times / 0.02, 1.0)
        ramp = np.clip(part / 0.3, 0.0, 1.0)
        stairs = 0.02 * (steps + ramp**2 * (3.0 - 2.0 * ramp))
        state = np.stack([stairs + number for number in range(7)], axis=1).astype(np.float32)
        action = np.stack([0.02 * times + number for number in range(5, -1, -1)], axis=1).astype(np.float32)
        tables.append(
            pa.table(
                {
                    "observation.images.top": pa.array([{"bytes": b"x", "path": None}] * length),
                    "observation.state": pa.array(list(state), pa.list_(pa.float32(), 7)),
                    "action": pa.array(list(action), pa.list_(pa.float32(), 6)),
                    "timestamp": pa.array(times.astype(np.float32)),
                    "frame_index": pa.array(np.arange(length)),
                    "episode_index": pa.array(np.full(length, episode)),
                }
            )
        )
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    if version.startswith("v2"):
        for episode, table in enumerate(tables):
            pyarrow.parquet.write_table(table, data / f"episode_{episode:06d}.parquet")
    else:
        pyarrow.parquet.write_table(pa.concat_tables(tables), data / "file-000.parquet", row_group_size=400)
    features = {
        "observation.state": {"dtype": "float32", "shape": [7], "names": names} | ({"units": units} if units else {}),
        "action": {"dtype": "float32", "shape": [6], "names": actions} | ({"units": units} if units else {}),
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    (folder / "meta").mkdir()
    info = {"codebase_version": version, "fps": 30, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_lerobot_data_sets(version: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Episodes are recordings; actions are references of the states of the same names, in whatever order they are."""
    folder = write_data_set(tmp_path / "set", version)
    assert main(["analyze", str(folder), "--no-learning", "--json"]) == 0
    bags = json.loads(capsys.readouterr().out)["bags"]
    assert [Path(one["path"]).name for one in bags] == ["episode_000000", "episode_000001"]
    for bag in bags:
        assert list(bag["joints"]) == list(ARM)
        assert bag["joints"]["shoulder_pan"]["status"] == "stick_slip"
        assert bag["warnings"] == []
    batch = read_joint(folder / "episode_000001", "elbow")
    assert len(batch) == 600
    np.testing.assert_allclose(batch.reference_position, 1.0 + 0.02 * np.arange(600) / 30.0, atol=1e-6)
    assert np.isnan(read_joint(folder / "episode_000001", "gripper").reference_position).all()
    columns = ["--column", "position=observation.state.*:deg"]
    assert main(["convert", str(folder / "episode_000000"), "--out", str(tmp_path / "a.mcap"), *columns]) == 0
    converted = read_joint(tmp_path / "a.mcap", "elbow").position
    np.testing.assert_allclose(converted, np.deg2rad(read_joint(folder / "episode_000000", "elbow").position))


def test_one_column_of_a_data_set(tmp_path: Path) -> None:
    """A column that is named keeps its joint, and its action."""
    path = write_data_set(tmp_path / "set", "v2.1") / "episode_000000"
    columns = ["--column", "position=observation.state.elbow:deg"]
    assert main(["convert", str(path), "--out", str(tmp_path / "a.mcap"), *columns]) == 0
    batch = read_joint(tmp_path / "a.mcap", "elbow")
    np.testing.assert_allclose(batch.position, np.deg2rad(read_joint(path, "elbow").position))
    np.testing.assert_allclose(batch.reference_position, read_joint(path, "elbow").reference_position)


def test_data_sets_that_say_less(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without names of its values no action is paired; a unit that is missing or unknown is said to be."""
    for number, (names, actions, units, said) in enumerate(
        (
            ({"motors": list(ARM)}, {"motors": list(ARM[:6])}, None, "gives observation.state no unit: read as rad"),
            (["state"], ["actions"], "rad", "does not name the values of observation.state: action is not used"),
            (list(ARM), ["dx", "dy", "dz", "droll", "dpitch", "dyaw"], "ticks", "the unit 'ticks', which is unknown"),
            ([list(ARM)], [list(ARM[:6])], None, "gives observation.state no unit: read as rad"),
        )
    ):
        folder = write_data_set(tmp_path / str(number), "v3.0", names=names, actions=actions, units=units)
        assert main(["analyze", str(folder / "episode_000000"), "--no-learning", "--json"]) == 0
        bag = json.loads(capsys.readouterr().out)["bags"][0]
        assert said in " ".join(bag["warnings"])
        assert len(bag["joints"]) == 7
        assert any("joint_references" in str(topic) for topic in bag["topics"].values()) == (number in (0, 3))
    assert list(bag["joints"]) == list(ARM)
    for command in (["convert", "--out", str(tmp_path / "a.mcap")], ["compare", str(tmp_path / "1")]):
        assert main([*command, str(tmp_path / "0")]) == 2
        assert "is a LeRobot data set; name one of its episodes, as in" in capsys.readouterr().err
    assert main(["analyze", str(tmp_path / "0" / "episode_000007")]) == 2
    assert "has no episode 7" in capsys.readouterr().err
    (tmp_path / "0" / "meta" / "info.json").write_text("{", encoding="utf-8")
    assert main(["analyze", str(tmp_path / "0" / "episode_000000")]) == 2
    assert "info.json is damaged" in capsys.readouterr().err
    (tmp_path / "1" / "data" / "chunk-000" / "file-000.parquet").write_bytes(b"PAR1")
    assert main(["analyze", str(tmp_path / "1")]) == 2
    assert "file-000.parquet: neither an MCAP file" in capsys.readouterr().err


CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
POINT = "trajectory_msgs/msg/JointTrajectoryPoint"


def controller_state_definition(*points: str) -> str:
    """A definition of JointTrajectoryControllerState that has some points."""
    fields = "\n".join(f"trajectory_msgs/JointTrajectoryPoint {point}" for point in points)
    rule = "=" * 80
    return (
        f"Header header\nstring[] joint_names\n{fields}\n{rule}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\n"
        f"string frame_id\n{rule}\nMSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\n"
        "float64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nduration time_from_start\n"
    )


def _damage(path: Path, random: np.random.Generator, capsys: pytest.CaptureFixture[str]) -> None:
    """Whatever bytes are wrong, what comes is an answer or an error in one line."""
    sound = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for _ in range(30):
        broken = sound.copy()
        broken[random.integers(0, len(broken), 40)] = random.integers(0, 256, 40)
        (path.parent / "broken.bag").write_bytes(broken.tobytes())
        assert main(["analyze", str(path.parent / "broken.bag"), "--no-learning"]) in (0, 2)
        assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("compression", ["none", nightly("bz2"), "lz4"])
def test_bags_of_ros_1(compression: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Joint states and a controller's state with desired, actual and error, as rosbag wrote them."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    plain = read_joint(simulated_bag(tmp_path / "plain.mcap", duration=8.0), "joint1")
    store = get_typestore(Stores.ROS1_NOETIC)
    text = controller_state_definition("desired", "actual", "error")
    store.register({CONTROLLER_STATE: get_types_from_msg(text, CONTROLLER_STATE)[CONTROLLER_STATE]})
    types = store.types
    path = tmp_path / "a.bag"
    writer = Writer(path)
    if compression != "none":
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    nothing = np.zeros(0)
    with writer:
        states = writer.add_connection("/joint_states", JOINT_STATE, typestore=store)
        wanted = writer.add_connection("/arm_controller/state", CONTROLLER_STATE, typestore=store)
        for number, time in enumerate(plain.time.tolist()):
            nanoseconds = round(time * 1e9)
            seconds, rest = divmod(nanoseconds, 10**9)
            stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
            header = types["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="base")
            duration = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)

            def point(position: float, duration: Any = duration) -> Any:
                more = dict.fromkeys(("velocities", "accelerations", "effort"), nothing)
                return types[POINT](positions=np.array([position]), time_from_start=duration, **more)

            position = float(plain.position[number])
            reference = types[CONTROLLER_STATE](
                header=header, joint_names=["joint1"], desired=point(float(plain.reference_position[number])),
                actual=point(position), error=point(0.0),
            )  # fmt: skip
            state = types[JOINT_STATE](header=header, name=["joint1"], position=np.array([position]),
                                       velocity=nothing, effort=nothing)  # fmt: skip
            writer.write(wanted, nanoseconds, store.serialize_ros1(reference, CONTROLLER_STATE))
            writer.write(states, nanoseconds, store.serialize_ros1(state, JOINT_STATE))
    batch = read_joint(path, "joint1")
    np.testing.assert_allclose(batch.time, plain.time, atol=2e-9)
    np.testing.assert_array_equal(batch.position, plain.position)
    np.testing.assert_array_equal(batch.reference_position, plain.reference_position)
    assert main(["analyze", str(tmp_path / "a.bag"), "--no-learning", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bags"][0]["joints"]["joint1"]["status"] == "stick_slip"
    _damage(path, np.random.default_rng(34), capsys)
    if compression == "none":
        # A controller's state that names a type which it does not define ended in a traceback.
        damaged = path.read_bytes().replace(b"MSG: trajectory_msgs/Joint", b"MSG: trajectory_msgs/Other")
        (tmp_path / "undefined.bag").write_bytes(damaged)
        # Without its references nothing tells the slips from commanded motion.
        assert main(["analyze", str(tmp_path / "undefined.bag"), "--no-learning"]) == 2
        assert "joint1: stops and goes while no reference moves; publish" in capsys.readouterr().err
    if compression != "none":
        assert main(["analyze", str(path), "--largest-unpacked", "0.001"]) == 2
        assert "--largest-unpacked MB allows more" in capsys.readouterr().err
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["analyze", str(path)]) == 2
    assert "not a sound bag of ROS 1" in capsys.readouterr().err


def test_messages_of_ros_1_in_mcap(tmp_path: Path) -> None:
    """As `rosbag` bags that were converted into MCAP have them."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros1", "test")
        text = store.generate_msgdef(JOINT_STATE, ros_version=1)[0]
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", text.encode())
        channel = writer.register_channel("/joint_states", "ros1", schema)
        for number in range(20):
            stamp = store.types["builtin_interfaces/msg/Time"](sec=100 + number, nanosec=5)
            header = store.types["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="base")
            message = store.types[JOINT_STATE](
                header=header, name=["hip"], position=np.array([0.5 * number]), velocity=np.zeros(0), effort=np.zeros(0)
            )
            writer.add_message(channel, number, bytes(store.serialize_ros1(message, JOINT_STATE)), number)
        writer.finish()
    batch = read_joint(path, "hip")
    np.testing.assert_allclose(batch.time, 100.0 + np.arange(20))
    assert batch.position.tolist() == [0.5 * number for number in range(20)]


@pytest.mark.parametrize(("kind", "nanoseconds"), [(JOINT_STATE, "nanosec"), ("sensor_msgs/JointState", "nsec")])
def test_joint_states_in_json(kind: str, nanoseconds: str, tmp_path: Path) -> None:
    """MCAP whose messages are JSON, as Foxglove's and other programs write it; null is a value that is missing."""
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("", "test")
        schema = writer.register_schema(kind, "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/joint_states", "json", schema)
        for number in range(50):
            message = {
                "header": {"stamp": {"sec": 100, nanoseconds: 20_000_000 * number}, "frame_id": ""},
                "name": ["hip", "knee"],
                "position": [0.1 * number, None if number == 3 else 1.0],
                "effort": [1, 2],
            }
            writer.add_message(channel, round(1e9) + number, json.dumps(message).encode(), round(1e9))
        writer.add_message(channel, round(2e9), b"{", round(2e9))
        writer.finish()
    batch = read_joint(path, "hip")
    np.testing.assert_allclose(batch.time, 100.0 + 0.02 * np.arange(50))
    np.testing.assert_allclose(batch.position, 0.1 * np.arange(50))
    assert batch.effort.tolist() == [1.0] * 50
    assert np.isnan(batch.velocity).all()
    assert np.flatnonzero(np.isnan(read_joint(path, "knee").position)).tolist() == [3]


@pytest.mark.parametrize(
    ("points", "filled"),
    [
        (("desired", "actual"), "desired"),
        (("reference", "desired"), "desired"),
        (("reference", "desired"), "reference"),
        (("reference", "desired"), "both"),
    ],
)
def test_controllers_fill_one_reference_or_the_other(points: tuple[str, ...], filled: str, tmp_path: Path) -> None:
    """JointTrajectoryControllerState with only desired and actual, and with both of which one is filled, or both."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    text = controller_state_definition(*points).replace("uint32 seq\n", "")
    text = text.replace("time stamp", "builtin_interfaces/Time stamp").replace(
        "Header header", "std_msgs/Header header"
    )
    text = text.replace("duration time", "builtin_interfaces/Duration time")
    store = get_typestore(Stores.ROS2_JAZZY)
    definition = get_types_from_msg(text, CONTROLLER_STATE)[CONTROLLER_STATE]
    store.fielddefs.pop(CONTROLLER_STATE, None)
    store.register({CONTROLLER_STATE: definition})
    types, messages = store.types, []
    nothing = np.zeros(0)
    for number in range(100):
        time = 1.0 + 0.01 * number
        state = joint_state(time, ["joint1"], position=[0.2 * time])
        more = dict.fromkeys(("velocities", "accelerations", "effort"), nothing)
        duration = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
        fields = {
            name: types[POINT](
                positions=np.array([0.3 * time]) if filled in (name, "both") else nothing,
                time_from_start=duration,
                **more,
            )
            for name in points
        }
        message = types[CONTROLLER_STATE](header=state.header, joint_names=["joint1"], **fields)
        messages.append(
            ("/controller_state", CONTROLLER_STATE, time, bytes(store.serialize_cdr(message, CONTROLLER_STATE)))
        )
        messages.append(("/joint_states", JOINT_STATE, time, state))
    rule = "=" * 80
    text += f"{rule}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    text += f"{rule}\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
    path = write_mcap(tmp_path / "a.mcap", messages, schemas={CONTROLLER_STATE: ("ros2msg", text)})
    batch = read_joint(path, "joint1")
    np.testing.assert_allclose(batch.reference_position, 0.3 * batch.time)


def test_metadata_that_name_another_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that was renamed is read all the same; both are named."""
    folder = tmp_path / "bag"
    simulated_bag(folder, duration=4.0)
    (folder / "bag_0.mcap").rename(folder / "renamed.mcap")
    assert main(["analyze", str(folder), "--no-learning", "--json"]) == 0
    bag = json.loads(capsys.readouterr().out)["bags"][0]
    assert "bag_0.mcap: missing; the bag's metadata name it" in bag["warnings"]
    assert "renamed.mcap: read, although the bag's metadata do not name it" in bag["warnings"]
