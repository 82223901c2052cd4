# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""A bag: one file, a rosbag2 directory of several, or an episode of a LeRobot data set; messages of other encodings
(ROS 1, JSON) become those of ROS 2, so that whoever reads a bag sees one encoding.
"""

from __future__ import annotations

import heapq
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stickslip_ros.bags.decoding import types_of, types_of_ros
from stickslip_ros.bags.lerobot import episode_of, files_of_episode, is_data_set, name_an_episode
from stickslip_ros.bags.storage.formats import FORMATS, METADATA, BagFile, format_of, is_bag_file
from stickslip_ros.bags.storage.unpacking import Allowance, UnpackLimit
from stickslip_ros.bags.table import RecordingError, convert_command, load_table
from stickslip_ros.bags.topics import READ_TYPES
from stickslip_ros.bags.writing import joint_state_streams
from stickslip_ros.errors import needs, optional_packages, reason
from stickslip_ros.messages.joint_states import TYPE as JOINT_STATE
from stickslip_ros.messages.joint_states import Block, Channel, MessageError, Storage, Warn, blocks_of
from stickslip_ros.regular_files import read_yaml

_ANY = " or ".join((", ".join(one.suffix for one in FORMATS[:-1]), FORMATS[-1].suffix))
_Transcode = Callable[[bytes], bytes]
_OTHER_NAMES = {"nanosec": "nsec"}  # as Foxglove has it
_FIRST_STAMP = 1.0  # [s] of a recording whose times begin at zero: a stamp of zero means that there is none


class Bag:
    """Messages of a bag, block by block; use as a context.

    ``warnings`` grows while it is read: what is missing or damaged.

    Parameters
    ----------
    path : of a file or a directory. limit : of what is unpacked; none: the usual one.

    Raises
    ------
    RecordingError
        If nothing of it can be read; the message says why.
    """

    def __init__(self, path: Path, limit: UnpackLimit | None = None) -> None:
        self.path, self._limit = path, limit or UnpackLimit()
        self.warnings: list[str] = []
        self._stack = ExitStack()
        self._per_message = False
        try:
            self._storages = self._open()
            # Each channel as ROS 2 has it, and what makes its messages so.
            with optional_packages(f"bag {self.path}: its encoding"):
                self._transcoded: dict[Channel, tuple[Channel, _Transcode | None]] = {
                    channel: _transcoded(channel) for _, _, channels in self._storages for channel in channels
                }
        except BaseException:
            self._stack.close()
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def size(self) -> int:
        """Of its files [bytes]."""
        return sum(file.stat().st_size for file, _, _ in self._storages)

    def channels(self) -> dict[Channel, int]:
        """The channels, and how many messages each has; those of ROS 1 and JSON as ROS 2 would have them."""
        counts: dict[Channel, int] = {}
        for _, _, channels in self._storages:
            for raw, count in channels.items():
                channel, _ = self._transcoded[raw]
                counts[channel] = counts.get(channel, 0) + count
        return counts

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None] = lambda _: None) -> Iterator[Block]:
        """The messages of the wanted channels, perhaps with others among them; ``progress`` is told of bytes."""
        raw = {one for one, (channel, _) in self._transcoded.items() if channel in wanted}
        for file, storage, _ in self._storages:
            allowance = Allowance(self._limit, file.stat().st_size)
            with optional_packages(f"bag {self.path}: its compression"):
                for block in storage.blocks(raw, progress):
                    yield from self._as_ros2(block, raw, allowance)

    def _open(self) -> list[tuple[Path, Storage, dict[Channel, int]]]:
        try:
            if episode_of(self.path) is not None:
                episode = _EpisodeStorage(self.path, self._limit, self.warnings.append)
                return [(files_of_episode(self.path)[0], episode, episode.channels())]
            if is_data_set(self.path):
                raise RecordingError(f"bag {self.path}: {name_an_episode(self.path)}")
            if not self.path.exists():
                raise RecordingError(f"bag {self.path}: there is no such file or directory")
            files = self._files() if self.path.is_dir() else [self.path]
        except OSError as error:
            raise RecordingError(f"bag {self.path}: {reason(error)}") from error
        opened, reasons = [], []
        for file in files:
            try:
                bag_file = BagFile(file, self._stack, self._limit)
                storage = format_of(bag_file).open(bag_file, self.warnings.append)
                opened.append((file, storage, storage.channels()))
            except (OSError, ValueError, EOFError, ImportError) as error:
                why = f"it {needs(error)}" if isinstance(error, ImportError) else reason(error)
                reasons.append(f"{file.name}: {why}" if self.path.is_dir() else why)
        if not opened and self.path.is_file() and not is_bag_file(self.path):
            reasons.append(f"a table becomes one by {convert_command(self.path)}")
        if not opened:
            raise RecordingError(f"bag {self.path}: {'; '.join(reasons) or f'no {_ANY} file is in it'}")
        self.warnings += reasons
        return opened

    def _files(self) -> list[Path]:
        """The files of a directory in their order, as its metadata say or else by their names."""
        there = [file for file in self.path.iterdir() if is_bag_file(file)]
        by_name = sorted(there, key=lambda file: [int(n) if n.isdigit() else n for n in re.split(r"(\d+)", file.name)])
        metadata = self._metadata()
        if metadata is None:
            return by_name
        # Paths in metadata are file names, or begin with the directory's name in old bags.
        names = [Path(str(name)).name for name in metadata["relative_file_paths"]]
        if metadata.get("compression_mode", "").upper() == "MESSAGE":
            self._per_message = True
        missing = [name for name in names if not (self.path / name).exists()]
        for name in missing:
            self.warnings.append(f"{name}: missing; the bag's metadata name it")
        # What was renamed or copied here by hand is read in place of what is missing.
        others = [file for file in by_name if file.name not in names] if missing else []
        for file in others:
            self.warnings.append(f"{file.name}: read, although the bag's metadata do not name it")
        return [*(self.path / name for name in names if name not in missing), *others]

    def _metadata(self) -> Any:
        path = self.path / METADATA
        if not path.exists():
            return None
        try:
            metadata = read_yaml(path)["rosbag2_bagfile_information"]
            if not isinstance(metadata["relative_file_paths"], list):
                raise TypeError("relative_file_paths is no list")
            if not isinstance(metadata.get("compression_mode", ""), str):
                raise TypeError("compression_mode is no text")
        except (OSError, ValueError, KeyError, TypeError) as error:
            self.warnings.append(f"{METADATA}: damaged ({' '.join(str(error).split())}); files taken by their names")
            return None
        return metadata

    def _as_ros2(self, block: Block, wanted: set[Channel], allowance: Allowance) -> Iterator[Block]:
        """A block whose messages are whole and those of ROS 2; else its wanted messages made so, in as many blocks as
        their size then takes.
        """
        made = {number: self._transcoded[channel] for number, channel in block.channels.items() if channel in wanted}
        if not self._per_message and not any(transcode for _, transcode in made.values()):
            yield block
            return
        broken: Counter[str] = Counter()

        def messages() -> Iterator[tuple[int, int, bytes]]:
            for number in np.flatnonzero(np.isin(block.channel, list(made))).tolist():
                channel, transcode = made[int(block.channel[number])]
                data = block.message(number)
                try:
                    data = allowance.zstd(data) if self._per_message else data
                    data = transcode(data) if transcode is not None else data
                except MessageError as error:
                    broken[f"left out: {channel.topic}: {error}"] += 1
                except ValueError as error:
                    broken[f"could not be decompressed: {error}"] += 1
                else:
                    yield int(block.channel[number]), int(block.log_time[number]), data

        channels = {number: channel for number, (channel, _) in made.items()}
        yield from blocks_of(messages(), channels)
        self.warnings += [f"{count} messages {what}" for what, count in broken.items()]


def _transcoded(channel: Channel) -> tuple[Channel, _Transcode | None]:
    """A channel as ROS 2 has it, and what makes its messages of it; the channel itself and None if it is so, or of an
    encoding that is not known.
    """
    kind = _of_ros2(channel.type)
    if channel.encoding not in _ENCODINGS or kind not in READ_TYPES:
        return channel, None
    types, to_cdr = _ENCODINGS[channel.encoding]
    store = types(kind, channel.schema)
    if store is None or kind not in store.fielddefs:
        return channel, None
    try:
        schema = store.generate_msgdef(kind, ros_version=2)[0]
    except Exception:
        # It names a type that it does not define: what the generator raises then cannot be listed.
        return channel, None
    found = replace(channel, type=kind, encoding="cdr", schema_encoding="ros2msg", schema=schema)

    def transcode(message: bytes) -> bytes:
        try:
            return bytes(to_cdr(store, kind, message))
        except Exception as error:
            # What damaged bytes make generated code raise cannot be listed.
            raise MessageError(f"it is no {kind} in {channel.encoding}") from error

    return found, transcode


def _of_ros2(kind: str) -> str:
    """sensor_msgs/JointState, sensor_msgs.msg.JointState: as ROS 2 writes a type."""
    parts = kind.replace(".", "/").split("/")
    return "/".join((parts[0], "msg", parts[-1])) if len(parts) in (2, 3) else kind


def _made(store: Any, kind: str, values: Any) -> Any:
    """An object of a type, of what JSON has of it; what is missing is zero or empty."""
    if not isinstance(values, dict):
        raise MessageError(f"{kind} must be an object of JSON")
    fields = {}
    for name, description in store.fielddefs[kind][1]:
        value = values.get(name, values.get(_OTHER_NAMES.get(name, name)))
        fields[name] = _value(store, description, value)
    return store.types[kind](**fields)


def _value(store: Any, description: tuple[Any, Any], value: Any) -> Any:
    sort, of = description
    if sort.name == "NAME":
        return _made(store, of, {} if value is None else value)
    if sort.name == "BASE":
        return _number(of[0], value)
    (element, name), _ = of
    listed = [] if value is None else list(value)
    if element.name == "NAME":
        return [_made(store, name, one) for one in listed]
    if name[0] == "string":
        return [str(one) for one in listed]
    return np.array([_number(name[0], one) for one in listed], dtype=np.dtype(name[0]))


def _number(name: str, value: Any) -> Any:
    if name == "string":
        return "" if value is None else str(value)
    if name.startswith("float"):
        # JSON has no NaN but null.
        return math.nan if value is None else float(value)
    return bool(value) if name == "bool" else int(value or 0)


# Of each encoding the types, and what makes a message one of ROS 2. JSON's schemas do not say which integers and floats
# are meant: the types are ROS 2's own.
_ENCODINGS: dict[str, tuple[Callable[[str, str], Any], Callable[[Any, str, bytes], Any]]] = {
    "ros1": (
        lambda kind, schema: types_of(kind, "ros1msg", schema),
        lambda store, kind, message: store.ros1_to_cdr(message, kind),
    ),
    "json": (
        lambda _, __: types_of_ros(),
        lambda store, kind, message: store.serialize_cdr(_made(store, kind, json.loads(message)), kind),
    ),
}


class _EpisodeStorage:
    """One episode of a LeRobot data set; see :class:`~stickslip_ros.messages.joint_states.Storage`."""

    def __init__(self, path: Path, limit: UnpackLimit, warn: Warn) -> None:
        table = load_table(path, limit=limit)
        for note in table.notes:
            warn(note)
        _, streams = joint_state_streams(table.batches, _FIRST_STAMP)
        self._messages = {Channel(topic=topic, type=JOINT_STATE): list(stream) for topic, stream in streams.items()}

    def channels(self) -> dict[Channel, int]:
        return {channel: len(messages) for channel, messages in self._messages.items()}

    def blocks(self, wanted: set[Channel], progress: Callable[[int], None]) -> Iterator[Block]:
        chosen = [channel for channel in self._messages if channel in wanted]
        numbers = {channel.topic: number for number, channel in enumerate(chosen)}
        merged = heapq.merge(*(self._messages[channel] for channel in chosen), key=lambda one: one[0])
        yield from blocks_of(((numbers[topic], time, data) for time, topic, data in merged), dict(enumerate(chosen)))
