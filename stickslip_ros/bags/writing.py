# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags as rosbag2 writes them: an MCAP file, or a directory of one with its metadata.yaml."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip_ros.bags.decoding import types_of_ros
from stickslip_ros.bags.storage.formats import METADATA
from stickslip_ros.bags.table import RecordingError
from stickslip_ros.errors import InvalidParameterError, optional_packages
from stickslip_ros.files import whole_file, write_whole
from stickslip_ros.interrupts import check
from stickslip_ros.messages.joint_states import DESCRIPTION, FIELDS, places_of_values, robot_description
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.model.friction import Gains
from stickslip_ros.monitoring.samples import Batch, FloatArray

STATES, REFERENCES, GAINS = "/joint_states", "/joint_references", "/pd_gains"
LAST_STAMP = 2.0**31 - 1.0  # [s]
COMPRESSIONS = ("zstd", "lz4", "none")
_CHUNK_SIZE = 1 << 20

Serialized = tuple[int, str, bytes]  # time of recording [ns], topic, message


class BagWriter:
    """Writes a bag; use as a context. Nothing is there under its name before it is whole.

    Parameters
    ----------
    path : ends in .mcap for one file; else a directory, as rosbag2 makes it.
    topics : type of each.
    compression : one of "zstd", "lz4", "none".

    Raises
    ------
    RecordingError
        If a directory of that name is there already.
    StickSlipError
        If a package is missing.
    InvalidParameterError
        If there is no such compression.
    """

    def __init__(self, path: Path, topics: Mapping[str, str], compression: str = "zstd") -> None:
        with optional_packages(f"bag {path}: writing it"):
            from mcap.writer import CompressionType, Writer

            self._store: Any = types_of_ros()
        if compression not in COMPRESSIONS:
            raise InvalidParameterError("compression", f"one of {', '.join(COMPRESSIONS)}", compression)
        self._directory = path if path.suffix != ".mcap" else None
        if self._directory is not None:
            if self._directory.exists():
                raise RecordingError(f"bag {path}: is there already; choose another name, or one that ends in .mcap")
            self._directory.mkdir(parents=True)
            path = self._directory / f"{path.name}_0.mcap"
        self._path = path
        self._topics = dict(topics)
        self._counts: Counter[str] = Counter()
        self._first, self._last = 1 << 63, 0
        self._stack = ExitStack()
        try:
            file = self._stack.enter_context(whole_file(path))
            self._writer = Writer(
                file, chunk_size=_CHUNK_SIZE, compression=CompressionType[compression.upper()], enable_data_crcs=True
            )
            self._writer.start(profile="ros2", library="stickslip_ros")
            self._channels = {topic: self._channel(topic, kind) for topic, kind in self._topics.items()}
        except BaseException as error:
            self.__exit__(type(error), error, error.__traceback__)
            raise

    def _channel(self, topic: str, kind: str) -> int:
        text = self._store.generate_msgdef(kind, ros_version=2)[0]
        schema = self._writer.register_schema(name=kind, encoding="ros2msg", data=text.encode())
        return int(self._writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema))

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *raised: Any) -> None:
        if raised[0] is not None:
            self._stack.__exit__(*raised)
            if self._directory is not None:
                self._directory.rmdir()
            return
        with self._stack:
            metadata = self._metadata()
            self._writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(metadata, sort_keys=False)})
            self._writer.finish()
        if self._directory is not None:
            text = yaml.safe_dump({"rosbag2_bagfile_information": metadata}, sort_keys=False)
            write_whole(self._directory / METADATA, text)

    def write(self, *streams: Iterable[Serialized]) -> None:
        """Write serialized messages, of several streams in the order of their recording."""
        for time, topic, data in heapq.merge(*streams, key=lambda one: one[0]):
            check()
            self._writer.add_message(self._channels[topic], log_time=time, data=data, publish_time=time)
            self._counts[topic] += 1
            self._first, self._last = min(self._first, time), max(self._last, time)

    def message(self, kind: str, **fields: Any) -> Any:
        """An object of a type, e.g. ``message("std_msgs/msg/String", data="")``."""
        return self._store.types[kind](**fields)

    def table(self, rows: str, columns: str, values: FloatArray) -> Any:
        """A Float64MultiArray of labelled rows and columns, values of shape (rows, columns)."""
        kind = "std_msgs/msg/MultiArray"
        dimensions = [
            self.message(f"{kind}Dimension", label=rows, size=values.shape[0], stride=values.size),
            self.message(f"{kind}Dimension", label=columns, size=values.shape[1], stride=values.shape[1]),
        ]
        layout = self.message(f"{kind}Layout", dim=dimensions, data_offset=0)
        return self.message("std_msgs/msg/Float64MultiArray", layout=layout, data=values.ravel())

    def serialized(self, time: int, topic: str, message: Any) -> Serialized:
        """A message as it is written, recorded at a time [ns]."""
        return time, topic, bytes(self._store.serialize_cdr(message, self._topics[topic]))

    def _metadata(self) -> dict[str, Any]:
        begin = self._first if self._counts else 0
        duration, count = max(self._last - begin, 0), sum(self._counts.values())
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": "",
                },
                "message_count": self._counts[topic],
            }
            for topic, kind in self._topics.items()
        ]
        return {
            "version": 5,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": duration},
            "starting_time": {"nanoseconds_since_epoch": begin},
            "message_count": count,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._path.name],
            "files": [
                {
                    "path": self._path.name,
                    "starting_time": {"nanoseconds_since_epoch": begin},
                    "duration": {"nanoseconds": duration},
                    "message_count": count,
                }
            ],
        }


