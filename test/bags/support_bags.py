# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Bags for the tests: simulated recordings, and what is in one as the mcap package sees it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from stickslip_ros.analysis.analysis import AnalysisOptions
from stickslip_ros.bags.reading import read_joint_with_gains
from stickslip_ros.bags.simulated import RecordedJoint, write_simulation
from stickslip_ros.bags.topics import TopicChoice
from stickslip_ros.monitoring.samples import Batch
from stickslip_ros.settings.known_joints import load_joint
from stickslip_ros.settings.parameter_file import Parameters

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE = "sensor_msgs/msg/JointState"
KNOWN = load_joint("puma560_joint1")
# Learning takes seconds; where it is not the matter, it is left out.
WITHOUT_LEARNING = AnalysisOptions(parameters=Parameters({"learn": False, "model.*": "puma560_joint1"}))


def sticking(velocity: float = 0.008) -> RecordedJoint:
    """A joint that sticks and slips."""
    return RecordedJoint(
        joint=KNOWN.joint, gains=KNOWN.gains, velocities=(velocity,), encoder_resolution=KNOWN.encoder_resolution
    )


def simulated_bag(path: Path, *, names: Sequence[str] = ("joint1",), duration: float = 12.0, **more: Any) -> Path:
    """A bag of joints that stick; joint n moves at n times the speed."""
    joints = {name: sticking(0.008 * (number + 1)) for number, name in enumerate(names)}
    write_simulation(path, joints, duration=duration, **{"rate": 200.0, **more})
    return path


def messages_of(path: Path) -> list[tuple[str, int, bytes]]:
    """Topic, time of recording and serialized message, by the mcap package."""
    with path.open("rb") as file:
        return [(channel.topic, one.log_time, one.data) for _, channel, one in make_reader(file).iter_messages()]


def read_joint(path: Path, joint: str, choice: TopicChoice | None = None) -> Batch:
    """Everything recorded of one joint, with its reference; its gains are not looked for."""
    return read_joint_with_gains(path, joint, replace(choice or TopicChoice(), gains=""))[0]


def joint_state(time: float, names: Sequence[str], **fields: Iterable[float]) -> Any:
    """A JointState; fields that are left out are empty."""
    seconds, nanoseconds = divmod(round(time * 1e9), 1_000_000_000)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    values = {name: np.array(list(fields.get(name, ())), dtype=float) for name in ("position", "velocity", "effort")}
    header = STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    return STORE.types[JOINT_STATE](header=header, name=list(names), **values)


def write_mcap(
    path: Path,
    messages: Iterable[tuple[str, str, float, bytes | Any]],
    *,
    schemas: dict[str, tuple[str, str]] | None = None,
    compression: CompressionType = CompressionType.NONE,
    channels_each: int = 1,
    **more: Any,
) -> Path:
    """Write messages of topic, type, time of recording [s] and content by the mcap package.

    ``schemas`` gives encoding and text of a type where they are not to be the right ones; with ``channels_each``
    messages of a topic take so many channels by turns, as in files that were merged.
    """
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, **more)
        writer.start("ros2", "test")
        channels: dict[str, list[int]] = {}
        for topic, kind, time, content in messages:
            if topic not in channels:
                encoding, text = (schemas or {}).get(kind) or ("ros2msg", definition(kind))
                schema = writer.register_schema(kind, encoding, text.encode())
                channels[topic] = [writer.register_channel(topic, "cdr", schema) for _ in range(channels_each)]
            data = content if isinstance(content, bytes) else bytes(STORE.serialize_cdr(content, kind))
            channels[topic].append(channels[topic].pop(0))
            writer.add_message(channels[topic][0], round(time * 1e9), data, round(time * 1e9))
        writer.finish()
    return path


def definition(kind: str) -> str:
    """The text of a type that ROS 2 Jazzy has; empty for others."""
    return STORE.generate_msgdef(kind, ros_version=2)[0] if kind in STORE.fielddefs else ""