def serialized_joint_states(
    topic: str, names: tuple[str, ...], times: FloatArray, values: FloatArray
) -> Iterator[Serialized]:
    """JointStates recorded at their stamps.

    Parameters
    ----------
    times : stamps [s], of shape (n,). values : position, velocity and effort, of shape (n, 3, joints); a field that is
        NaN throughout is left out, as publishers do.
    """
    store = types_of_ros()
    present = [bool(np.isfinite(values[:, index]).any()) for index in range(len(FIELDS))]
    blank = {name: np.zeros(len(names) if there else 0) for name, there in zip(FIELDS, present, strict=True)}
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    template = store.types[JOINT_STATE](header=header, name=list(names), **blank)
    data = bytes(store.serialize_cdr(template, JOINT_STATE))
    nanoseconds = np.round(times * 1e9).astype(np.int64)
    rows = np.tile(np.frombuffer(data, dtype=np.uint8), (len(times), 1))
    rows[:, 4:8] = (nanoseconds // 1_000_000_000).astype("<i4")[:, None].view(np.uint8)
    rows[:, 8:12] = (nanoseconds % 1_000_000_000).astype("<u4")[:, None].view(np.uint8)
    for index, place in zip(np.flatnonzero(present), places_of_values(data), strict=True):
        column = np.ascontiguousarray(values[:, index], dtype="<f8")
        rows[:, place : place + column.shape[1] * 8] = column.view(np.uint8)
    for time, row in zip(nanoseconds.tolist(), rows, strict=True):
        yield time, topic, row.tobytes()


def joint_state_streams(
    batches: Mapping[str, Batch], start: float
) -> tuple[FloatArray, dict[str, Iterator[Serialized]]]:
    """Stamps [s]; joint states and, if there are any, references of joints as serialized JointStates, by topic.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples whose time no stamp can be are left out.
    start : what is added to the times [s].
    """
    names = tuple(batches)
    times = batches[names[0]].time + start
    known = (times >= 0.0) & (times <= LAST_STAMP)
    times = times[known]
    parts = [batch.where(known) for batch in batches.values()]
    nothing = np.full(len(times), np.nan)
    states = np.stack([np.stack([one.position, one.velocity, one.effort], axis=1) for one in parts], axis=2)
    references = np.stack(
        [np.stack([one.reference_position, one.reference_velocity, nothing], axis=1) for one in parts], axis=2
    )
    streams = {STATES: serialized_joint_states(STATES, names, times, states)}
    if np.isfinite(references).any():
        # Before the samples that they are the references of.
        streams = {REFERENCES: serialized_joint_states(REFERENCES, names, times, references), **streams}
    return times, streams


def write_recording(
    path: Path,
    batches: Mapping[str, Batch],
    start: float,
    gains: Gains | None = None,
    compression: str = "zstd",
    *,
    prismatic: Sequence[str] = (),
) -> int:
    """Write samples of joints as a bag; returns how many of each.

    Parameters
    ----------
    batches : of each joint, all of the same times; samples whose time no stamp can be are left out.
    start : what is added to the times [s]. gains : of each joint's controller then, None if unknown.
    prismatic : joints whose positions are in metres, which the bag says by a description of the robot.

    Raises
    ------
    RecordingError
        If there is a directory of that name already.
    """
    names = tuple(batches)
    times, streams = joint_state_streams(batches, start)
    # The states' channel is the first in the file.
    topics = {topic: JOINT_STATE for topic in (STATES, REFERENCES) if topic in streams}
    if gains is not None:
        topics[GAINS] = "std_msgs/msg/Float64MultiArray"
    if prismatic:
        topics[DESCRIPTION] = "std_msgs/msg/String"
    with BagWriter(path, topics, compression) as writer:
        if prismatic and len(times):
            text = writer.message("std_msgs/msg/String", data=robot_description(names, prismatic))
            writer.write([writer.serialized(round(float(times[0]) * 1e9), DESCRIPTION, text)])
        if gains is not None and len(times):
            kinds = {"p": gains.stiffness, "i": gains.integral, "d": gains.damping}
            kinds = {kind: gain for kind, gain in kinds.items() if kind != "i" or gain}
            values = np.tile([float(value) for value in kinds.values()], (len(names), 1))
            table = writer.table(",".join(names), ",".join(kinds), values)
            writer.write([writer.serialized(round(float(times[0]) * 1e9), GAINS, table)])
        writer.write(*streams.values())
    return len(times)
